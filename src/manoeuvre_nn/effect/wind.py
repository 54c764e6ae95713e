"""Wind on the part of the ship above the water."""

from abc import abstractmethod
from math import exp, sqrt

import torch
from jaxtyping import Float
from scipy.signal import lfilter
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.wind import COEFFICIENTS, usual_kind, wind_load
from manoeuvre_nn.effect.common import columns, compass, direction, during, factor, from_some_time

SPEED = Parameter("speed", "m/s", 0.0, 80.0, 0.0, 8.0, (6.0, 20.0), vector=True)
FORM = (
    # The wind blows over the hull, not at 10 m: (h/10)^(2/7) of the load is .82 at 5 m and 1.22 at 20 m; CD_t of
    # Blendermann's ships scatters by .12, methods differ as much on one ship (Haddara & Guedes Soares 1999).
    factor("load", 0.2),
    factor("cx", 0.2),
    Parameter("cx3", "-", -0.5, 0.5, 0.0, 0.1, (0.0,), form=True),
    Parameter("cy3", "-", -0.5, 0.5, 0.0, 0.1, (0.0,), form=True),
    factor("cn", 0.2),
    Parameter("cn_shift", "-", -0.3, 0.3, 0.0, 0.03, (0.0,), form=True),
    factor("still_air", 0.7, high=2.0),
)


class _TrueWind(Effect):
    """A true wind about one mean direction, by Blendermann's load functions, see :func:`.wind_load`.

    They are taken less the same in still air, which the hull's resistance contains. The wind is taken relative to the
    ship's motion through the water. The form parameter load multiplies X, Y and N, as an error of the areas or of the
    wind's profile does: without an anemometer the speed of a wind much faster than the ship is known to a tenth. cx
    multiplies X alone and cn the arm of Y; cx3 and cy3 are shares of a third harmonic in X and Y, by which published
    curves differ; cn_shift moves the centre of pressure (L_oa); still_air is the share of the load in still air that
    the hull's resistance contains.
    """

    site = "force"
    acts_indoors = False
    exclusive = "wind"
    measured_by = "the wind and the waves"
    family = "wind and waves"
    equations = ("X", "Y", "N")

    def __init__(self, ship: Ship, kind: str | None = None, **values: Endless) -> None:
        """Choose the coefficients.

        Args:
            ship: The ship that it acts on.
            kind: One of ``COEFFICIENTS``; None is a loaded tanker for a full ship, else a loaded cargo ship.
            values: Parameter = value in its unit.
        """
        kind = kind or usual_kind(ship.particulars)
        check_choice(f"effect.{self.name}.kind", kind, list(COEFFICIENTS))
        super().__init__(ship, **values)
        self.coefficients = COEFFICIENTS[kind]

    def force(self, s: Situation) -> Float[Tensor, "*batch 3"]:
        """Force of the wind beyond that of still air."""
        speed = self._speed(s)
        north, east = compass(self.value("from_deg"))
        north, east = speed * north - self._swing(s) * east, speed * east + self._swing(s) * north
        # The wind blows toward the opposite of where it is from.
        ahead, across = (own + air for own, air in zip((s.u, s.v), earth_to_body(north, east, s.psi), strict=True))
        if ahead.shape == s.u.shape:  # both at once: where few rows are sailed, the number of operations takes the time
            wind, still = self._load(torch.stack([ahead, s.u]), torch.stack([across, s.v])).unbind(0)
        else:
            wind, still = self._load(ahead, across), self._load(s.u, s.v)
        return wind - self.value("still_air")[..., None] * still

    def heeling(self, s: Situation) -> Float[Tensor, "*batch"]:
        """``K = Y (s_H - z)``: the lateral area's centroid is s_H = A_L / (2 L_oa), the axis of K z above the water."""
        areas = self.ship.particulars.above_water  # s_H: Blendermann 1994
        return self.force(s)[..., 1] * (0.5 * areas.lateral / areas.length_overall - self.ship.roll_axis)

    @abstractmethod
    def _speed(self, s: Situation) -> Tensor:
        """Speed of the true wind at every sample [m/s]."""

    def _swing(self, s: Situation) -> Tensor | float:
        """Speed across the mean wind, from the right of where it comes from [m/s]."""
        return 0.0

    def _load(self, ahead: Tensor, across: Tensor) -> Tensor:
        """Force of air through which the ship moves ahead and to starboard at given speeds [m/s]."""
        areas = self.ship.particulars.above_water
        third = self.value("cx3"), self.value("cy3")
        surge, sway, arm = wind_load(areas, self.coefficients, ahead, across, third)
        yaw = sway * (self.value("cn") * arm + self.value("cn_shift")) * areas.length_overall
        return self.value("load")[..., None] * columns(self.value("cx") * surge, sway, yaw)


