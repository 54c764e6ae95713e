"""The callback that scores an approximation of a response on records that it was not trained on."""

from collections.abc import Callable, Mapping
from typing import Any

import lightning as L

from manoeuvre_nn.core.limits import Count, CountOrNone
from manoeuvre_nn.core.response import Response
from manoeuvre_nn.training.dashboard import show_figures
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.response_data import LEARNING, TESTING, ResponseData
from manoeuvre_nn.training.scorer import Scorer

Draw = Callable[[ResponseData, Response], Mapping[str, Any]]
"""Data and approximation -> name -> matplotlib figure."""


class ResponseScore(Scorer):
    """Every k-th epoch, the root mean square errors of learning, testing and random records between.

    Where no record tests, that of the learnt ones stands in.
    """

    monitor = "score/rms"
    in_words = "testing RMS {:.3g}"
    scored_on = "the testing records"
    for_others = "for other records"

    def __init__(
        self, data: ResponseData, *, every: Count = 1, figures_every: CountOrNone = 0, draw: Draw | None = None
    ) -> None:
        """Set up.

        Args:
            data: The records, set up by the time of the first score.
            every: Epochs between scores.
            figures_every: Scores between figures in TensorBoard; 0 draws none.
            draw: Makes the figures.
        """
        super().__init__(every)
        self.data, self.figures_every, self.draw = data, figures_every, draw

    def score(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, float]:
        """Errors in the unit of the response: the monitored one, and those of every set."""
        assert isinstance(pl_module, Fit)
        assert isinstance(pl_module.dynamics, Response)
        response = pl_module.dynamics
        errors = {name: found["rms"] for name, found in self.data.errors(response).items()}
        if self.draw and self.figures_every and (len(self.history) + 1) % self.figures_every == 0:
            show_figures(trainer, self.draw(self.data, response))
        chosen = errors.get(TESTING, errors[LEARNING])
        return {self.monitor: chosen, **{f"{name}/rms": error for name, error in errors.items()}}
