"""Lightning modules: fits of networks whose nodes answer to what is near. An epoch is a candidate or a step."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Factor, NotNegative, Weight
from manoeuvre_nn.core.response import Response
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.numerics.kernel_regression import WidthSearch
from manoeuvre_nn.numerics.radial_basis import RidgeFit, gaussian_nodes, neighbour_distances, ridge_by_press
from manoeuvre_nn.numerics.repeats import without_repeats
from manoeuvre_nn.training.data import Batch
from manoeuvre_nn.training.fits import Fit

SEARCH = "width_search"
"""Where a checkpoint holds the search for widths."""
ALL_TRIED, AT_REST = "all widths tried", "leave-one-out error at rest"


class RadialBasisFit(Fit):
    """Centres by k-means, widths by their neighbours, output weights by ridge regression: no descent anywhere.

    Every epoch tries one factor of the widths; the network keeps the best by the error of left-out records.

    Source:
        Moody & Darken 1989; Allen 1974 for the choice by left-out records.
    """

    made_for = RadialBasis
    best_press: Tensor

    def __init__(
        self,
        dynamics: IdentifiedShip | Response,
        *,
        factors: Sequence[Factor] = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0),
        ridges: Sequence[Weight] = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4),
        neighbours: int = 5,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: The model.
            factors: Widths to try, over the distance to the nearest other centres [-].
            ridges: What is tried on the diagonal, over its largest element [-].
            neighbours: Number of those centres.

        Raises:
            InputError: If there is nothing to try, or a number is out of its range.
        """
        super().__init__(dynamics, 1)
        if not factors or min(factors) <= 0:
            raise InputError(f"fit.factors={list(factors)}: expected numbers more than 0")
        if not ridges or min(ridges) < 0:
            raise InputError(f"fit.ridges={list(ridges)}: expected numbers from 0 on")
        if neighbours < 1:
            raise InputError(f"fit.neighbours={neighbours}: expected at least 1")
        self.factors, self.ridges, self.neighbours = tuple(factors), tuple(ridges), neighbours
        self.register_buffer("best_press", torch.tensor(torch.inf, dtype=torch.float64))

    def configure_optimizers(self) -> None:
        """None: an epoch solves a linear problem."""

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Try one factor."""
        network: Any = self.dynamics.network
        x, y = self.scaled(batch[0], batch[1])
        kept, values = without_repeats(x, y[0])
        if self.current_epoch == 0:
            network.place(kept)
        distances = neighbour_distances(network.centres, self.neighbours)
        widths = self.factors[min(self.current_epoch, len(self.factors) - 1)] * distances
        found = ridge_by_press(gaussian_nodes(kept, network.centres, widths), values, self.ridges)
        if found.press < float(self.best_press):
            self._take(found, widths)
        if self.current_epoch + 1 >= len(self.factors):
            self.stopped = ALL_TRIED
        self.log("train/press", float(self.best_press))
        self.finish(batch, (self.rows(x) - y).square().mean())

    @torch.no_grad()
    def _take(self, found: RidgeFit, widths: Tensor) -> None:
        """Make it the network's."""
        network: Any = self.dynamics.network
        network.widths.copy_(widths)
        network.output_weights.copy_(found.weights)
        self.best_press.fill_(found.press)


class GeneralRegressionFit(Fit):
    """Records are stored; the smoothing widths are those of least leave-one-out error.

    Every epoch is a step of L-BFGS; the network keeps the best widths so far.

    Source:
        Specht 1991 (the holdout method).
    """

    made_for = GeneralRegression

    def __init__(
        self, dynamics: IdentifiedShip | Response, *, common_width: bool = False, min_fall: NotNegative = 1e-5
    ) -> None:
        """Set up the method.

        Args:
            dynamics: The model.
            common_width: Whether all inputs have one width, as in the paper.
            min_fall: Fall of the error over the error at which the widths are at rest [-].
        """
        super().__init__(dynamics, 1)
        self.common_width, self.min_fall = common_width, min_fall
        self._search: WidthSearch | None = None
        self._before: dict[str, Any] | None = None

    def configure_optimizers(self) -> None:
        """None: the widths have an optimizer of their own."""

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """One step."""
        network: Any = self.dynamics.network
        x, y = self.scaled(batch[0], batch[1])
        kept, values = without_repeats(x, y[0])
        if self._search is None:
            self._search = WidthSearch(kept, values, common=self.common_width)
            if self._before is not None:
                self._search.load_state_dict(self._before)
        self._search.step(self.min_fall)
        network.store(kept, values, self._search.widths)
        if self._search.stopped:
            self.stopped = AT_REST
        self.log("train/leave_one_out", self._search.error)
        self.finish(batch, (self.rows(x) - y).square().mean())

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep where the search is."""
        super().on_save_checkpoint(checkpoint)
        if self._search is not None:
            checkpoint[SEARCH] = self._search.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the search up again."""
        super().on_load_checkpoint(checkpoint)
        self._before = checkpoint.get(SEARCH)
