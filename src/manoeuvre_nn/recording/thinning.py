"""Fewer samples where there are more than a ship's motion needs: smoothing takes as long as its window has samples."""

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording

SAMPLES_PER_TIME_UNIT = 400
"""Samples in the time L/U0 that tell all of a ship's motion: local cubics over .8 L/U0 have 320 then."""


def thinned(recording: Recording, ship: Particulars) -> Recording:
    """Averages over so many samples that at least :data:`SAMPLES_PER_TIME_UNIT` are left in the time L/U0.

    Returns:
        A recording of averages, less the samples at the end that fill no average; the same one if it has no more.
    """
    count = int(ship.time_unit / (SAMPLES_PER_TIME_UNIT * recording.step))
    if count < 2 or len(recording) < 4 * count:
        return recording
    whole = len(recording) // count * count
    given = {"time": recording.time, **recording.channels}
    means = {name: values[:whole].reshape(-1, count).mean(axis=1) for name, values in given.items()}
    return Recording(recording.name, means.pop("time"), means, recording.status, recording.meta)
