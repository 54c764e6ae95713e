"""What effects, coefficients and sensors add to a run: columns of its linear equations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.linalg import expm
from torch import Tensor

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.estimation.corrections import Corrections
from manoeuvre_nn.estimation.linear_run import Columns, nothing
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, shown
from manoeuvre_nn.estimation.rudder_blades import blades, undoes_a_record
from manoeuvre_nn.recording.holes import in_breaks


@dataclass(frozen=True)
class Beside:
    """What the other effects of a run are to one of them, at their values.

    Attributes:
        hulls: Those that change the ship's inertia under one that does not.
        nudot: What those without own states add to the accelerations that drive its own states (:class:`.Situation`),
            one row a set of its values or one for all; None where these are not driven by accelerations.
    """

    hulls: Sequence[Effect] = ()
    nudot: Float[Tensor, "#k n 3"] | None = None

    def drive(self, s: Situation) -> Situation:
        """What an effect with own states sees."""
        return s if self.nudot is None else s.with_(nudot=s.nudot + self.nudot)

    def with_more(self, nudot: Float[Tensor, "#k n 3"]) -> "Beside":
        """The same with further accelerations."""
        return replace(self, nudot=nudot if self.nudot is None else self.nudot + nudot)


ALONE = Beside()
"""No other effect."""


def contribution(
    effect: Effect,
    values: Float[np.ndarray, "k p"],
    linearised: LinearisedRun,
    blade: Float[Tensor, "k n"] | None = None,
    beside: Beside = ALONE,
) -> Columns:
    """What an effect adds to a run, for several sets of parameter values at once.

    Args:
        effect: The effect.
        values: Parameter values, one set a row.
        linearised: The run about its track, and the rudder as :func:`behind_record` has it.
        blade: Angle of the blade for each set (:func:`blades`); None finds it.
        beside: The effects beside it (:func:`beside_it`).

    Returns:
        One column a set.
    """
    s, rows, n = linearised.situation, len(values), len(linearised.run)
    with torch.no_grad():
        acting = _acting(effect, values, linearised)
        if blade is None:
            (blade,) = blades(effect, [values], [linearised])
        memory = own_states(acting, beside.drive(s), rows, linearised.run.step)
        changed = _added_rates(acting, memory, linearised, blade, beside)
        here = s if blade is None else s.with_(delta=blade)
        moved = moved_by(changed, acting.stream(here).expand(rows, n, 2), linearised)
        seen = s.with_(shaft=acting.shaft(here, memory).expand(rows, n))
        return Columns(_recorded(acting, linearised, seen, rows), moved.permute(1, 2, 0).numpy())


def _acting(effect: Effect, values: Float[np.ndarray, "k p"], linearised: LinearisedRun) -> Effect:
    """An effect at several sets of values, on the ship as her coefficients are corrected."""
    acting = effect.at(linearised.moving.new_tensor(values)[:, None, :])
    return acting.aboard(linearised.rate.dynamics.corrected(effect.ship))


def added_accelerations(
    effect: Effect,
    values: Float[np.ndarray, "k p"],
    linearised: LinearisedRun,
    beside: Beside,
) -> Float[Tensor, "k n 3"]:
    """What an effect without own states adds to udot, vdot [m/s^2] and rdot [rad/s^2]; see :func:`contribution`."""
    with torch.no_grad():
        (blade,) = blades(effect, [values], [linearised])
        none = linearised.moving.new_zeros(len(values), len(linearised.moving), 0)
        return _added_rates(_acting(effect, values, linearised), none, linearised, blade, beside)[..., :3]


def _added_rates(
    acting: Effect,
    memory: Float[Tensor, "k n m"],
    linearised: LinearisedRun,
    blade: Float[Tensor, "k n"] | None,
    beside: Beside,
) -> Float[Tensor, "k n r"]:
    """What an effect adds to the rates of u, v, r and the own states along a track, for several sets of values."""
    s, rate, moving, sides = linearised.situation, linearised.rate, linearised.moving, linearised.sides
    here, everywhere = s, moving.expand(len(memory), *moving.shape)
    changed = torch.zeros_like(everywhere)
    if blade is not None:
        here = s.with_(delta=blade)
        without = linearised.as_recorded if undoes_a_record(acting) else linearised.calm
        changed = changed + rate(everywhere, blade, s.shaft, sides) - without
    if acting.overrides("shaft") and bool((s.shaft == 1).all()):
        shaft = acting.shaft(here, memory).expand(everywhere.shape[:2])
        changed = changed + rate(everywhere, s.delta, shaft, sides) - linearised.calm
    heeling = acting.heeling(here) if linearised.states.own else s.u
    changed = changed + with_roll(acting.ship, acting.acceleration(beside.drive(here), memory), heeling)
    for hull in beside.hulls:
        changed = torch.cat([hull.with_changed_inertia(s, changed[..., :3]), changed[..., 3:]], dim=-1)
    return changed


def with_feedback(
    linearised: LinearisedRun, effects: Sequence[Effect], values: Sequence[Float[np.ndarray, " p"]]
) -> LinearisedRun:
    """A run whose transitions are those of the ship with the effects aboard: their forces, too, go with the states.

    With J the derivative of the rates that the effects add by the state, along the track, and A the transition in calm
    water and C what it carries of a push (:attr:`.LinearisedRun.carried`), the whole is
    ``P = A + h C (J_k + J_{k+1} P)/2``, by the mean of both ends as in :func:`moved_by`. Blades and effects' own states
    stay as they are along the track.

    Args:
        linearised: The run about its track, in calm water.
        effects: Effects that act in it.
        values: Their values.

    Returns:
        The run; nothing else of it is changed.
    """
    states, track = linearised.states, linearised.track
    lines = [k for k, name in enumerate(states.moving) if name not in {"x", "y"}]
    moves = [0, 1, 2, *range(6, states.count)]
    by_state = np.zeros((len(track), states.count, states.size))
    # Central differences, by steps of a state's usual size.
    shifted = [
        [replace(linearised, track=track + sign * states.unit[j] * np.eye(states.count)[j]) for sign in (1, -1)]
        for j in lines
    ]
    with torch.no_grad():
        for number, (effect, value) in enumerate(zip(effects, values, strict=True)):
            # Derivatives in calm water are taken at the rudder behind its record already.
            if undoes_a_record(effect) or not effect.overrides("force", "acceleration", "blade", "shaft", "heeling"):
                continue
            table = np.array([value])
            acting = _acting(effect, table, linearised)
            (blade,) = blades(effect, [table], [linearised])
            beside = beside_it(effects, values, number, linearised)
            memory = own_states(acting, beside.drive(linearised.situation), 1, linearised.run.step)
            for j, both in zip(lines, shifted, strict=True):
                up, down = (_added_rates(acting, memory, line, blade, beside)[0].numpy() for line in both)
                by_state[:, moves, j] += (up - down) / (2 * states.unit[j])
    if not by_state.any():
        return linearised
    run, calm, k = linearised.run, linearised.transition, states.count
    carried = 0.5 * run.step * linearised.carried.numpy()
    carried[in_breaks(run.time, run.meta.get("breaks", ()))] = 0.0
    whole = calm
    for _ in range(2):  # the second time what is there at the end of a step is known to second order in it
        moved = carried @ (by_state[:-1] + by_state[1:] @ whole)
        whole = np.concatenate([calm[:, :k] + moved, calm[:, k:]], axis=1)
    return replace(linearised, transition=whole)


def hulls_beside(effects: Sequence[Effect], values: Sequence[Float[np.ndarray, " p"]], number: int) -> list[Effect]:
    """Those among the effects of a run that change the ship's inertia under one that does not, at their values."""
    hulls = [k for k, e in enumerate(effects) if e.overrides("with_changed_inertia")]
    return [] if number in hulls else [effects[k].at(effects[k].values.new_tensor(values[k])) for k in hulls]


