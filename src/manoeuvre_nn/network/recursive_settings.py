"""Shape of a recursive network, and the constants of its force modules."""

from collections.abc import Sequence
from dataclasses import dataclass

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Derivative, Factor, Weight

FREEDOMS = {3: ("u", "v", "r"), 4: ("u", "v", "p", "r"), 6: ("u", "v", "w", "p", "q", "r")}
"""Number of degrees of freedom -> the velocities that are predicted, in u, v and w over U0 and rates over U0/L."""
EVEN = ("u", "w", "q")
"""Velocities that stay when port and starboard change places; the others change sign."""
STEP = 0.09
"""Time step of the source over L/U."""


@dataclass(frozen=True)
class ForceSettings:
    """Constants of the force modules that are no ship's particulars.

    Attributes:
        thrust: c1 and c2 of ``K_T = c1 + c2 J`` [-]; the source's ship 1.
        wake: Wake fraction [-].
        deduction: Thrust deduction [-].
        diameter: Diameter of one propeller over the draught [-].
        aspect: Height of a rudder squared over its area [-].
    """

    thrust: Sequence[Derivative] = (0.6, -0.4)
    wake: float = 0.2
    deduction: float = 0.1
    diameter: Factor = 0.55
    aspect: Factor = 1.8

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range.
        """
        if len(self.thrust) != 2:
            raise InputError(f"network.forces.thrust={list(self.thrust)}: expected two numbers, c1 and c2")
        for name in ("diameter", "aspect"):
            if not getattr(self, name) > 0:
                raise InputError(f"network.forces.{name}={getattr(self, name)}: expected a number more than 0")
        for name in ("wake", "deduction"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"network.forces.{name}={getattr(self, name)}: expected a fraction from 0 to below 1")


@dataclass(frozen=True)
class RecursiveSettings:
    """Shape of a recursive network.

    Attributes:
        freedom: Degrees of freedom: 3 (u, v, r), 4 (with p) or 6 (with w and q, the source's).
        hidden: Nodes of each hidden layer.
        biases: Whether the hidden nodes have a bias; output nodes have none.
        past: Past values of lift and moments that are kept.
        past_thrust: Past values of thrust, and of the wind's forces.
        wind: Whether it takes force and moment of the recorded true wind.
        wind_nodes: Whether these go through the hidden nodes as the other forces do; else they act on the output nodes
            alone, by a weight each.
        about_last: Whether output nodes work about the last outputs: the network gives the change, and where it gives
            nothing, velocities stay; else it gives the velocities, as in the source.
        symmetric: Whether port and starboard are alike: the answer is the mean of the network's and its mirror image's.
        margin: How far outputs may go beyond the data, over half their range [-].
        step: Time step over L/U [-].
    """

    freedom: int = 4
    hidden: Sequence[int] = (54, 54)
    biases: bool = True
    past: int = 7
    past_thrust: int = 1
    wind: bool = False
    wind_nodes: bool = False
    about_last: bool = True
    symmetric: bool = True
    margin: Weight = 0.3
    step: float = STEP

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range.
        """
        check_choice("network.freedom", str(self.freedom), [str(count) for count in FREEDOMS])
        layers = list(self.hidden) if isinstance(self.hidden, Sequence) else []
        if not layers or not all(isinstance(nodes, int) and nodes > 0 for nodes in layers):
            raise InputError(f"network.hidden={self.hidden}: expected a list, the nodes of each layer: [54,54]")
        if not 0 <= self.past_thrust <= self.past:
            raise InputError(
                f"network.past_thrust={self.past_thrust}, network.past={self.past}: expected 0 <= past_thrust <= past"
            )
        if not 0 < self.step <= 1:
            raise InputError(f"network.step={self.step}: expected a time step over L/U, more than 0 and at most 1")
        if not self.margin >= 0:
            raise InputError(f"network.margin={self.margin}: expected a share of the range, at least 0")

    @property
    def velocities(self) -> tuple[str, ...]:
        """What is predicted."""
        return FREEDOMS[self.freedom]

    @property
    def long_kept(self) -> tuple[str, ...]:
        """Forces whose past values are kept for long."""
        rolls, pitches = "p" in self.velocities, "q" in self.velocities
        return ("lift_starboard", "lift_port", *["K"] * rolls, *["M"] * pitches, "N")

    @property
    def columns(self) -> tuple[str, ...]:
        """Forces of one step, in their order."""
        wind = ("wind_X", "wind_Y", "wind_N") if self.wind else ()
        return ("thrust_starboard", "thrust_port", *self.long_kept, *wind)
