"""What an effect is to the rest of the program: physics that a calm-water model leaves out, at one of five sites."""

import copy
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, pi
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship

UNIT_POWERS = {"m": 1.0, "m/s": 0.5, "kN": 3.0}
"""Unit of a parameter -> exponent of length with which its usual size goes."""
SITES = ("inflow", "hull", "force", "actuator", "sensor")
"""Where physics can enter: water velocity, coefficients, added forces, rudder and shaft, what is written down."""
PerRow = Float[Tensor, "*#batch"]
"""One value a row of a batch, or one that holds for several rows."""
Series = Float[Tensor, "rows n"]
"""One value a row of a batch and a time."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: Its name with the unit as suffix where the field writes it so (``from_deg``, ``force_kN``).
        unit: Unit of the values.
        low: Smallest value that is possible at sea, times what ``within`` names.
        high: Largest.
        null: Value at which the effect vanishes; None if another parameter makes it vanish (a direction).
        spread: How large the effect usually is, in the unit, or times what ``within`` names.
        starts: Values from which a fit is tried, likewise.
        period: 360 for directions, None otherwise.
        form: Whether it describes the uncertainty of the formula (a factor on a published curve) rather than the
            effect: it is estimated with its prior and not reported.
        per_run: Whether every run has its own: times of an event, by turns a start and an end, where inf is never; the
            size of what has a null.
        heavy_tailed: Whether its prior is Cauchy's about the null, with the median size of a Gaussian of this spread:
            what goes wrong at sea may be ten times what is usual. Else it is Gaussian, as form parameters always are.
        vector: Whether it is the length of a vector whose direction is another parameter: the vector's prior is the
            bivariate Cauchy with that median, so that no length of 0 is likelier than its neighbours.
        random: Whether it describes a random process, whose course is integrated out; the first such parameter of an
            effect is the size of the process, 0 without one.
        power: Exponent of length with which its usual size goes by Froude's law; None takes that of the unit, and 0 for
            all units but m, m/s and kN: what instruments and helmsmen do is no matter of length.
        within: Dimension of the ship in which all of these are given (``length``, ``beam``, ``draught``: an antenna is
            on board); empty for the unit.
        sides: What a positive value means to a person, and a negative one (``to starboard``, ``to port``); empty where
            the sign needs no words.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None
    spread: float
    starts: tuple[float, ...]
    period: float | None = None
    form: bool = False
    per_run: bool = False
    heavy_tailed: bool = True
    vector: bool = False
    random: bool = False
    power: float | None = None
    within: str = ""
    sides: tuple[str, str] | tuple[()] = ()

    @property
    def is_time(self) -> bool:
        """Whether it is a start or an end of an event in a run."""
        return self.per_run and self.null is None

    def on(self, ship: Particulars) -> "Parameter":
        """The parameter on a ship: by her dimensions, or spread and starts as usual, on models by Froude's law."""
        power = UNIT_POWERS.get(self.unit, 0.0) if self.power is None else self.power
        size = getattr(ship, self.within) if self.within else 1.0
        low, high = self.low * size, self.high * size
        share = size if self.within else float(ship.sized([1.0], [power])[0])
        starts = tuple(start if start == inf else min(max(share * start, low), high) for start in self.starts)
        return replace(self, low=low, high=high, spread=share * self.spread, starts=starts, within="")


@dataclass(frozen=True)
class Situation:
    """What an effect sees; all tensors broadcast against each other over the batch.

    Attributes:
        nu: u, v [m/s], r [rad/s] through the water.
        nudot: udot, vdot [m/s^2], rdot [rad/s^2] in calm water; for an effect with own states, what effects without
            such states add is in it.
        x: Position north [m].
        y: Position east [m].
        psi: Heading, continuous [rad].
        delta: Rudder blade [rad], positive turns to starboard.
        shaft: Shaft speed over the nominal one [-].
        time: Time since the start of the recording [s].
        heel: Recorded heel [rad], its rate [rad/s] and acceleration [rad/s^2]; None if it was not recorded.
    """

    nu: Float[Tensor, "*batch 3"]
    nudot: Float[Tensor, "*batch 3"]
    x: Float[Tensor, "*batch"]
    y: Float[Tensor, "*batch"]
    psi: Float[Tensor, "*batch"]
    delta: Float[Tensor, "*batch"]
    shaft: Float[Tensor, "*batch"]
    time: Float[Tensor, "*batch"]
    heel: Float[Tensor, "*batch 3"] | None = None

    @property
    def u(self) -> Float[Tensor, "*batch"]:
        """Forward speed through the water [m/s]."""
        return self.nu[..., 0]

    @property
    def v(self) -> Float[Tensor, "*batch"]:
        """Sway speed through the water [m/s]."""
        return self.nu[..., 1]

    @property
    def r(self) -> Float[Tensor, "*batch"]:
        """Yaw rate [rad/s]."""
        return self.nu[..., 2]

    def with_(self, **changed: Tensor) -> "Situation":
        """The same with some attributes replaced."""
        return replace(self, **changed)


