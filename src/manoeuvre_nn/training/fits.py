"""Lightning modules: the two ways to fit a network to tuples."""

from abc import ABC
from collections.abc import Sequence
from typing import Any, ClassVar

import lightning as L
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn import __version__
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Share, as_seed
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.response import Response
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.damping import Damping, Stops
from manoeuvre_nn.numerics.evidence import WeightDecay, nothing_shrunk
from manoeuvre_nn.numerics.levenberg_marquardt import LevenbergMarquardt
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.steepest_descent import RateSchedule, SteepestDescent, StoppingRules
from manoeuvre_nn.training.checkpoint import STOPPED_KEY, VERSION_KEY
from manoeuvre_nn.training.data import Batch

LARGEST_BLOCK = 2e7
"""Numbers in the largest block of a Jacobian that is built at once: 160 MB in double precision."""
MAX_ITERATIONS = 1_000_000
"""Iterations of an epoch: more, and nobody sees its end."""


class Fit(ABC, L.LightningModule):
    """A network being fitted to g, or to a response.

    One epoch sees the whole data set once or, where an iteration is cheap, ``iterations_per_epoch`` times.

    Attributes:
        dynamics: The model: known part, network and scaling, or a response's network and scaling.
        stopped: Why the optimizer stopped of its own; empty while it runs.
    """

    dynamics: IdentifiedShip
    made_for: ClassVar[type[Network] | None] = None
    """The networks that the method trains; None are all that any method can train."""
    errors_of: tuple[str, ...] = ("g1", "g2", "g3")
    """What :meth:`relative_rmse` is the error of: forces, or what the network gives instead."""
    epoch_is: ClassVar[str] = "epoch"
    """What an epoch trains, in a word."""
    on_processor: ClassVar[bool] = False
    """Whether the method computes on the processor alone."""

    def __init__(self, dynamics: IdentifiedShip | RecursiveShip | Response, iterations_per_epoch: int) -> None:
        """Store the model.

        Args:
            dynamics: Known part, network and scaling; ship and recursive network; or a response.
            iterations_per_epoch: Iterations of the optimizer in a Lightning epoch.

        Raises:
            InputError: If the method is not for this kind of network, or the number of iterations is not positive.
        """
        super().__init__()
        network = type(dynamics.network)
        if not self.trains(network):
            raise InputError(
                f"{type(self).__name__} does not train a {network.__name__}: choose another network or fit"
            )
        if not 1 <= iterations_per_epoch <= MAX_ITERATIONS:
            raise InputError(f"fit.iterations_per_epoch={iterations_per_epoch}: expected 1 to {MAX_ITERATIONS:g}")
        self.automatic_optimization = False
        self.dynamics = dynamics  # type: ignore[assignment]  # a fit made for recursive networks says so
        self.iterations_per_epoch = iterations_per_epoch
        self.stopped = ""

    @classmethod
    def trains(cls, network: type[Network]) -> bool:
        """Whether the method can train networks of a class."""
        return network.any_fit if cls.made_for is None else issubclass(network, cls.made_for)

    def rows(self, inputs: Float[Tensor, "n inputs"]) -> Float[Tensor, "k n o"]:
        """Scaled network outputs, one row for each independent network."""
        network: Any = self.dynamics.network
        return network.rows(inputs) if hasattr(network, "rows") else network(inputs)[None]

    def scaled(self, inputs: Float[Tensor, "n inputs"], targets: Float[Tensor, "n outputs"]) -> tuple[Tensor, Tensor]:
        """Tuples as the network's rows see them.

        Args:
            inputs: u', v', r', delta, or features of a response.
            targets: g', or the response.

        Returns:
            Scaled inputs (n, i) and scaled targets, one row for each independent network (k, n, o).
        """
        x, y = self.dynamics.scaling.inputs(inputs), self.dynamics.scaling.outputs(targets)
        count = len(self.rows(x[:1]))
        return x, y.reshape(len(y), count, -1).movedim(1, 0)

    @torch.no_grad()
    def unknown_force(self, inputs: Float[Tensor, "n inputs"]) -> Float[Tensor, "n outputs"]:
        """What the network gives, restored: unknown forces g' [-], or the response."""
        scaling = self.dynamics.scaling
        return scaling.restore(self.dynamics.network(scaling.inputs(inputs)))

    @torch.no_grad()
    def relative_rmse(
        self, inputs: Float[Tensor, "n inputs"], targets: Float[Tensor, "n outputs"]
    ) -> Float[Tensor, " outputs"]:
        """Root mean square error of each target over its root mean square [-]."""
        g = self.unknown_force(inputs)
        return ((g - targets).square().mean(0) / targets.square().mean(0).clamp(min=1e-30)).sqrt()

    def epochs_of(self, most: int) -> int:
        """Epochs that the fit has to do if it does not stop before, of so many at most."""
        return most

    def generalization_error(self, data: L.LightningDataModule) -> float | None:
        """The error by which a network is chosen; None for the mean deviation on held-out runs."""
        return None

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Say which version wrote the checkpoint, and whether the optimizer had stopped."""
        checkpoint[VERSION_KEY], checkpoint[STOPPED_KEY] = __version__, self.stopped

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take up whether the optimizer had stopped; in checkpoints of earlier versions it had not."""
        self.stopped = checkpoint.get(STOPPED_KEY, "")

    def on_train_start(self) -> None:
        """Leave a fit as it is that was resumed after it had stopped."""
        self.trainer.should_stop = self.trainer.should_stop or bool(self.stopped)

    def finish(self, batch: Batch, loss: Tensor) -> None:
        """Log the mean square error of an epoch and stop the trainer if the optimizer has."""
        self.log("train/mse", loss, prog_bar=True)
        if self.stopped:
            self.trainer.should_stop = True


