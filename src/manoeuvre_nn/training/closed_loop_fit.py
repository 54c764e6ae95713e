"""A fit of a series in closed loop: states and coefficients together, a pass an epoch."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Factor
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.estimation.agreement import birge_scaled_covariance
from manoeuvre_nn.estimation.closed_loop import at_rest, first, improve, solve
from manoeuvre_nn.estimation.coefficient_forces import series_forces
from manoeuvre_nn.estimation.coefficient_priors import series_prior
from manoeuvre_nn.estimation.prime_recordings import to_prime
from manoeuvre_nn.estimation.problem import CHANNELS, Estimate, EstimationProblem, sensor_faults
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.training.data import Batch, ManoeuvreData
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.scalings import approach_scaling

RESTING = "coefficients and noise at rest"
ESTIMATE = "estimate"
"""Where a checkpoint holds how far the estimation has come."""
STORED = tuple(f.name for f in fields(Estimate) if f.name != "state_covariance")
"""What it holds of an :class:`.Estimate`: all but what is large, and needed by no pass that follows."""
MAX_SIZE = 1e6
"""Largest standard deviation or time that is taken, in units of the ship: so large it says that nothing is known."""


@dataclass(frozen=True)
class ClosedLoopSettings:
    """How far equations, sensors and the prior are believed.

    Attributes:
        force: Standard deviation of the accelerations that the model may lack in surge, sway and yaw at U0, in U0^2/L
            (yaw: U0^2/L^2). Small ones make the fit follow the ship for long, as simulations do; large ones make it a
            fit to accelerations.
        force_time: Correlation time of them in L/U0.
        floor: Noise of u, v, r, x, y, psi is never taken to be smaller, in U0, U0/L, L, rad: no model is better.
        learn_force: Whether it is estimated; ``force`` is then the most that it may be.
        force_with_speed: Whether it goes with the ship's speed in sway and yaw where the wind was recorded: forces go
            with dynamic pressure, and so do those that a model lacks.
        learn_floor: Whether ``floor`` sinks as far as stretches of the recordings agree: it does for a model that is
            right, and not for one that is not.
        prior: ``relative`` and ``size`` of :func:`.series_prior`: how far Clarke's derivatives are believed.
        delays: Channels whose sensors' delay is estimated in every run.
        offsets: Channels whose sensors' offset is estimated in every run.
        enough: Step over the prior's standard deviation at which the fit is done [-].
    """

    force: Sequence[float] = (3e-3, 1.15e-2, 6.7e-2)
    force_time: float = 1.0
    floor: Sequence[float] = (0.01, 0.01, 0.03, 0.02, 0.02, 0.03)
    learn_force: bool = True
    learn_floor: bool = True
    force_with_speed: bool = True
    prior: Mapping[str, float] = field(default_factory=dict)
    delays: Sequence[str] = ()
    offsets: Sequence[str] = ()
    enough: Factor = 1e-3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is missing, not positive or beyond any ship.
        """
        given = {"fit.force": (self.force, 3), "fit.floor": (self.floor, 6)}
        for name, (values, count) in given.items():
            if len(values) != count or not all(0 < v <= MAX_SIZE for v in values):
                raise InputError(f"{name}={list(values)}: expected {count} numbers, all more than 0, to {MAX_SIZE:g}")
        if not all(0 < value <= MAX_SIZE for value in self.prior.values()):
            said = ", ".join(f"{name}={value}" for name, value in self.prior.items())
            raise InputError(f"fit.prior: {said}: expected numbers more than 0, to {MAX_SIZE:g}")
        if not 0 < self.force_time <= MAX_SIZE:
            raise InputError(f"fit.force_time={self.force_time}: expected L/U0, more than 0, to {MAX_SIZE:g}")
        for setting, channels in (("fit.delays", self.delays), ("fit.offsets", self.offsets)):
            for channel in channels:
                check_choice(setting, channel, list(CHANNELS))


DEFAULT_SETTINGS = ClosedLoopSettings()
"""As in ``conf/fit/closed_loop.yaml``; by this force left-out Esso Osaka runs are predicted best (docs/measured.md)."""


def as_stored(estimate: Estimate) -> dict[str, Any]:
    """How far an estimation has come, as a checkpoint holds it: tensors and numbers, to the last bit."""
    return {name: _each_array(getattr(estimate, name), torch.as_tensor) for name in STORED}


