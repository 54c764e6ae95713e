"""A ship whose coefficients were corrected a little: the same series, other numbers."""

from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.model import Dynamics


class Calibrated(Dynamics):
    """A calm-water model with relative corrections of its coefficients and inertias.

    Attributes:
        calm: The model; its hull's forces are ``products @ table``.
    """

    factors: Tensor
    inertia: Tensor

    def __init__(self, calm: Dynamics, factors: Float[Tensor, "terms 3"], inertia: Float[Tensor, " 3"]) -> None:
        """Store the corrections.

        Args:
            calm: The model.
            factors: Relative correction of every coefficient [-].
            inertia: Relative correction of the inertia in surge, sway and yaw, added masses included [-].
        """
        super().__init__()
        self.calm = calm
        self.register_buffer("factors", factors)
        self.register_buffer("inertia", inertia)

    @property
    def particulars(self) -> Particulars:
        """Those of the model."""
        return self.calm.particulars

    @property
    def hull(self) -> Ship:
        """That of the model."""
        return self.calm.hull

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations with the corrected coefficients.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        table = self.hull.table
        assert table is not None
        more = self.hull.products(nu, delta) @ (table * self.factors)
        corrected = self.calm.acceleration(nu, delta) + self.hull.acceleration_from_force(nu, more)
        return corrected * (1 - self.inertia)

    def on_approach(self, speed: float) -> "Calibrated":
        """The corrected ship at another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return Calibrated(self.calm.on_approach(speed), self.factors, self.inertia)