class BackpropFit(Fit):
    """Steepest descent with momentum, rate schedule, shaking and three stopping rules.

    Source:
        Wang 1996, sections 2.3-2.5 and 4.4.3, eqs 2.11-2.21.
    """

    best_test: Tensor

    def __init__(
        self,
        dynamics: IdentifiedShip | Response,
        *,
        batch_size: int | None = None,
        momentum: Share = 0.9,
        schedule: RateSchedule | None = None,
        stopping: StoppingRules | None = None,
        iterations_per_epoch: int = 1000,
        seed: int = 0,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: The model.
            batch_size: Samples an iteration: 1 is the thesis' per-sample rule, None all samples.
            momentum: alpha of eqs 2.20-2.21 [-].
            schedule: Training rate over iterations; by default the thesis'.
            stopping: The three rules; by default none but the trainer's number of epochs.
            iterations_per_epoch: Iterations (weight updates) in a Lightning epoch.
            seed: Seed of the order in which samples are presented.

        Raises:
            InputError: If a setting is out of range.
        """
        super().__init__(dynamics, iterations_per_epoch)
        if batch_size is not None and batch_size < 1:
            raise InputError(f"fit.batch_size={batch_size}: expected at least 1, or null for all samples")
        self.batch_size, self.momentum, self.seed = batch_size, momentum, seed
        self.schedule, self.stopping = schedule or RateSchedule(), stopping
        self.register_buffer("best_test", torch.tensor(torch.inf, dtype=torch.float64))

    def configure_optimizers(self) -> SteepestDescent:
        """One optimizer for all networks: their gradients do not mix."""
        return SteepestDescent(self.dynamics.network.parameters(), momentum=self.momentum, schedule=self.schedule)

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Many iterations of steepest descent."""
        x, y = self.scaled(batch[0], batch[1])
        optimizer: Any = self.optimizers()
        parameters = list(self.dynamics.network.parameters())
        presentations = self._presentations(len(x))
        for count, indices in enumerate(presentations, start=1):
            part, target = (x, y) if indices is None else (x[indices], y[:, indices])
            loss = (self.rows(part) - target).square().sum() / len(part)
            for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
                parameter.grad = gradient
            # Lightning counts one step an epoch; its wrapper would cost more than the step itself.
            (optimizer if count == len(presentations) else optimizer.optimizer).step()
        self._evaluate(batch, x, y)

    def _presentations(self, count: int) -> Sequence[Tensor | None]:
        """Sample numbers of each iteration of an epoch; the order depends on seed and epoch alone."""
        if self.batch_size is None or self.batch_size >= count:
            return [None] * self.iterations_per_epoch
        generator = torch.Generator().manual_seed(as_seed(self.seed * 1_000_003 + self.current_epoch))
        needed = self.iterations_per_epoch * self.batch_size
        passes = -(-needed // count)
        order = torch.cat([torch.randperm(count, generator=generator) for _ in range(passes)])[:needed]
        return list(order.split(self.batch_size))

    @torch.no_grad()
    def _evaluate(self, batch: Batch, x: Tensor, y: Tensor) -> None:
        """Log the errors and ask the stopping rules."""
        loss = (self.rows(x) - y).square().mean()
        test = None
        if len(batch[2]):
            held_x, held_y = self.scaled(batch[2], batch[3])
            test = (self.rows(held_x) - held_y).square().mean()
            self.best_test = torch.minimum(self.best_test, test.to(self.best_test))
            self.log("train/validation_mse", test)
        if self.stopping is not None:
            iteration = (self.current_epoch + 1) * self.iterations_per_epoch
            known = None if test is None else float(test)
            self.stopped = self.stopping.reason(iteration, float(loss), known, float(self.best_test))
        self.finish(batch, loss)


class LevenbergMarquardtFit(Fit):
    """Levenberg-Marquardt with TRAINLM's parameters; every independent network is a row of one batch.

    Attributes:
        shrinkage: alpha, beta and the effective number of weights of every row, see :class:`.WeightDecay`; None where
            weights are not shrunk.

    Source:
        Rajesh & Bhattacharyya 2009, section 4; Hagan & Menhaj 1994; Foresee & Hagan 1997 for the shrunk weights.
    """

    shrinkage: Tensor | None

    def __init__(
        self,
        dynamics: IdentifiedShip | Response,
        *,
        damping: Damping | None = None,
        stops: Stops | None = None,
        bayesian: bool = False,
        iterations_per_epoch: int = 1,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: The model.
            damping: How mu follows the steps; by default TRAINLM's rule.
            stops: When a row is done; by default when its gradient is 1e-13. Epochs are counted by the trainer.
            bayesian: Whether the weights of a perceptron are shrunk as far as the evidence says.
            iterations_per_epoch: Levenberg-Marquardt epochs in a Lightning epoch.

        Raises:
            InputError: If weights are to be shrunk that are not a perceptron's.
        """
        super().__init__(dynamics, iterations_per_epoch)
        self.damping, self.stops = damping or Damping(), stops or Stops(min_step=0.0)
        self._problem: OneHidden | None = None
        self._normal = torch.empty(0)
        if bayesian and not isinstance(dynamics.network, Perceptron):
            raise InputError("fit.bayesian=true is for perceptrons: choose another network, or fit.bayesian=false")
        first = _stacked(nothing_shrunk(self._weights())) if bayesian else None
        self.register_buffer("shrinkage", first)

    def configure_optimizers(self) -> LevenbergMarquardt:
        """The optimizer, with normal equations by formula for a perceptron."""
        network = self.dynamics.network
        rows, normal = None, None
        if isinstance(network, Perceptron):
            rows, normal = network.rows_count, self._normal_equations
        return LevenbergMarquardt(
            network.parameters(), rows=rows, normal=normal, damping=self.damping, stops=self.stops
        )

    def _normal_equations(self) -> tuple[Tensor, Tensor]:
        """Those of a perceptron at its present weights."""
        assert self._problem is not None
        weights = self._weights().detach()
        self._normal, gradient = self._problem.normal_equations(weights)
        decay = self._decay
        return (self._normal, gradient) if decay is None else decay.normal_equations(self._normal, gradient, weights)

    def _weights(self) -> Tensor:
        """Weights of a perceptron, a row for each independent network."""
        return torch.cat([p.flatten(1) for p in self.dynamics.network.parameters()], dim=1)

    @property
    def _decay(self) -> WeightDecay | None:
        """How far the weights are shrunk."""
        return None if self.shrinkage is None else WeightDecay(*self.shrinkage)

    def _residuals(self, x: Tensor, y: Tensor) -> Tensor:
        """Errors at the present weights, and what stands for the prior."""
        errors, decay = (self.rows(x) - y).flatten(1), self._decay
        return errors if decay is None else decay.residuals(errors, self._weights())

    @torch.no_grad()
    def _shrink_again(self, x: Tensor, y: Tensor) -> None:
        """Estimate the prior once more, with the normal equations of the last step."""
        decay = self._decay
        if decay is not None:
            assert self.shrinkage is not None
            decay = decay.again(self._normal, (self.rows(x) - y).flatten(1), self._weights())
            self.shrinkage.copy_(_stacked(decay))
            self.log("train/effective_weights", float(decay.effective.sum()))

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """One or more Levenberg-Marquardt epochs over all tuples."""
        x, y = self.scaled(batch[0], batch[1])
        network = self.dynamics.network
        if isinstance(network, Perceptron):
            hidden = network.input_weights.shape[1]
            self._problem = OneHidden(x, y, hidden, activation=network.activation, max_elements=LARGEST_BLOCK)
        optimizer: Any = self.optimizers()
        inner: LevenbergMarquardt = optimizer.optimizer
        for _ in range(self.iterations_per_epoch):
            optimizer.step(lambda: self._residuals(x, y))
            self._shrink_again(x, y)
            if len(batch[2]):
                inner.validate(self._validation_error(batch))
            if inner.stopped:
                break
        self.log("train/mu", float(inner.mu.max()))
        if inner.stopped:
            self.stopped = "; ".join(dict.fromkeys(inner.reasons))
        with torch.no_grad():
            loss = inner.loss if self.shrinkage is None else (self.rows(x) - y).square()
        self.finish(batch, torch.as_tensor(loss).mean())

    @torch.no_grad()
    def _validation_error(self, batch: Batch) -> Tensor:
        """Mean square error of every row on the tuples kept back."""
        x, y = self.scaled(batch[2], batch[3])
        return (self.rows(x) - y).square().mean(dim=(1, 2))


def _stacked(decay: WeightDecay) -> Float[Tensor, "3 k"]:
    """A prior as a checkpoint holds it."""
    return torch.stack([decay.alpha, decay.beta, decay.effective]).detach()