def taken_up(first: Estimate, stored: Any) -> Estimate:
    """An estimation that goes on where it was.

    Args:
        first: Where it would begin, which says of what kind and size everything is.
        stored: What :func:`as_stored` gave.

    Returns:
        Where it was.

    Raises:
        InputError: If a field is missing, damaged, or of other recordings or settings.
    """
    if not isinstance(stored, dict) or not set(STORED) <= set(stored):
        raise InputError("its states are missing, as in those of earlier versions")
    found = {name: _each_array(stored[name], Tensor.numpy) for name in STORED}
    for name, value in found.items():
        finite = _kind(value) == _kind(getattr(first, name)) and all(np.isfinite(part).all() for part in _parts(value))
        if not finite:
            raise InputError(f"{ESTIMATE}.{name} is damaged, or of other recordings")
    return replace(first, **found)


def _each_array(value: Any, convert: Callable[[Any], Any]) -> Any:
    """A field with its arrays made tensors, or the other way round; numbers as they are."""
    if isinstance(value, tuple):
        return tuple(_each_array(part, convert) for part in value)
    return convert(value) if isinstance(value, np.ndarray | Tensor) else value


def _parts(value: Any) -> tuple[Any, ...]:
    """The arrays or numbers of a field."""
    return value if isinstance(value, tuple) else (value,)


def _kind(value: Any) -> list[Any]:
    """What a field must be like."""
    return [(part.shape, part.dtype) if isinstance(part, np.ndarray) else type(part) for part in _parts(value)]