class Effect(ABC, nn.Module):
    """Physics that a calm-water model leaves out, with named parameters that can be fitted.

    Values are tensors with any leading dimensions that broadcast against a situation's batch, so that one call serves
    many parameter sets: values (k, 1, p) and a situation over n samples give results (k, n, ...). All operations are
    differentiable in values and situation. Effects of the sites inflow, hull and force change the motion and override
    :meth:`stream`, :meth:`acceleration` or :meth:`force`; actuators override :meth:`blade` or have a memory; sensors
    override :meth:`record`. An effect with a *memory* (roll, engine) has states of its own that are integrated with the
    ship.

    Attributes:
        name: Its name in configs and answers.
        site: One of ``SITES``.
        family: What it is mistaken for most easily: effects of one family are told apart last.
        label: Its name in a sentence ("a steady wind").
        equations: What it disturbs: X, Y, N, kinematics, actuator:rudder, actuator:propeller, sensor:<channel>.
        fingerprint: How a naval architect recognises it, one sentence.
        source: Author, year, equation; what deviates.
        declared: Its parameters in order (``parameters`` is torch's own word).
        memory: Number of states of its own.
        candidate: Whether a diagnosis tries it unless it is told what to try.
        fittable: Whether a diagnosis can find its parameters on demand: not those of one realisation of many, nor what
            is learnt or estimated beside every hypothesis.
        acts_indoors: Whether it can act on a model in a closed tank.
        exclusive: Effects with the same word here are one thing in two forms and never stand beside each other; empty
            for an effect that may stand beside any other.
        variant_of: Name of the simpler effect that this one is with another course in time, and instead of which it is
            tried where that one leads.
        measured_by: What to measure directly where no run tells it from its family; empty for the family's name.
        ship: The ship that it acts on.
        values: Parameter values in the parameters' units.
    """

    name: ClassVar[str]
    site: ClassVar[str]
    family: ClassVar[str]
    label: ClassVar[str]
    equations: ClassVar[tuple[str, ...]]
    fingerprint: ClassVar[str]
    source: ClassVar[str]
    declared: ClassVar[tuple[Parameter, ...]]
    memory: ClassVar[int] = 0
    candidate: ClassVar[bool] = False
    fittable: ClassVar[bool] = True
    acts_indoors: ClassVar[bool] = True
    exclusive: ClassVar[str] = ""
    variant_of: ClassVar[str] = ""
    measured_by: ClassVar[str] = ""

    values: Tensor

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Set the values; those not given are the first start of each parameter, or the null of a form parameter.

        Args:
            ship: The ship that it acts on.
            values: Parameter = value in its unit.

        Raises:
            InputError: If a parameter is unknown or out of its bounds, or a force has no formula.
        """
        super().__init__()
        if self.site == "force" and not self.overrides("force", "acceleration"):
            raise InputError(f"effect.{self.name} acts as a force and says none: write its force() or acceleration()")
        self._ship = [ship]  # in a list, so that the ship's tensors are not counted as the effect's
        if "declared" not in vars(self):
            self.declared = tuple(p.on(ship.particulars) for p in self.declared)  # type: ignore[misc]
        known = {p.name: p for p in self.declared}
        self._column = {p.name: k for k, p in enumerate(self.declared)}
        for key, value in values.items():
            if key not in known:
                raise InputError(f"effect.{self.name}.{key}: unknown parameter; {self.name} has {', '.join(known)}")
            p = known[key]
            if not (p.low <= value <= p.high or (p.is_time and value == inf)):
                raise InputError(f"effect.{self.name}.{key}={value:g}: expected {p.low:g} to {p.high:g} {p.unit}")
        given = [values.get(p.name, p.starts[0] if p.null is None or not p.form else p.null) for p in self.declared]
        self.register_buffer("values", ship.inertia.new_tensor(given))

    @property
    def ship(self) -> Ship:
        """The ship that it acts on."""
        return self._ship[0]

    @property
    def random(self) -> tuple[str, ...]:
        """Names of the parameters of its random process, the size first; empty for an effect without one."""
        return tuple(p.name for p in self.declared if p.random)

    @property
    def timed(self) -> list[int]:
        """Columns of the times between which an event acts in a run; empty for an effect that acts throughout."""
        return [column for column, p in enumerate(self.declared) if p.is_time]

    def steady(self, values: Float[np.ndarray, "*rows p"]) -> Float[np.ndarray, "*rows p"]:
        """Values with the random process left out: its size is 0."""
        size = self.random[:1]
        return np.where([p.name in size for p in self.declared], 0.0, values)

    def overrides(self, *methods: str) -> bool:
        """Whether the effect has one of its own of some methods by which an effect does nothing."""
        return any(getattr(type(self), name) is not getattr(Effect, name) for name in methods)

    def drawn(self, rows: int, generator: torch.Generator) -> "Effect":
        """The same effect with a random course of its own for every row of a batch; itself where nothing is random."""
        return self

    def at(self, values: Float[Tensor, "*rows p"]) -> "Effect":
        """The same effect with other values [parameters' units]; the copy shares everything else."""
        made = copy.copy(self)
        made._buffers = {**self._buffers, "values": values}
        return made

    def value(self, name: str) -> Float[Tensor, "*rows"]:
        """Value(s) of a parameter, in its unit."""
        return self.values[..., self._column[name]]

    def angle(self, name: str) -> Float[Tensor, "*rows"]:
        """Value(s) of a parameter in degrees, as radians."""
        return self.value(name) * (pi / 180.0)

    def aboard(self, ship: Ship) -> "Effect":
        """The same effect with the same values and choices on another ship."""
        if ship is self.ship:
            return self
        moved = self.at(self.values)
        moved._ship = [ship]
        return moved

    def null(self) -> Float[Tensor, " p"]:
        """Values at which the effect vanishes; the first start where a parameter has none."""
        return self.values.new_tensor([p.starts[0] if p.null is None else p.null for p in self.declared])

    def stream(self, s: Situation) -> Float[Tensor, "*batch 2"]:
        """Velocity of the water over ground, north and east [m/s]; inflow effects override it."""
        return torch.zeros_like(s.nu[..., :2])

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"] | None:
        """X, Y [N], N [N m] in body axes about midship; None for an effect that is not known as an external force."""
        return None

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """What the effect adds to udot, vdot [m/s^2], rdot [rad/s^2]: by default what its :meth:`force` causes."""
        force = self.force(s)
        return torch.zeros_like(s.nu) if force is None else self.ship.acceleration_from_si(force)

    def with_changed_inertia(self, s: Situation, nudot: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """What other forces cause on the ship as this effect changes her; effects on her inertia override it.

        Args:
            s: The situation.
            nudot: What they would cause on the ship as she is [m/s^2, rad/s^2].

        Returns:
            What they cause: half as much on a ship of twice the mass.
        """
        return nudot

    def changed_terms(self) -> Float[Tensor, "terms 3 3"] | None:
        """What it adds to the terms of the ship's series where it multiplies terms; effects that do override it.

        Returns:
            A matrix for every term, at one row of values: what is added to X', Y', N' (columns) by the term's own X',
            Y', N' (rows). None if it multiplies no term.
        """
        return None

    def heeling(self, s: Situation) -> Float[Tensor, "*batch"]:
        """Moment about the longitudinal axis that acts on a ship that rolls [N m], positive to starboard."""
        return torch.zeros_like(s.u)

    def memory_at_start(self, s: Situation) -> Float[Tensor, "*batch m"]:
        """Own states on a steady approach, one column each."""
        return s.nu.new_zeros(*s.nu.shape[:-1], self.memory)

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch m"]:
        """Rate of the effect's own states."""
        return torch.zeros_like(memory)

    def shaft(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch"]:
        """Shaft speed over the one that was ordered [-]; engine effects override it."""
        return torch.ones_like(s.delta)

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """Angle of the rudder blade after a time in which the indicator moved evenly; rudder effects override it.

        Args:
            before: Blade angle at the start of the time [rad].
            order: Helm order during it [rad].
            shown: Indicated angle at its end [rad].
            elapsed: The time [s].

        Returns:
            Blade angle at its end [rad].
        """
        return shown

    def blade_in_turn(self, start: Float[Tensor, "rows 1"], order: Series, shown: Series, elapsed: Series) -> Series:
        """Angle of the blade at the end of each of several times that follow each other, as :meth:`blade` has it.

        Effects override it where they can do without a step for every time.

        Args:
            start: Blade angle before the first [rad].
            order: Helm order during each [rad].
            shown: Indicated angle at the end of each [rad].
            elapsed: How long each lasts [s].

        Returns:
            Blade angles [rad].
        """
        angles = [start]
        for now in zip(order.unbind(-1), shown.unbind(-1), elapsed.unbind(-1), strict=True):
            angles.append(self.blade(angles[-1], *(a[:, None] for a in now)).expand_as(start))
        return torch.cat(angles[1:], dim=-1)

    def indicated(
        self, recorded: Float[Tensor, "*batch n"], ordered: Float[Tensor, " n"] | None, time: Float[Tensor, " n"]
    ) -> Float[Tensor, "*batch n"]:
        """True indicator angle behind a recorded one, the inverse of :meth:`record` for the rudder channel.

        Effects that make the recorded rudder late or early override it.

        Args:
            recorded: Recorded rudder angle [rad].
            ordered: Where the nominal gear has the rudder by the recorded orders [rad]; None if none was recorded.
            time: Sample times [s].

        Returns:
            What the indicator showed at these times [rad].
        """
        return recorded

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """What the recorder writes; sensor effects override it.

        Channels are x, y [m], vn, ve (velocity over ground, north and east) [m/s], psi [rad], r [rad/s], u_log [m/s]
        and, where recorded, delta [rad] and n [-]; u, v over ground follow from vn, ve and the *recorded* psi.

        Args:
            channels: What perfect sensors would write.
            s: The situation, time in its last batch dimension.

        Returns:
            All channels, some changed.
        """
        return dict(channels)
