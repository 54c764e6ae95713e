"""The helmsmen of a batch of runs, as tensors: who orders what, and when it ends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from manoeuvre_nn.core.manoeuvre import Manoeuvre

Blade = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
"""Angles behind the indicator, from those before, order, indicated angle and elapsed time: see ``Dynamics.blade``."""


@dataclass(frozen=True)
class Helm:
    """Rows of rudder programmes and where each of them stands.

    Attributes:
        order: Rudder orders of the stages [rad]; every row is padded with its last stage.
        heading: Heading that ends a stage [rad]; ``inf`` if none does.
        direction: +1 if the heading must rise to it, -1 if it must fall.
        hold: Time that ends a stage [s]; ``inf`` if none does.
        rate: Rudder rate [rad/s].
        stage: Stage that each row is in.
        began: Time at which it began [s].
        rudder: Rudder angle that the indicator shows [rad].
        blade: Angles behind the indicator; the last column is the rudder blade's [rad].
    """

    order: Float[Tensor, "rows stages"]
    heading: Float[Tensor, "rows stages"]
    direction: Float[Tensor, "rows stages"]
    hold: Float[Tensor, "rows stages"]
    rate: Float[Tensor, " rows"]
    stage: Int[Tensor, " rows"]
    began: Float[Tensor, " rows"]
    rudder: Float[Tensor, " rows"]
    blade: Float[Tensor, "rows k"]

    def now(self, table: Float[Tensor, "rows stages"]) -> Float[Tensor, " rows"]:
        """What a table of stages says for the stage that each row is in.

        Args:
            table: One of the tables.

        Returns:
            One value a row.
        """
        return table.gather(1, self.stage[:, None])[:, 0]

    def _towards(self, order: Float[Tensor, " rows"], tau: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """Indicated angle after a time within the present stage: evenly towards the order, then held."""
        reach = self.rate * tau
        return self.rudder + torch.clamp(order - self.rudder, -reach, reach)

    def blade_after(self, tau: Float[Tensor, " rows"], blade: Blade) -> Float[Tensor, " rows"]:
        """Angle of the rudder blade after a time within the present stage.

        Args:
            tau: Time from now [s].
            blade: How the blade follows.

        Returns:
            Blade angle [rad].
        """
        order = self.now(self.order)
        return blade(self.blade, order, self._towards(order, tau), tau)[:, -1]

    def smooth_time(self, time: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """Time from now in which the rudder does one thing: until it arrives or the stage's time is up.

        Args:
            time: Time now [s].

        Returns:
            Time [s], positive, ``inf`` if nothing is due.
        """
        error = (self.now(self.order) - self.rudder).abs()
        arrival = torch.where(error > 1e-12, error / self.rate, inf)
        return torch.minimum(arrival, self.began + self.now(self.hold) - time)

    def beyond(self, psi: Float[Tensor, " rows"]) -> Float[Tensor, " rows"]:
        """How far the heading is past the limit of the stage.

        Args:
            psi: Heading [rad].

        Returns:
            Angle [rad], ``-inf`` where no heading ends the stage.
        """
        limit = self.now(self.heading)
        return torch.where(limit.isinf(), -inf, self.now(self.direction) * (psi - limit))

    def advanced(
        self, tau: Float[Tensor, " rows"], time: Float[Tensor, " rows"], crossed: Bool[Tensor, " rows"], blade: Blade
    ) -> "Helm":
        """The helm after a time, with stages changed where they ended.

        Args:
            tau: Time that passed [s].
            time: Time then [s].
            crossed: Rows whose heading reached its limit.
            blade: How the blade follows.

        Returns:
            The helm then.
        """
        order = self.now(self.order)
        rudder = self._towards(order, tau)
        rudder = torch.where((rudder - order).abs() < 1e-12, order, rudder)
        over = crossed | (time >= self.began + self.now(self.hold) - 1e-9)
        last = self.order.shape[1] - 1
        stage = torch.where(over, (self.stage + 1).clamp(max=last), self.stage)
        began, behind = torch.where(over, time, self.began), blade(self.blade, order, rudder, tau)
        return replace(self, stage=stage, began=began, rudder=rudder, blade=behind)

    def take(self, rows: Int[Tensor, " k"]) -> "Helm":
        """Only some rows.

        Args:
            rows: Row numbers.

        Returns:
            Their helm.
        """
        return Helm(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})

    def put(self, rows: Int[Tensor, " k"], part: "Helm") -> "Helm":
        """Replace some rows' standing.

        Args:
            rows: Row numbers.
            part: Their new helm.

        Returns:
            The whole helm.
        """
        moving = ("stage", "began", "rudder", "blade")
        return replace(self, **{n: getattr(self, n).index_copy(0, rows, getattr(part, n)) for n in moving})


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
    length = max(len(m.stages) for m in manoeuvres)
    rows = []
    for m in manoeuvres:
        stages = [(s.order, inf if s.heading is None else s.heading, s.direction, s.hold or inf) for s in m.stages]
        # The last stage is never left.
        stages[-1] = (stages[-1][0], inf, 1, inf)
        rows.append(stages + [stages[-1]] * (length - len(stages)))
    order, heading, direction, hold = rate.new_tensor(rows).unbind(-1)
    zero = torch.zeros_like(rate)
    return Helm(order, heading + course[:, None], direction, hold, rate, zero.long(), zero, zero, blade)