def beside_it(
    effects: Sequence[Effect], values: Sequence[Float[np.ndarray, " p"]], number: int, linearised: LinearisedRun
) -> Beside:
    """What the others among the effects of a run are to one of them.

    Args:
        effects: All effects, as they act.
        values: Their values.
        number: Which of them.
        linearised: The run about its track, behind a late record of the rudder (:func:`.behind_record`).

    Returns:
        They at their values.
    """
    beside = Beside(hulls_beside(effects, values, number))
    if feels_acceleration(effects[number], linearised):
        for k, (effect, value) in enumerate(zip(effects, values, strict=True)):
            # Accelerations in calm water are those at the rudder behind its record already.
            if k != number and not (effect.memory or undoes_a_record(effect)):
                own = Beside(hulls_beside(effects, values, k))
                beside = beside.with_more(added_accelerations(effect, effect.steady(value)[None], linearised, own))
    return beside


def feels_acceleration(effect: Effect, linearised: LinearisedRun) -> bool:
    """Whether the own states of an effect are driven by the ship's accelerations, as heel is."""
    if not effect.memory:
        return False
    s = linearised.situation
    still, other = s.nu.new_zeros(len(s.nu), effect.memory), s.with_(nudot=s.nudot + 1.0)
    with torch.no_grad():
        return not torch.equal(effect.memory_rate(s, still), effect.memory_rate(other, still))


