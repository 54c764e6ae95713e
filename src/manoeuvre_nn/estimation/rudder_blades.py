"""The rudder blade along a run: behind its record and behind the faults of its gear."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.linearised_run import LinearisedRun


def blades(
    effect: Effect, tables: Sequence[Float[np.ndarray, "k p"]], linearised: Sequence[LinearisedRun]
) -> list[Float[Tensor, "k n"] | None]:
    """Angle of the blade at all samples of several runs behind one effect, for several sets of values at once.

    A blade that remembers is followed from sample to sample, all runs and sets together.

    Args:
        effect: The effect.
        tables: Parameter values of each run, one set a row.
        linearised: The runs.

    Returns:
        One table of angles a run; None if the effect leaves the blade as indicated.
    """
    runs = [line.run for line in linearised]
    with torch.no_grad():
        if undoes_a_record(effect):
            acting = [effect.at(torch.tensor(table)[:, None, :]) for table in tables]
            return [indicated(a, r, torch.tensor(r["delta"])[None]) for a, r in zip(acting, runs, strict=True)]
        if not effect.overrides("blade"):
            return [None] * len(runs)
        shown = [torch.tensor(x.indicated).expand(len(v), -1) for x, v in zip(linearised, tables, strict=True)]
        return list(_behind(effect, [torch.tensor(table) for table in tables], runs, shown))


def undoes_a_record(effect: Effect) -> bool:
    """Whether an effect is an error of the record of the rudder."""
    return effect.overrides("indicated")


def behind_record(
    linearised: LinearisedRun, effects: Sequence[Effect], values: Sequence[Float[np.ndarray, " p"]]
) -> LinearisedRun:
    """A run with the rudder where the effects of a hypothesis say that its indicator was, for what acts beside them."""
    recorded = linearised.run["delta"]
    if not any(map(undoes_a_record, effects)) and np.array_equal(recorded, linearised.indicated):
        return linearised
    shown = torch.tensor(recorded)[None]
    for effect, here in zip(reversed(effects), reversed(values), strict=True):
        if undoes_a_record(effect):
            shown = indicated(effect.at(shown.new_tensor(here)), linearised.run, shown)
    same = np.array_equal(shown[0], linearised.indicated)
    return linearised if same else replace(linearised, indicated=shown[0].numpy())


def indicated(acting: Effect, run: Recording, recorded: Float[Tensor, "rows n"]) -> Float[Tensor, "rows n"]:
    """What the indicator showed during a run behind a recorded angle [rad] (:meth:`.Effect.indicated`).

    Returns:
        Angles [rad]. A late record would have told in a hole of a time before it: there they are those of the orders.
    """
    given, time = run.ordered_rudder(acting.ship.particulars.rudder_rate), torch.tensor(run.time)
    ordered = None if given is None else torch.tensor(given)
    shown, breaks = acting.indicated(recorded, ordered, time), run.meta.get("breaks", ())
    if ordered is None or not breaks:
        return shown
    told_at = acting.indicated(time.expand_as(recorded), None, time)
    lost = sum(
        ((told_at > begin) & (told_at < end) for begin, end in breaks), torch.zeros_like(shown, dtype=torch.bool)
    )
    return torch.where(lost & ordered.isfinite(), ordered, shown)


def blade_along(acting: Effect, run: Recording, shown: Float[Tensor, "rows n"]) -> Float[Tensor, "rows n"]:
    """Angle of the blade at all samples of a run behind one effect.

    Args:
        acting: The effect; values of one row each.
        run: The run, for its orders and the times at which they were given.
        shown: What the effect is shown: the indicated angle, or the blade behind another effect [rad].

    Returns:
        Blade angle [rad].
    """
    values = acting.values.reshape(-1, len(acting.declared)).expand(len(shown), -1)
    return _behind(acting, [values], [run], [shown])[0]


def _behind(
    effect: Effect, values: Sequence[Tensor], runs: Sequence[Recording], shown: Sequence[Tensor]
) -> list[Float[Tensor, "rows n"]]:
    """The blade behind an effect: what is shown, and what the fault adds to it."""
    # A last row of each run has the effect vanish: orders say only roughly what the gear should have done.
    counts, longest = [len(d) + 1 for d in shown], max(len(r) for r in runs)
    every = torch.cat([torch.cat([v, effect.null().to(v)[None]]) for v in values])

    def table(rows: Sequence[Tensor]) -> Tensor:
        """Rows of all runs, the shorter ones held at their ends."""
        wide = [torch.cat([r, r[..., -1:].expand(*r.shape[:-1], longest - r.shape[-1])], dim=-1) for r in rows]
        return torch.cat([r.expand(k, -1) for r, k in zip(wide, counts, strict=True)])

    order, lead = (table([torch.tensor(r[name]) for r in runs]) for name in ("delta_order", "order_lead"))
    step = torch.cat([torch.full((k, 1), r.step, dtype=every.dtype) for k, r in zip(counts, runs, strict=True)])
    indicated = table([torch.cat([d, d[:1]]) for d in shown])
    made = _followed(effect.at(every[:, None, :]), order, lead, step, indicated).split(counts)
    return [d + m[:-1, : d.shape[-1]] - m[-1:, : d.shape[-1]] for d, m in zip(shown, made, strict=True)]


def _followed(acting: Effect, order: Tensor, lead: Tensor, step: Tensor, shown: Tensor) -> Float[Tensor, "rows n"]:
    """Angle behind an effect as it computes it, from sample to sample if it remembers."""
    held = torch.cat([order[:, :1], order[:, :-1]], dim=-1)
    here = acting.blade(shown, held, shown, step).expand(shown.shape)
    if torch.equal(here, acting.blade(shown + 1.0, held, shown, step).expand(shown.shape)):
        return here  # it has no memory
    # Where a new order came within the step it is cut there: the old order first, then the new one.
    came = lead > 0
    before = torch.cat([shown[:, :1], shown[:, :-1]], dim=-1)
    first = torch.where(came, before, shown)
    pieces = (held, torch.where(came, order, held)), (first, shown), ((1 - lead) * step, lead * step)
    # Where none came in any row a step is one piece; where one did, it lasts no time in the others and changes nothing.
    taken = torch.stack([torch.ones_like(came[0]), came.any(dim=0)], dim=-1)
    taken[0] = False
    in_turn = (torch.stack([p.expand_as(shown) for p in both], dim=-1)[:, taken] for both in pieces)
    start = acting.blade(shown[:, :1], order[:, :1], shown[:, :1], 0 * step).expand(step.shape)
    angles = acting.blade_in_turn(start, *in_turn)
    return torch.cat([start, angles[:, taken.sum(dim=-1)[1:].cumsum(dim=0) - 1]], dim=-1)
