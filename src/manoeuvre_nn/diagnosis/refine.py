"""A second linearisation: about the motion that the found hypothesis itself makes most likely."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.bench import Bench, Place, moved_track
from manoeuvre_nn.diagnosis.court import linear
from manoeuvre_nn.diagnosis.hypothesis import Judged
from manoeuvre_nn.diagnosis.linear import Columns


def refined(bench: Bench, judged: Judged) -> Bench:
    """The runs about the track of a fitted hypothesis.

    The first track was found with any force, stream and sensor error allowed; what it mistook for one another is only
    corrected to first order there.

    Args:
        bench: The runs about the first track.
        judged: What was found.

    Returns:
        The runs about the new track.
    """
    lin = linear(bench, judged.hypothesis)
    level = bench.at(judged.best[0])
    places: list[Place] = []
    names: list[str] = []
    for run, place in enumerate(bench.places):
        base, c = place.base, lin.columns[run]
        shares = judged.nuisance[bench.base_index(run)[1:] - 1]
        left = Columns(
            base.measured[..., :1] - c.measured[..., :1] - _sum(base.measured[..., 1:], shares),
            base.moved[..., :1] - c.moved[..., :1] - _sum(base.moved[..., 1:], shares),
        )
        track = place.line.track + level.white[run].states(left)[:, :6, 0]
        new, names = moved_track(bench.dynamics, place, track)
        places.append(new)
    return Bench(bench.dynamics, places, names)


def _sum(columns: Float[np.ndarray, "n k p"], shares: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n k 1"]:
    return (columns @ shares)[..., None]
