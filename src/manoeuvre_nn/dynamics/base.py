"""The equations of motion: state and inputs -> rate of the state, which is what a solver asks of whatever moves."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship


class Model(ABC, nn.Module):
    """Equations of motion in the horizontal plane.

    The state is ``(u, v, r, x, y, psi)`` [m/s, m/s, rad/s, m, m, rad], then states of the model's own.
    """

    @property
    @abstractmethod
    def hull(self) -> Ship:
        """The ship whose inertia, dimensions and propeller hold; for an identified ship its known part."""

    @property
    def particulars(self) -> Particulars:
        """Main dimensions and steering gear of the ship that moves."""
        return self.hull.particulars

    @property
    def own_names(self) -> tuple[str, ...]:
        """Channels of the states that follow u, v, r, x, y, psi: phi and p of a ship that rolls."""
        return ()

    @property
    def noise(self) -> Float[Tensor, " 6"]:
        """Standard deviation that recorded u, v, r, x, y, psi were given in the model's fit [SI]; 0 without one."""
        return torch.zeros_like(self.hull.velocity_units).repeat(2)

    def corrected(self, ship: Ship) -> Ship:
        """A ship as the model's corrections of coefficients change her; she herself where it has none."""
        return ship

    @abstractmethod
    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state.

        Args:
            state: u, v, r, x, y, psi and the model's own states.
            inputs: Rudder, shaft, wind and time.

        Returns:
            Its time derivative.
        """

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """The whole state of a ship on a steady approach.

        Args:
            state: u, v, r, x, y, psi.
            inputs: Rudder, shaft and wind then.

        Returns:
            The same, then the model's own states.
        """
        return state

    @abstractmethod
    def on_approach(self, speed: float) -> "Model":
        """The same ship coming in at another speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            A new model.
        """

    def driven(self, recordings: Sequence[Recording], start: float) -> list[Recording] | None:
        """Runs by recorded controls, of a model that has steps of its own.

        Args:
            recordings: What was recorded.
            start: Time after the first sample at which the model takes over [s].

        Returns:
            A prediction each; None for a model whose state has a rate, which solvers integrate.
        """
        return None

    def steered(self, manoeuvres: Sequence[Manoeuvre], interval: float | None) -> list[Recording] | None:
        """Runs by a helmsman, of a model that has steps of its own.

        Args:
            manoeuvres: What the helmsman does.
            interval: Time between samples [s]; None takes the ship's usual one.

        Returns:
            A run each; None for a model whose state has a rate.
        """
        return None

    def sensitivities(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch k 3"]:
        """What one standard deviation of each uncertain combination of coefficients adds to the accelerations.

        Args:
            state: u, v, r, ...
            inputs: Rudder, shaft, wind and time.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2], one row a combination; no row where the uncertainty is not known.
        """
        return state[..., None, :3][..., :0, :]


class ModelAround(Model):
    """A model that changes the rates of another: the ship and its own states are those of that one.

    Attributes:
        calm: The other model.
    """

    def __init__(self, calm: Model) -> None:
        """Take the model."""
        super().__init__()
        self.calm = calm

    @property
    def hull(self) -> Ship:
        """That of the model."""
        return self.calm.hull

    def corrected(self, ship: Ship) -> Ship:
        """As the model corrects her."""
        return self.calm.corrected(ship)

    @property
    def own_names(self) -> tuple[str, ...]:
        """Those of the model; what is added has no channels."""
        return self.calm.own_names

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """As the model starts."""
        return self.calm.start(state, inputs)


def rate_of_state(
    state: Float[Tensor, "*batch n"], nudot: Float[Tensor, "*batch 3"], *own: Float[Tensor, "*batch k"]
) -> Float[Tensor, "*batch m"]:
    """Rate of the six states of a ship with given accelerations [m/s^2, rad/s^2], then given rates of its own."""
    parts = nudot, kinematics(state[..., :6]), *own
    # Variables first in memory: every operation then runs along whole rows of samples.
    return torch.cat([p.movedim(-1, 0) for p in parts]).movedim(0, -1)


def runge_kutta_step(
    rate: Callable[[Tensor, Any], Tensor], state: Tensor, inputs: tuple[Any, Any, Any], step: Float[Tensor, "*#rows"]
) -> Tensor:
    """The classical fourth-order step, by which rollouts, replays and linearised runs go.

    Fixed steps suit inputs with known kinks, batches whose rows must go together, and derivatives; the solution to a
    tolerance is :func:`~manoeuvre_nn.dynamics.simulate.simulate`.

    ``s + h/6 (k1 + 2 k2 + 2 k3 + k4)``, ``k1 = f(s, i0)``, ``k2 = f(s + h k1/2, i1)``, ``k3 = f(s + h k2/2, i1)``,
    ``k4 = f(s + h k3, i2)``.

    Args:
        rate: State and inputs -> rate of the state: a model.
        state: States.
        inputs: What ``rate`` takes beside the state, at the start, in the middle and at the end of the step.
        step: h [s].

    Returns:
        States at its end.
    """
    now, midway, then = inputs
    half = 0.5 * step
    k1 = rate(state, now)
    k2 = rate(torch.addcmul(state, k1, half), midway)
    k3 = rate(torch.addcmul(state, k2, half), midway)
    k4 = rate(torch.addcmul(state, k3, step), then)
    return torch.addcmul(state, torch.add(k1 + k4, k2 + k3, alpha=2.0), step / 6.0)


def calm_accelerations(
    model: Model,
    nu: Float[Tensor, "*batch 3"],
    delta: Float[Tensor, "..."],
    shaft: Float[Tensor, "..."] | None = None,
) -> Float[Tensor, "*batch 3"]:
    """Accelerations in calm water, upright.

    Args:
        model: A model without effects.
        nu: u, v [m/s], r [rad/s].
        delta: Rudder angle [rad].
        shaft: Shaft speed over the nominal one [-]; None is nominal.

    Returns:
        udot, vdot [m/s^2], rdot [rad/s^2].
    """
    return model(nn.functional.pad(nu, (0, 3 + len(model.own_names))), Inputs(delta, shaft))[..., :3]


def is_fitted(model: Model) -> bool:
    """Whether a model comes from recordings and knows what noise these were given."""
    return bool(model.noise.any())