class SteadyWind(_TrueWind):
    """A constant true wind."""

    name = "wind_steady"
    candidate = True
    label = "a steady wind"
    fingerprint = (
        "Forces turn with the compass and grow on upwind headings; the yaw moment changes sign near beam wind."
    )
    source = "Blendermann 1994, J. Wind Eng. Ind. Aerodyn. 51; the step of CD_lAF at beam wind is smoothed"
    declared = (SPEED, direction("from_deg"), *FORM)

    def _speed(self, s: Situation) -> Tensor:
        """Speed of the true wind at every sample [m/s]."""
        return self.value("speed") + 0.0 * s.time


class WindOnset(_TrueWind):
    """Calm until the wind sets in, then steady, until it dies away if it does."""

    name = "wind_onset"
    candidate = True
    label = "a wind that sets in"
    fingerprint = "Nothing until a time, then the forces of a steady wind."
    source = "Blendermann 1994; the wind's speed rises over a ramp"
    declared = (SPEED, direction("from_deg"), *from_some_time(), *FORM)

    def _speed(self, s: Situation) -> Tensor:
        """Speed of the true wind at every sample [m/s]."""
        return self.value("speed") * during(self, s.time)


class GustyWind(_TrueWind):
    """A mean wind and gusts along it, and across it if wanted: first-order Markov processes of one seeded realisation.

    The realisation is made once in units of the gusts' correlation time, so that their size and time are
    differentiable; it repeats after ``LAST`` correlation times.
    """

    name = "wind_gusty"
    candidate = True
    variant_of = "wind_steady"
    label = "a gusty wind"
    fingerprint = "A steady wind, and residuals of sway and yaw that wander together in the ratio of the wind's forces."
    source = "Blendermann 1994; gusts dV = -V/tau dt + sd sqrt(2/tau) dW"
    declared = (
        SPEED,
        direction("from_deg"),
        Parameter("gust_sd", "m/s", 0.0, 20.0, 0.0, 1.5, (1.5,), random=True),
        Parameter("gust_time_s", "s", 5.0, 120.0, None, 30.0, (30.0,), random=True),
        Parameter("gust_across", "-", -1.5, 1.5, 0.0, 0.5, (0.0,), random=True),
        *FORM,
    )
    STEP, LAST = 0.02, 600.0

    gusts: Tensor
    swings: Tensor
    begin: Tensor
    """Where the realisation begins [correlation times], one or one a row."""

    def __init__(self, ship: Ship, kind: str | None = None, seed: int = 0, **values: Endless) -> None:
        """Draw the gusts.

        Args:
            ship: The ship that it acts on.
            kind: One of ``COEFFICIENTS``.
            seed: Number of the realisation.
            values: Parameter = value in its unit.
        """
        super().__init__(ship, kind, **values)
        count = round(self.LAST / self.STEP) + 1
        generator = torch.Generator().manual_seed(seed)
        decay = exp(-self.STEP)
        for name in ("gusts", "swings"):
            kicks = torch.randn(count, generator=generator, dtype=torch.float64).numpy()
            kicks[1:] *= sqrt(1 - decay**2)
            series = lfilter([1.0], [1.0, -decay], kicks).tolist()
            self.register_buffer(name, self.values.new_tensor(series), persistent=False)
        self.register_buffer("begin", self.values.new_zeros(()), persistent=False)

    def drawn(self, rows: int, generator: torch.Generator) -> Effect:
        """The same wind whose gusts begin anywhere in the realisation, in every row of a batch elsewhere."""
        made = self.at(self.values)
        made._buffers["begin"] = self.LAST * torch.rand(rows, generator=generator, dtype=torch.float64).to(self.values)
        return made

    def _speed(self, s: Situation) -> Tensor:
        """Speed of the true wind along its mean direction at every sample [m/s]."""
        return self.value("speed") + self.value("gust_sd") * self._course(s, self.gusts)

    def _swing(self, s: Situation) -> Tensor | float:
        """Speed across the mean wind, from the right of where it comes from [m/s]."""
        return self.value("gust_sd") * self.value("gust_across") * self._course(s, self.swings)

    def _course(self, s: Situation, series: Tensor) -> Tensor:
        """A realisation at every sample [-]."""
        place = torch.remainder(s.time / self.value("gust_time_s") + self.begin, self.LAST) / self.STEP
        low = place.detach().floor().long().clamp(max=len(series) - 2)
        return series[low] + (place - low) * (series[low + 1] - series[low])