@contextmanager
def breakdown_told() -> Generator[None]:
    """Make wrong input of recordings that cannot be explained at all.

    Raises:
        InputError: If the fit breaks down.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise InputError(f"fit=closed_loop broke down: {error}; mind the units of the recordings") from error


def explained(
    model: IdentifiedShip, recordings: Sequence[Recording], settings: ClosedLoopSettings
) -> EstimationProblem:
    """Recordings and a series as one estimation problem.

    Args:
        model: Known inertia and a series.
        recordings: As they were read, not smoothed.
        settings: How far everything is believed.

    Returns:
        The problem.
    """
    ship, network = model.particulars, model.network
    assert isinstance(network, Series)
    runs = to_prime(recordings, ship, model.known.shaft_rpm, network.speed_law)
    mean, spread = series_prior(network.names, ship, **settings.prior)
    return EstimationProblem(
        runs, series_forces(model), mean, spread, process_time=settings.force_time, floor=np.array(settings.floor),
        faults=sensor_faults(settings.delays, settings.offsets), learn_process=settings.learn_force,
        learn_floor=settings.learn_floor, max_process_sd=np.array(settings.force),
        with_speed=settings.force_with_speed and network.feels_wind,
    )  # fmt: skip


def fit_series(
    network: Series, known: Ship, recordings: Sequence[Recording], *,
    settings: ClosedLoopSettings = DEFAULT_SETTINGS, passes: int = 40,
) -> tuple[IdentifiedShip, Estimate]:  # fmt: skip
    """Fit a series to recordings without a trainer: for studies of many of them.

    Args:
        network: The series; its coefficients are set.
        known: The ship's inertia.
        recordings: As they were read, not smoothed.
        settings: How far everything is believed.
        passes: Passes at most.

    Returns:
        The model and the estimate.
    """
    model = IdentifiedShip(known, network, approach_scaling(known))
    problem = explained(model, recordings, settings)
    found = solve(problem, first(problem, process_sd=settings.force), passes=passes)
    _teach(network, problem, found)
    return model, found


def _teach(network: Series, problem: EstimationProblem, found: Estimate, *, done: bool = True) -> None:
    """Give a series its coefficients, and what is known of their errors.

    Errors, and with them members, are as large as stretches disagree; to look at all stretches costs as much as a third
    of a pass, so that a series of one member is told at the end.
    """
    count = problem.shared
    covariance = found.covariance[:count, :count]
    if done or network.members > 1:
        covariance, _ = birge_scaled_covariance(problem, found)
    network.take(*(torch.as_tensor(part) for part in (found.values[:count], covariance, found.noise)))


class ClosedLoopFit(Fit):
    """States at all samples and the coefficients of a series are solved for together (:mod:`.closed_loop`).

    Nothing is differentiated, and nothing is simulated for longer than the ship stays near the recording: the measured
    rudder drives the model from sample to sample, held to the recordings by the noise of each channel, which is
    estimated too. All runs give one set of coefficients with its covariance; an epoch is a Gauss-Newton pass over all.

    Attributes:
        estimate: States, coefficients, noise and covariance after the last pass.
        problem: What they explain.

    Source:
        Bock 1981; Bell 1994; see :mod:`manoeuvre_nn.estimation.closed_loop`.
    """

    made_for = Series
    on_processor = True  # of sparse matrices, run by run: numpy and scipy
    values: Tensor
    covariance: Tensor
    noise: Tensor

    def __init__(self, dynamics: IdentifiedShip, settings: ClosedLoopSettings | None = None) -> None:
        """Set up the method.

        Args:
            dynamics: Known inertia and a series.
            settings: How far equations, sensors and the prior are believed; by default as in
                ``conf/fit/closed_loop.yaml``.
        """
        super().__init__(dynamics, iterations_per_epoch=1)
        self.settings = settings or DEFAULT_SETTINGS
        self.forces = series_forces(dynamics)
        count = self.forces.count
        self.register_buffer("values", torch.zeros(count, dtype=torch.float64))
        self.register_buffer("covariance", torch.zeros(count, count, dtype=torch.float64))
        self.register_buffer("noise", torch.zeros(6, dtype=torch.float64))

    @property
    def network(self) -> Series:
        """The series."""
        assert isinstance(self.dynamics.network, Series)
        return self.dynamics.network

    def configure_optimizers(self) -> None:
        """None: a pass solves for everything at once."""

    def setup(self, stage: str) -> None:
        """Bring the recordings into the form of the estimation."""
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        assert isinstance(data, ManoeuvreData)
        self.problem = explained(self.dynamics, data.measured, self.settings)
        with breakdown_told():
            self.estimate: Estimate = first(self.problem, process_sd=self.settings.force)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep where the estimation is."""
        super().on_save_checkpoint(checkpoint)
        checkpoint[ESTIMATE] = as_stored(self.estimate)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the estimation up again where it was."""
        super().on_load_checkpoint(checkpoint)
        self.estimate = taken_up(self.estimate, checkpoint.get(ESTIMATE))

    @torch.no_grad()
    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """One pass.

        Args:
            batch: Tuples; only the error on them is reported, nothing is learnt from it.
            batch_idx: 0.
        """
        before = self.estimate
        with breakdown_told():
            self.estimate = improve(self.problem, before)
        count = self.forces.count
        self.values.copy_(torch.as_tensor(self.estimate.values[:count]))
        self.covariance.copy_(torch.as_tensor(self.estimate.covariance[:count, :count]))
        self.noise.copy_(torch.as_tensor(self.estimate.noise))
        if at_rest(self.problem, before, self.estimate, self.settings.enough):
            self.stopped = RESTING
        last = bool(self.stopped) or self.trainer.current_epoch + 1 == self.trainer.max_epochs
        _teach(self.network, self.problem, self.estimate, done=last)
        self.log("train/evidence", float(self.estimate.evidence))
        self.log("train/step", self.estimate.moved)
        for channel, sd in zip(CHANNELS, self.estimate.noise, strict=True):
            self.log(f"noise/{channel}", float(sd))
        self.finish(batch, (self.unknown_force(batch[0]) - batch[1]).square().mean())

    @torch.no_grad()
    def relative_rmse(self, inputs: Float[Tensor, "n 4"], targets: Float[Tensor, "n 3"]) -> Float[Tensor, " 3"]:
        """Root mean square of the accelerations that the model lacks over that of all accelerations.

        Args:
            inputs: Not used: g of tuples is differentiated noise, and knows neither shaft speed nor wind.
            targets: Not used.

        Returns:
            For surge, sway and yaw [-].
        """
        lacked, whole = np.zeros(3), np.zeros(3)
        for run, state in zip(self.problem.recordings, self.estimate.states, strict=True):
            columns = self.forces.columns(state[:, :6], run.channels)
            modelled = columns @ self.estimate.values[: self.forces.count]
            lacked += np.square(state[:, 6:]).sum(0)
            whole += np.square(modelled + state[:, 6:]).sum(0)
        return torch.as_tensor(np.sqrt(lacked / np.maximum(whole, 1e-30))).to(inputs)
