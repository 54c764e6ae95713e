"""The diagnosis with one of its parts left out: what that part is worth.

    python -m studies.concealed_trial.rivals.ablations without=scatter cases=DIR out=DIR
    python scripts/concealed_trial.py cases=48 seed=SEED methods=manoeuvre_nn,without_scatter,without_process_noise

Everything else is as ``manoeuvre diagnose`` does it, whose options are understood besides.
"""

import sys
from collections.abc import Callable, Mapping
from math import inf

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.commands.guard import one_line
from manoeuvre_nn.commands.main import run
from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis import fits, gusts, search
from manoeuvre_nn.diagnosis.case import Case
from manoeuvre_nn.estimation import marginal_likelihood, relinearise
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, MarginalLikelihood

WITHOUT = "without"
"""Word of the command line."""


def _only(keep: Callable[[Float[np.ndarray, "g s"]], Float[np.ndarray, "g s"]]) -> None:
    """Give all levels of noise but some no prior probability."""
    whole = marginal_likelihood.log_prior_levels

    def kept(data_set: WhitenedDataSet, process_prior: float | None) -> Float[np.ndarray, "g s"]:
        prior = whole(data_set, process_prior)
        return np.where(np.isfinite(keep(np.full(prior.shape, -inf))), prior, -inf)

    for module in (marginal_likelihood, relinearise, gusts):
        module.log_prior_levels = kept  # type: ignore[attr-defined]


def _first(level: Float[np.ndarray, "g s"], axis: int) -> Float[np.ndarray, "g s"]:
    """The lowest level of the process noise (0) or of the coefficients' errors (1) alone."""
    np.moveaxis(level, axis, 0)[0] = 0.0
    return level


def _scatter() -> None:
    """Published coefficients are exact."""
    _only(lambda level: _first(level, 1))


def _process_noise() -> None:
    """The equations are exact but for the coefficients."""
    _only(lambda level: _first(level, 0))
    whole = MarginalLikelihood.evaluate

    def at_lowest(
        self: MarginalLikelihood,
        hypothesis: Hypothesis,
        process_prior: float | None = PROCESS_PRIOR,
        around: int | None = None,
    ) -> FittedHypothesis:
        del around  # whatever was asked for
        return whole(self, hypothesis, process_prior, 0)

    MarginalLikelihood.evaluate = at_lowest  # type: ignore[method-assign]


def _relinearisation() -> None:
    """Runs stay linearised about the states of the smoother."""
    search.MIN_GAIN_TO_RELINEARISE = inf
    fits.MAX_PASSES = 0  # type: ignore[assignment]


def _other_runs() -> None:
    """Of the runs to be fitted only the first is."""

    def first(self: Case) -> list[Recording]:
        return [run for run in self.runs if run.name not in self.proof][:1]

    Case.fitted = property(first)  # type: ignore[method-assign, assignment]


PARTS: Mapping[str, Callable[[], None]] = {
    "scatter": _scatter,
    "process_noise": _process_noise,
    "relinearisation": _relinearisation,
    "other_runs": _other_runs,
}
"""What can be left out."""


def main(arguments: list[str]) -> None:
    """Leave a part out and diagnose.

    Args:
        arguments: ``without=PART``, then those of ``manoeuvre diagnose``.
    """
    given = dict(a.split("=", 1) for a in arguments if a.startswith(f"{WITHOUT}="))
    check_choice(WITHOUT, given.get(WITHOUT, ""), list(PARTS))
    PARTS[given[WITHOUT]]()
    sys.argv[1:] = [a for a in arguments if not a.startswith(f"{WITHOUT}=")]
    run("diagnose")


if __name__ == "__main__":
    with one_line():
        main(sys.argv[1:])
