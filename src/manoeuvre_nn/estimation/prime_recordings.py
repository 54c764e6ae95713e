"""Recordings in units of L and the approach speed, averaged to an even pace, as the closed-loop fit takes them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.recorded_inputs import air_velocity, approach_speed

PACE = 0.05
"""Time between samples over L/U0 that recordings are averaged to: a ship hardly moves in it."""
MIN_AHEAD_SHAFT, MIN_AHEAD_SPEED = 0.01, 0.125
"""Least n over the nominal shaft speed and least u over U0 at which a model of ships that go ahead is held to data."""
MIN_PIECE = 3.0
"""Shortest piece over L/U0 of a run that goes ahead only now and then."""


def to_prime(recordings: Sequence[Recording], ship: Particulars, rpm: float, law: str) -> list[Recording]:
    """Make recordings non-dimensional.

    Velocities are made non-dimensional by U0 where shaft speeds are known (``law`` ``shaft``), else by the speed at the
    start of each run: in the prime system runs at several speeds are then one. Pieces in which the ship goes astern or
    its propeller does are left out where the model knows of the propeller.

    Args:
        recordings: As they were read, not smoothed.
        ship: The ship.
        rpm: Nominal shaft speed [rpm].
        law: ``shaft`` or ``approach``.

    Returns:
        u, v, r, x, y, psi, delta, n, wind_north, wind_east over L, U0 and the nominal shaft speed; a recording may give
        several, or none.

    Raises:
        InputError: If nothing is left.
    """
    made = []
    for recording in recordings:
        speed = ship.speed if law == "shaft" else approach_speed(recording, ship)
        made += _pieces(_prime(recording, ship, speed, rpm), law)
    if not made:
        raise InputError(f"no recording has {MIN_PIECE:g} L/U0 of motion ahead in one piece: give longer ones")
    return made


def averaged(recording: Recording, interval: float) -> Recording:
    """Means over even times: what a slower recorder with a filter would have written.

    Args:
        recording: The recording.
        interval: Time between samples [s]; a recording that is slower than that stays as it is.

    Returns:
        The recording; each sample is the mean of those about it, its time theirs.
    """
    own = float(np.median(np.diff(recording.time)))
    count = int(interval / own + 1e-6)
    if count < 2:
        return recording
    place = ((recording.time - recording.time[0]) / (count * own) + 1e-6).astype(int)
    number = np.bincount(place)
    kept = number > 0

    def mean(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        return np.bincount(place, values)[kept] / number[kept]

    # An angle that jumps has no mean: directions are left out, their components are not.
    channels = {name: mean(values) for name, values in recording.channels.items() if "_from" not in name}
    return Recording(recording.name, mean(recording.time), channels, recording.status, recording.meta)


def _prime(recording: Recording, ship: Particulars, speed: float, rpm: float) -> Recording:
    """One recording in units of L and a speed."""
    if "wind_speed" in recording.channels:
        north, east = air_velocity(recording, ship)
        recording = recording.with_channels(wind_north=north, wind_east=east)
    r = averaged(recording, PACE * ship.length / speed)
    second, calm = ship.length / speed, np.zeros(len(r))
    units = {"u": speed, "v": speed, "r": 1 / second, "x": ship.length, "y": ship.length, "psi": 1.0, "delta": 1.0}
    channels = {name: r[name] / unit for name, unit in units.items()}
    n = r["n"] * 60 / rpm if "n" in r.channels else np.full(len(r), approach_speed(recording, ship) / ship.speed)
    wind = {k: r.channels.get(k, calm) / speed for k in ("wind_north", "wind_east")}
    meta = {"derived": r.derived}
    return Recording(r.name, (r.time - r.time[0]) / second, {**channels, "n": n, **wind}, meta=meta)


def _pieces(recording: Recording, law: str) -> list[Recording]:
    """Where the ship and its propeller go ahead."""
    ahead = np.ones(len(recording), dtype=bool)
    if law == "shaft":
        ahead = (recording["n"] > MIN_AHEAD_SHAFT) & (recording["u"] > MIN_AHEAD_SPEED)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ahead, [False]]).astype(int)))
    pairs = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 2]
    time = recording.time
    return [recording.rows(slice(a, b)) for a, b in pairs if time[b - 1] - time[a] >= MIN_PIECE]
