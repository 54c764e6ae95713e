"""State and rudder -> rate of state: what a solver asks of whatever moves."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars, Ship


class Dynamics(ABC, nn.Module):
    """Equations of motion in the horizontal plane.

    The state is ``(u, v, r, x, y, psi)`` [m/s, m/s, rad/s, m, m, rad], then ``memory`` states of the model's own. The
    helm gives an order and the angle that the rudder indicator shows; a ship in calm water has its blade there.
    """

    @property
    def memory(self) -> int:
        """Number of states beyond the six of the ship."""
        return 0

    @property
    @abstractmethod
    def particulars(self) -> Particulars:
        """Main dimensions and steering gear of the ship that moves."""

    @abstractmethod
    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations in body axes.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """

    def at_shaft(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """Accelerations at a shaft speed: by the hull's own rule, unless the model has learnt what it does.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].
            shaft: Shaft speed over the nominal one [-].

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        extra = self.hull.acceleration_from_force(nu, self.hull.shaft_force(nu, delta, shaft))
        return self.acceleration(nu, delta) + extra

    def doubts(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch k 3"]:
        """What the model's coefficients may add, where it has been fitted and knows how well.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].
            shaft: Shaft speed over the nominal one [-].

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2] by one standard error of each independent combination; no row where
            nothing is known.
        """
        del delta, shaft
        return nu[..., None, :][..., :0, :]

    @property
    def noise(self) -> Float[Tensor, " 6"]:
        """Standard deviation that recorded u, v, r, x, y, psi were given in the model's fit [SI]; 0 without one."""
        return torch.zeros_like(self.hull.velocity_units).repeat(2)

    @property
    def fitted(self) -> bool:
        """Whether the model comes from recordings and knows what noise these were given."""
        return bool(self.noise.any())

    def turns(self, time: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"] | None:
        """Recorded shaft speed over the nominal one, where the model is bound to a recording's; else None.

        Args:
            time: Time since the start of the recording [s].

        Returns:
            Shaft speed [-], or None: it is nominal.
        """
        del time
        return None

    @abstractmethod
    def on_approach(self, speed: float) -> "Dynamics":
        """The same ship coming in at another speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """

    @property
    @abstractmethod
    def hull(self) -> Ship:
        """The ship whose inertia, dimensions and propeller hold; for an identified ship its known part."""

    def forward(
        self,
        state: Float[Tensor, "*batch 6"],
        delta: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"] | None = None,
    ) -> Float[Tensor, "*batch 6"]:
        """Rate of the state.

        Args:
            state: u, v, r, x, y, psi.
            delta: Rudder angle [rad].
            time: Time since the start [s]; nothing in calm water depends on it.

        Returns:
            Its time derivative.
        """
        del time
        parts = self.acceleration(state[..., :3], delta), kinematics(state)
        # Variables first in memory: every operation then runs along whole rows of samples.
        return torch.cat([p.movedim(-1, 0) for p in parts]).movedim(0, -1)

    def driven(self, recordings: Sequence[Recording], times: Sequence[Float[np.ndarray, " _"]]) -> "Dynamics":
        """The same model in what recordings say of shaft speed and wind: nothing, unless it has learnt of them.

        Args:
            recordings: One for each row of a batch.
            times: Even times of each row; all have the same interval.

        Returns:
            Dynamics for these rows.
        """
        del recordings, times
        return self

    def row(self, number: int) -> "Dynamics":
        """What moves one row of a batch that is :meth:`driven`, for states of that row at many times.

        Args:
            number: Number of the row.

        Returns:
            The same model unless it is driven.
        """
        del number
        return self

    def start(self, state: Float[Tensor, "*batch 6"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch n"]:
        """The whole state of a ship on a steady approach.

        Args:
            state: u, v, r, x, y, psi.
            delta: Angle of the rudder blade [rad].

        Returns:
            The same, then the model's own states.
        """
        del delta
        return state

    def blade(
        self,
        before: Float[Tensor, "*batch k"],
        order: Float[Tensor, "*batch"],
        shown: Float[Tensor, "*batch"],
        elapsed: Float[Tensor, "*batch"],
    ) -> Float[Tensor, "*batch k"]:
        """Rudder angles behind the indicator after a time in which it moved evenly; the last is that of the blade.

        Args:
            before: The angles at the start of the time [rad].
            order: Helm order during it [rad].
            shown: Indicated angle at its end [rad].
            elapsed: The time [s].

        Returns:
            The angles at its end [rad].
        """
        del before, order, elapsed
        return shown[..., None]

    def blade_at_rest(self, delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch k"]:
        """What :meth:`blade` tends to when the helm has stood still for long.

        Args:
            delta: Order and indicated angle [rad].

        Returns:
            The angles behind the indicator [rad].
        """
        return delta[..., None]

    def indicated(self, recorded: Float[Tensor, "*batch n"], time: Float[Tensor, " n"]) -> Float[Tensor, "*batch n"]:
        """What the rudder indicator showed, from what the recorder wrote: the same in calm water.

        Args:
            recorded: Recorded rudder angle [rad].
            time: Sample times since the start of the recording [s].

        Returns:
            Indicated angle at these times [rad].
        """
        del time
        return recorded

    def recorded(
        self,
        states: Float[Tensor, "*batch n"],
        shown: Float[Tensor, "*batch"],
        blade: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"],
    ) -> dict[str, Tensor]:
        """Channels that a recorder writes otherwise than they were, or beside them: none in calm water.

        Args:
            states: Whole states over time.
            shown: Indicated rudder angle [rad].
            blade: Angle of the rudder blade [rad].
            time: Time since the start of the recording [s].

        Returns:
            Channel -> samples.
        """
        del states, shown, blade, time
        return {}
