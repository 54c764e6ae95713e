"""A force that no name stands for, as a short formula in the motion, the rudder, the heading, time and place."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import pi
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.effect.common import in_tight_turns, typical

Motion = dict[str, Tensor]
MOTIONS: dict[str, Callable[[Motion], Tensor]] = {
    "1": lambda z: torch.ones_like(z["r"]),
    "u": lambda z: z["u"],
    "v": lambda z: z["v"],
    "r": lambda z: z["r"],
    "d": lambda z: z["d"],
    "|v|": lambda z: z["v"].abs(),
    "|r|": lambda z: z["r"].abs(),
    "|d|": lambda z: z["d"].abs(),
    "v|v|": lambda z: z["v"] * z["v"].abs(),
    "r|r|": lambda z: z["r"] * z["r"].abs(),
    "r^2": lambda z: z["r"] ** 2,
    "r^3": lambda z: z["r"] ** 3,
    "v|r|": lambda z: z["v"] * z["r"].abs(),
    "|v||r|": lambda z: (z["v"] * z["r"]).abs(),
    "u|r|": lambda z: z["u"] * z["r"].abs(),
    "u v": lambda z: z["u"] * z["v"],
    "u r": lambda z: z["u"] * z["r"],
}
"""Factors that depend on the motion."""
TURNING = ("1", "r", "|r|", "r|r|", "r^3")
"""Those that may be multiplied with the heading."""
HEADINGS: dict[str, Callable[[Tensor], Tensor]] = {
    "cos psi": torch.cos,
    "sin psi": torch.sin,
    "cos 2psi": lambda psi: torch.cos(2 * psi),
    "sin 2psi": lambda psi: torch.sin(2 * psi),
    "cos 3psi": lambda psi: torch.cos(3 * psi),
    "sin 3psi": lambda psi: torch.sin(3 * psi),
}
"""Factors that depend on the heading."""
RUDDER = "rudder "
"""How a term of the rudder begins."""
BUMPS = (6.0, 11.0, 16.0, 21.0, 28.0)
"""Rudder angles about which the rudder alone may be strange [deg]."""
HALF_WIDTH_DEG = 5.0
"""Half width of such a range [deg]."""
RUDDERS: dict[str, Callable[[Tensor], Tensor]] = {"to starboard": torch.relu, "to port": lambda d: -torch.relu(-d)}
"""Angles that the rudder may act at besides the one shown."""
RUDDERS |= {
    f"at {middle:.0f} deg": lambda d, middle=middle: (  # type: ignore[misc]
        d * torch.relu(1 - (d.abs() - middle * DEGREE).abs() / (HALF_WIDTH_DEG * DEGREE))
    )
    for middle in BUMPS
}


LAG, PERIODIC, BY_RUN, STRIPES, GROWING = "lag", "periodic", "periodic_by_run", "stripes", "t"
"""Marks of terms that follow the motion late, come again in time (alike from the start of every recording, or with a
phase and a size of its own in each run, as waves do) or over the sea, or grow with time."""
LAGGED = ("r", "v", "d", "|r|", "|v|", "|d|")
"""Motions that a force may follow late: those without a magnitude in sway and yaw, the others in surge."""
GROWN = ("1", "r", "d", "|r|")
"""Factors that may grow with time."""
SCALES: dict[str, tuple[Parameter, ...]] = {
    LAG: (Parameter("memory_s", "s", 1.0, 3000.0, None, 60.0, (30.0,)),),
    **dict.fromkeys((PERIODIC, BY_RUN), (Parameter("period_s", "s", 4.0, 6000.0, None, 20.0, (60.0,)),)),
    STRIPES: (
        Parameter("north_per_km", "1/km", -20.0, 20.0, None, 0.5, (1.0,)),
        Parameter("east_per_km", "1/km", -20.0, 20.0, None, 0.5, (0.0,)),
    ),
}
"""Mark -> what all terms with it share: time constant, period, waves a kilometre north and east."""
RELATIVE_SPREADS = {"memory_s": 0.5, "period_s": 0.005}
"""How far it is from where it starts, usually: a peak of a periodogram is known to a part of a turn over many turns."""

MAX_WEIGHT = 100.0
"""Bound of a weight: a high power of a gentle motion is small."""


SENSOR = "sensor "
"""How a term of an instrument begins."""
DRIFT_TIME_S = 600.0
"""Time that a drift is told for [s]."""
INSTRUMENTS: dict[str, tuple[str, ...]] = {
    "north": ("t^2",),
    "east": ("t^2",),
    "psi": ("1", "r", "t", "t^2", "cos psi", "sin psi", "cos 2psi", "sin 2psi"),
    "r": ("r", "|r|", "t"),
    "u_log": ("1", "u", "v", "|v|", "|r|", "t", "cos psi", "sin psi", "cos 2psi", "sin 2psi"),
}
"""Errors of instruments beside those that have a name; one of the log is a share of the speed, one of the satellite
receiver is in its position and, as its rate, in its velocity: a drift that grows, since a steady one is a current."""
RECEIVER = {"north": ("x", "vn"), "east": ("y", "ve")}


def library() -> tuple[str, ...]:
    """All terms that a formula is made of: ``X r^2``, ``N r|r| cos 2psi``, ``rudder to port``, ..."""
    turning = (f"{motion} {heading}" for motion, heading in product(TURNING, HEADINGS))
    shapes = [*MOTIONS, *turning]
    forces = (f"{equation} {shape}" for equation in "XYN" for shape in shapes)
    errors = (f"{SENSOR}{channel} {shape}" for channel, made in INSTRUMENTS.items() for shape in made)
    return (*forces, *(RUDDER + name for name in RUDDERS), *errors, *in_time())


def in_time() -> tuple[str, ...]:
    """Terms that remember, come again or grow: ``N lag r``, ``N sin periodic``, ``Y cos stripes``, ``N r t``."""
    late = [f"{e} {LAG} {m}" for e in "XYN" for m in LAGGED if (e == "X") == m.startswith("|")]
    again = [f"{e} {wave} {mark}" for e in "XYN" for mark in (PERIODIC, BY_RUN, STRIPES) for wave in ("cos", "sin")]
    grown = [f"{e} {GROWING}" if m == "1" else f"{e} {m} {GROWING}" for e in "XYN" for m in GROWN]
    return (*late, *again, *grown)


def mark_of(term: str) -> str:
    """Which of ``lag``, ``periodic``, ``periodic_by_run``, ``stripes`` and ``t`` a term bears; else empty."""
    words = set() if term.startswith(SENSOR) else set(term.split(" ")[1:])
    return next(iter(words & {*SCALES, GROWING}), "")


def is_ordinary(term: str) -> bool:
    """Whether a calm-water model may have the term, alike to both sides: even terms of X, odd ones of Y and N."""
    equation, _, shape = term.partition(" ")
    odd = shape in ("v", "r", "d", "v|v|", "r|r|", "r^3", "v|r|", "u v", "u r")
    even = shape in MOTIONS and not odd  # terms in time are neither
    return even if equation == "X" else odd and equation in ("Y", "N")


def places_of(term: str) -> tuple[str, ...]:
    """Where a term acts: X, Y, N, actuator:rudder or sensor:<channel>; a receiver errs in no direction of its own."""
    kind, channel, *_ = term.split(" ")
    written = [position for position, _ in RECEIVER.values()] if channel in RECEIVER else [channel]
    return {"rudder": ("actuator:rudder",), "sensor": tuple(f"sensor:{c}" for c in written)}.get(kind, (kind,))


def growth_of(term: str) -> tuple[float, str]:
    """What of its weight, which it has after ``DRIFT_TIME_S``, a growing term has after a minute, and its unit."""
    shape = term.split(" ")[-1]
    power = {GROWING: 1, f"{GROWING}^2": 2}.get(shape, 0)
    return (60 / DRIFT_TIME_S) ** power, ("", "/min", "/min^2")[power]


class Formula(Effect):
    """A sum of terms, each with a weight.

    A term of X weighs in units of the resistance, one of Y or N in those of the force of 20 deg of rudder, the motion
    in units of a tight turn; one of the rudder says by which share of the shown angle it acts as if further over.

    A term that follows the motion late has a state of its own, ``m' = (z - m) / memory_s``; what comes again does so
    with ``cos`` and ``sin`` of ``2 pi t / period_s`` or of ``2 pi (x north_per_km + y east_per_km) / 1000``; what grows
    has its weight after ``DRIFT_TIME_S``. Time counts from the start of the recording. The weights of what has its own
    phase in each run are each run's own.

    Attributes:
        terms: The terms, of :func:`library`.
        memory: Number of terms that follow late.
    """

    name = "formula"
    fittable = False
    site = "force"
    family = "formula"
    label = "a force without a name"
    equations = ("X", "Y", "N")
    fingerprint = "A force that motion, rudder or heading decide, and that no effect of the shelf has."
    source = "Terms chosen by the recordings; nothing known"
    declared: ClassVar[tuple[Parameter, ...]] = ()

    def __init__(
        self,
        ship: Ship,
        terms: Sequence[str] = ("N r|r|",),
        spreads: Sequence[float] | None = None,
        scales: Mapping[str, float] | None = None,
        **values: Endless,
    ) -> None:
        """Take terms.

        Args:
            ship: The ship that it acts on.
            terms: Terms of :func:`library`.
            spreads: Prior standard deviation of every weight; None takes 0.3.
            scales: Where memory, period and waves a kilometre start, by name.
            values: ``w1``, ``w2``, ...: their weights [-].

        Raises:
            InputError: If a term is unknown.
        """
        for term in terms:
            if term not in library():
                raise InputError(f"effect.formula.terms: {term!r} is unknown; write for instance 'N r|r| cos 2psi'")
        self.terms = tuple(terms)
        marks = [mark_of(term) for term in terms]
        weight = Parameter("", "-", -MAX_WEIGHT, MAX_WEIGHT, 0.0, 0.0, (), heavy_tailed=False)
        self.declared = tuple(  # type: ignore[misc]
            replace(weight, name=f"w{k + 1}", spread=spread, starts=(0.1 * spread,), per_run=mark == BY_RUN)
            for k, (mark, spread) in enumerate(zip(marks, spreads or [0.3] * len(terms), strict=True))
        )
        self.memory = marks.count(LAG)  # type: ignore[misc]
        started = scales or {}
        for p in dict.fromkeys(p for mark, shared in SCALES.items() if mark in marks for p in shared):
            start = started.get(p.name, p.starts[0])
            spread = RELATIVE_SPREADS.get(p.name, 0.0) * abs(start) or p.spread
            self.declared += (replace(p, starts=(start,), spread=spread),)  # type: ignore[misc]
        super().__init__(ship, **values)
        self.register_buffer("size", typical(ship))

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """The sum of the terms."""
        total = torch.zeros_like(s.nu)
        for k, term in enumerate(self.terms):
            if not term.startswith((RUDDER, SENSOR)):
                total = total + self.values[..., k, None] * self._force(term, s, memory)
        return total + self._of_rudder(self._further(s), s)[0] if self._steers else total

    def heeling(self, s: Situation) -> Float[Tensor, "*batch"]:
        """That of a rudder which acts as if it were further over; forces act where they do not heel the ship."""
        return self._of_rudder(self._further(s), s)[1] if self._steers else super().heeling(s)

    @property
    def _steers(self) -> bool:
        """Whether a term is one of the rudder."""
        return any(term.startswith(RUDDER) for term in self.terms)

    def _further(self, s: Situation) -> Float[Tensor, "*batch"]:
        """By which angle the rudder acts as if it were further over [rad]."""
        angle = torch.zeros_like(s.delta)
        for k, term in enumerate(self.terms):
            if term.startswith(RUDDER):
                angle = angle + self.values[..., k] * RUDDERS[term.removeprefix(RUDDER)](s.delta)
        return angle

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Add the errors of instruments."""
        written = dict(channels)
        for k, term in enumerate(self.terms):
            if term.startswith(SENSOR):
                for channel, error in self._errors(term, s).items():
                    written[channel] = written[channel] + self.values[..., k] * error
        return written

    def memory_at_start(self, s: Situation) -> Float[Tensor, "*batch m"]:
        """What is followed, as it is on the approach."""
        return self._followed(s) if self.memory else super().memory_at_start(s)

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch m"]:
        """``(z - m) / memory_s``."""
        return (self._followed(s) - memory) / self.value("memory_s")[..., None] if self.memory else 0 * memory

    def _followed(self, s: Situation) -> Float[Tensor, "*batch m"]:
        """Motion that is followed late, one column a term."""
        z = in_tight_turns(self.ship, s)
        late = [MOTIONS[t.split(" ")[-1]](z) for t in self.terms if mark_of(t) == LAG]
        return torch.stack(torch.broadcast_tensors(*late), dim=-1)

    def unit_of(
        self, term: str, s: Situation, memory: Float[Tensor, "*batch m"] | None = None
    ) -> tuple[Float[Tensor, "*batch 3"], dict[str, Tensor]]:
        """What a small weight of a term adds, over the weight: accelerations, and errors of channels."""
        if term.startswith(SENSOR):
            return torch.zeros_like(s.nu), self._errors(term, s)
        if term.startswith(RUDDER):
            return self._of_unit(term, s)[0], {}
        return self._force(term, s, memory), {}

    def heeling_of_unit(self, term: str, s: Situation) -> Float[Tensor, "*batch"]:
        """Heeling moment that goes with the accelerations of :meth:`unit_of` [N m]."""
        return self._of_unit(term, s)[1] if term.startswith(RUDDER) else torch.zeros_like(s.u)

    def _of_unit(self, term: str, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
        """What a small weight of a term of the rudder does, over the weight."""
        small = 1e-3
        force, heeling = self._of_rudder(small * RUDDERS[term.removeprefix(RUDDER)](s.delta), s)
        return force / small, heeling / small

    def unit_of_weight(self, term: str) -> tuple[float, str]:
        """What a weight of one is of the rudder or an instrument, in the unit that is told."""
        if term.startswith(RUDDER):
            return 1.0, "deg/deg"
        p, channel = self.ship.particulars, term.split(" ")[1]
        sizes = {
            "psi": (5.0, "deg"),
            "r": (0.1 * p.speed / p.length / DEGREE, "deg/s"),
            "u_log": (0.1 * p.speed, "m/s"),
        }
        return sizes.get(channel, (0.2 * p.length, "m"))

    def _errors(self, term: str, s: Situation) -> dict[str, Float[Tensor, "*batch"]]:
        """Channel -> its error for a weight of one."""
        _, channel, shape = term.split(" ", maxsplit=2)
        p, late = self.ship.particulars, s.time / DRIFT_TIME_S
        if channel in RECEIVER:
            position, velocity = RECEIVER[channel]
            return {position: 0.2 * p.length * late**2, velocity: 0.4 * p.length / DRIFT_TIME_S * late}
        size, unit = self.unit_of_weight(term)
        size *= DEGREE if unit.startswith("deg") else 1.0
        drifts = {"t": late, "t^2": late**2}
        if shape in drifts:
            return {channel: size * drifts[shape]}
        value = HEADINGS[shape](s.psi) if shape in HEADINGS else MOTIONS[shape](in_tight_turns(self.ship, s))
        return {channel: size * value * (s.u / p.speed if channel == "u_log" and shape in HEADINGS else 1.0)}

    def _of_rudder(
        self, angle: Float[Tensor, "*batch"], s: Situation
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
        """What a rudder does that acts as if it were further over by an angle."""
        nu, delta = s.nu.expand(*angle.shape, 3), s.delta.expand(angle.shape)
        return self.ship.by_rudder(nu, delta + angle, delta)

    def _force(self, term: str, s: Situation, memory: Tensor | None) -> Float[Tensor, "*batch 3"]:
        """A term's acceleration for a weight of one."""
        equation, _, shape = term.partition(" ")
        value = self._in_time(term, shape, s, memory) if mark_of(term) else self._of_motion(shape, s)
        return value[..., None] * self.get_buffer("size") * value.new_tensor([e == equation for e in "XYN"])

    def _of_motion(self, shape: str, s: Situation) -> Float[Tensor, "*batch"]:
        """A factor of the motion, or one of the motion and one of the heading."""
        motion, _, heading = (shape, "", "") if shape in MOTIONS else shape.partition(" ")
        return MOTIONS[motion](in_tight_turns(self.ship, s)) * (HEADINGS[heading](s.psi) if heading else 1.0)

    def _in_time(self, term: str, shape: str, s: Situation, memory: Tensor | None) -> Float[Tensor, "*batch"]:
        """A factor that remembers, comes again or grows."""
        mark, motion = mark_of(term), shape.partition(" ")[0]
        if mark == LAG:
            if memory is None:
                raise ValueError(f"{term}: its memory is needed")
            return memory[..., [t for t in self.terms if mark_of(t) == LAG].index(term)]
        if mark == GROWING:
            return self._of_motion("1" if motion == GROWING else motion, s) * s.time / DRIFT_TIME_S
        if mark in (PERIODIC, BY_RUN):
            turns = s.time / self.value("period_s")
        else:
            turns = (s.x * self.value("north_per_km") + s.y * self.value("east_per_km")) / 1000.0
        return (torch.cos if motion == "cos" else torch.sin)(2 * pi * turns) + 0 * s.u
