"""The helmsmen of a batch of runs, as tensors: who orders what, and when it ends."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.dynamics.vessel import Vessel


@dataclass(frozen=True)
class Helm:
    """Rows of rudder programmes and where each of them stands.

    Attributes:
        stages: Order [rad], heading that ends a stage [rad] and time that ends it [s] (``inf`` if none does), and +1 or
            -1 if the heading must rise or fall to it; every row is padded with its last stage.
        now: The same of the stage that each row is in.
        rate: Rudder rate [rad/s].
        stage: Stage that each row is in.
        began: Time at which it began [s].
        rudder: Rudder angle that the indicator shows [rad].
        blade: Angles behind the indicator; the last column is the rudder blade's [rad].
    """

    stages: Float[Tensor, "4 rows stages"]
    now: Float[Tensor, "4 rows"]
    rate: Float[Tensor, " rows"]
    stage: Int[Tensor, " rows"]
    began: Float[Tensor, " rows"]
    rudder: Float[Tensor, " rows"]
    blade: Float[Tensor, "rows k"]

    @property
    def order(self) -> Float[Tensor, " rows"]:
        """Rudder order of the present stage [rad]."""
        return self.now[0]

    @property
    def direction(self) -> Float[Tensor, " rows"]:
        """+1 if the heading must rise to the limit of the present stage, -1 if it must fall."""
        return self.now[3]

    def after(
        self, tau: Float[Tensor, " rows"], vessel: Vessel
    ) -> tuple[Float[Tensor, " rows"], Float[Tensor, "rows k"]]:
        """Angles after a time within the present stage: the indicator goes evenly towards the order, then rests.

        Args:
            tau: Time from now [s].
            vessel: The ship whose blade follows.

        Returns:
            Angle that the indicator shows and the angles behind it [rad].
        """
        error, reach = self.order - self.rudder, self.rate * tau
        under_way = error.abs() > reach + 1e-12
        shown = torch.where(under_way, self.rudder + torch.copysign(reach, error), self.order)
        return shown, vessel.gear.after(self.blade, self.order, shown, tau)

    def smooth_time(self, time: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """Time from now [s] until the rudder arrives or the stage's time is up; ``inf`` if nothing is due."""
        error = (self.order - self.rudder).abs()
        arrival = torch.where(error > 1e-12, error / self.rate, inf)
        return torch.minimum(arrival, self.began + self.now[2] - time)

    def beyond(self, psi: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """How far the heading is past the limit of the stage [rad]; ``-inf`` where no heading ends the stage."""
        return self.direction * (psi - self.now[1])

    def advanced(
        self,
        shown: Float[Tensor, " rows"],
        blade: Float[Tensor, "rows k"],
        time: Float[Tensor, " rows"],
        moved: Bool[Tensor, " rows"],
        crossed: Bool[Tensor, " rows"],
    ) -> "Helm":
        """The helm after a time, with stages changed where they ended.

        Args:
            shown: Angle that the indicator shows then [rad].
            blade: Angles behind it [rad].
            time: Time then [s].
            moved: Rows for which the time has passed; the others keep their stage.
            crossed: Rows whose heading reached its limit.

        Returns:
            The helm then.
        """
        over = moved & (crossed | (time >= self.began + self.now[2] - 1e-9))
        if not over.any():
            return replace(self, rudder=shown, blade=blade)
        stage = (self.stage + over).clamp(max=self.stages.shape[2] - 1)
        began, now = torch.where(over, time, self.began), _at(self.stages, stage)
        return replace(self, now=now, stage=stage, began=began, rudder=shown, blade=blade)


def _at(stages: Float[Tensor, "4 rows stages"], stage: Int[Tensor, " rows"]) -> Float[Tensor, "4 rows"]:
    """The numbers of one stage of every row."""
    return stages.gather(2, stage[None, :, None].expand(4, -1, 1))[..., 0]


def helm_of(
    manoeuvres: Sequence[Manoeuvre],
    rate: Float[Tensor, " rows"],
    course: Float[Tensor, " rows"],
    blade: Float[Tensor, "rows k"],
) -> Helm:
    """Put manoeuvres into tensors.

    Args:
        manoeuvres: One for each row.
        rate: Rudder rate [rad/s].
        course: Heading at the start [rad], to which headings of stages are relative.
        blade: Angles behind the indicator at the start [rad].

    Returns:
        The helm at the start, indicator amidships.
    """
    stages, counts = [s for m in manoeuvres for s in m.stages], np.array([len(m.stages) for m in manoeuvres])
    heading = np.array([inf if s.heading is None else s.heading for s in stages])
    # Without a heading that ends it, a stage counts as one whose heading rises for ever.
    direction = np.where(np.isinf(heading), 1.0, [s.direction for s in stages])
    flat = np.stack([[s.order for s in stages], heading, [s.hold or inf for s in stages], direction])
    last = np.cumsum(counts) - 1
    flat[1:, last] = np.array([inf, inf, 1.0])[:, None]  # the last stage is never left
    places = (last - counts + 1)[:, None] + np.arange(counts.max())
    table = rate.new_tensor(flat[:, np.minimum(places, last[:, None])])
    table[1] += course[:, None]
    zero = torch.zeros_like(rate)
    return Helm(table, table[..., 0], rate, zero.long(), zero, zero, blade)