def own_states(acting: Effect, s: Situation, rows: int, step: float) -> Float[Tensor, "rows n m"]:
    """An effect's own states along a track; their equations are linear in them, with constant factors.

    Args:
        acting: The effect; values of several rows.
        s: What it sees.
        rows: Number of rows.
        step: Time between samples [s].

    Returns:
        One column a state.
    """
    size = acting.memory
    still = s.nu.new_zeros(rows, len(s.psi), size)
    if not size:
        return still
    forcing = acting.memory_rate(s, still).expand(still.shape)
    units = torch.eye(size, dtype=still.dtype)
    matrix = torch.stack(
        [(acting.memory_rate(s, still + e).expand(still.shape) - forcing)[:, 0] for e in units], dim=-1
    ).numpy()
    start = acting.memory_at_start(s).expand(still.shape)[:, 0].numpy()
    drive = forcing.numpy()
    if all((part == part[:1]).all() for part in (matrix, start, drive)):
        matrix, start, drive = matrix[:1], start[:1], drive[:1]  # whatever the values, its states are the same
    # Over a step m_{k+1} = free m_k + forced (mean of the drive), from one matrix exponential a row.
    eye, none = np.broadcast_to(np.eye(size), matrix.shape), np.zeros_like(matrix)
    whole = expm(step * np.block([[matrix, eye], [none, none]]))
    free, forced = (part.transpose(0, 2, 1) for part in (whole[:, :size, :size], whole[:, :size, size:]))
    result = np.concatenate([start[:, None], 0.5 * (drive[:, 1:] + drive[:, :-1]) @ forced], axis=1)
    # The sum over all earlier steps, twice as many in every round.
    reach = 1
    while reach < result.shape[1]:
        result[:, reach:] += result[:, :-reach] @ free
        free, reach = free @ free, 2 * reach
    return torch.tensor(result).expand(still.shape)


def with_roll(
    ship: Ship, acceleration: Float[Tensor, "*batch 3"], heeling: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*batch k"]:
    """Accelerations by external forces, and after them what these and a heeling moment add to the own states' rates."""
    if not ship.own_names:
        return acceleration
    return torch.cat(ship.added(acceleration, heeling), dim=-1)


def moved_by(
    rates: Float[Tensor, "k n m"], stream: Float[Tensor, "k n 2"], linearised: LinearisedRun
) -> Float[Tensor, "k steps s"]:
    """What rates and a stream add to the state within each step.

    h times their mean, carried to its end (:attr:`.LinearisedRun.carried`): what is pushed early in a step has been
    damped, turned and carried on by then.

    Args:
        rates: udot, vdot [m/s^2], rdot [rad/s^2] and rates of the own states, of several columns.
        stream: North and east [m/s].
        linearised: The run about its track.

    Returns:
        u, v, r, x, y, psi, own states.
    """
    h = linearised.run.step
    rate = torch.cat([rates[..., :3], stream, torch.zeros_like(stream[..., :1]), rates[..., 3:]], dim=-1)
    push = 0.5 * h * (rate[:, 1:] + rate[:, :-1])
    return torch.einsum("sij,ksj->ksi", linearised.carried, push)


def _recorded(acting: Effect, linearised: LinearisedRun, s: Situation, rows: int) -> Float[np.ndarray, "n c k"]:
    """What the effect adds to the measured channels: moving water, and sensors."""
    n = len(linearised.run)
    shape = n, len(linearised.states.channels), rows
    if not acting.overrides("stream", "record"):
        return nothing(*shape)
    added = np.zeros(shape)
    if acting.overrides("stream"):
        added[:, 2:4] = acting.stream(s).expand(rows, n, 2).permute(1, 2, 0).numpy()
    if acting.overrides("record"):
        true = perfect(s)
        written = acting.record(true, s)
        for k, name in enumerate(MEASURED):
            added[:, k] += (written[name] - true[name]).expand(rows, n).T.numpy()
    return added


def perfect(s: Situation) -> dict[str, Tensor]:
    """What perfect sensors write in still water."""
    state = torch.stack([*s.nu.unbind(-1), s.x, s.y, s.psi], dim=-1)
    return dict(zip(MEASURED, torch.tensor(shown(state.numpy())).unbind(-1), strict=True)) | {"delta": s.delta}


def coefficient_columns(dynamics: Model, linearised: LinearisedRun) -> Columns:
    """What each correction of the calm-water model adds, by 100 %: coefficients, missing terms, inertias.

    Args:
        dynamics: The calm-water model.
        linearised: The run about its track.

    Returns:
        One column a correction, in the order of :attr:`.Corrections.names`.
    """
    s = linearised.situation
    with torch.no_grad():
        shaft = None if bool((s.shaft == 1).all()) else s.shaft
        a = Corrections(dynamics)(linearised.moving, s.delta, shaft).permute(1, 0, 2)
        moved = moved_by(a, a.new_zeros(*a.shape[:2], 2), linearised).permute(1, 2, 0).numpy()
    return Columns(nothing(len(linearised.run), len(linearised.states.channels), len(a)), moved)


def latency_column(linearised: LinearisedRun) -> Columns:
    """What a second of delay of the satellite receiver adds to its channels.

    Args:
        linearised: The run about its track.

    Returns:
        One column.
    """
    states = linearised.states
    added = np.zeros((len(linearised.run), len(states.channels), 1))
    received = shown(linearised.track)[:, :4] + linearised.receiver
    added[:, :4, 0] = -np.gradient(received, linearised.run.step, axis=0)
    return Columns(added, nothing(len(linearised.run) - 1, states.count, 1))
