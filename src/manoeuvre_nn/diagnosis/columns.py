"""What effects, coefficients and sensors add to a run: columns of its linear equations."""

import numpy as np
import torch
from jaxtyping import Float
from scipy.linalg import expm
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.diagnosis.calibrated import Corrections
from manoeuvre_nn.diagnosis.linear import Columns, Linearised, Rate, shown
from manoeuvre_nn.diagnosis.runs import CHANNELS, COUNT, Run
from manoeuvre_nn.dynamics.model import Dynamics


def situation(line: Linearised, rate: Rate) -> Situation:
    """What effects see along a run's track.

    Args:
        line: The run about its track.
        rate: Accelerations of the calm-water model.

    Returns:
        The situation at all samples.
    """
    run = line.run
    state, delta = torch.tensor(line.track), torch.tensor(run.delta)
    shaft = torch.tensor(run.shaft)
    nu = state[:, :3]
    with torch.no_grad():
        return Situation(nu, rate(nu, delta, shaft), *state[:, 3:6].unbind(-1), delta, shaft, torch.tensor(run.time))  # type: ignore[call-arg]


def contribution(
    effect: Effect, values: Float[np.ndarray, "k p"], line: Linearised, rate: Rate, s: Situation
) -> Columns:
    """What an effect adds to a run, for several sets of parameter values at once.

    Args:
        effect: The effect.
        values: Parameter values, one set a row.
        line: The run about its track.
        rate: Accelerations of the calm-water model.
        s: The situation along the track.

    Returns:
        One column a set.
    """
    with torch.no_grad():
        acting = effect.at(s.nu.new_tensor(values)[:, None, :])
        rows, n = len(values), len(line.run)
        acceleration = s.nu.new_zeros(rows, n, 3)
        blade = _blade(acting, line, rows)
        if blade is not None:
            here = s.with_(delta=blade)
            acceleration = acceleration + rate(s.nu.expand(rows, n, 3), blade, s.shaft) - s.nudot
        else:
            here = s
        memory = _memory(acting, s, rows, line.run.step)
        shaft = acting.shaft(here, memory)
        if type(effect).shaft is not Effect.shaft and bool((s.shaft == 1).all()):
            acceleration = acceleration + rate(s.nu.expand(rows, n, 3), s.delta, shaft.expand(rows, n)) - s.nudot
        acceleration = acceleration + acting.acceleration(here, memory)
        stream = acting.stream(here).expand(rows, n, 2)
        moved = moved_by(acceleration, stream, line)
        seen = s.with_(shaft=shaft.expand(rows, n))
        return Columns(_recorded(acting, line, seen, rows), moved.permute(1, 2, 0).numpy())


def _blade(acting: Effect, line: Linearised, rows: int) -> Tensor | None:
    """Angle of the blade at all samples, None if the effect leaves it as indicated."""
    run = line.run
    recorded = torch.tensor(run.delta)
    if type(acting).indicated is not Effect.indicated:
        return acting.indicated(recorded.expand(rows, len(run)), torch.tensor(run.time))
    if type(acting).blade is Effect.blade:
        return None
    return blade_along(acting, run, recorded.expand(rows, len(run)))


def blade_along(acting: Effect, run: Run, shown: Float[Tensor, "rows n"]) -> Float[Tensor, "rows n"]:
    """Angle of the blade at all samples of a run behind one effect.

    Args:
        acting: The effect; values of one row each.
        run: The run, for its orders and the times at which they were given.
        shown: What the effect is shown: the indicated angle, or the blade behind another effect [rad].

    Returns:
        Blade angle [rad].
    """
    made, still = _behind(acting, run, shown), _behind(acting.at(acting.null()), run, shown[:1])
    # What the fault does to the blade, not what the gear should have done: orders say that only roughly.
    return shown + made - still


def _behind(acting: Effect, run: Run, shown: Float[Tensor, "rows n"]) -> Float[Tensor, "rows n"]:
    """Angle behind one effect as it computes it."""
    order, lead, rows = torch.tensor(run.order), torch.tensor(run.lead), len(shown)
    step = shown.new_tensor(run.step)
    held = torch.cat([order[:1], order[:-1]])
    here = acting.blade(shown, held, shown, step).expand(shown.shape)
    if torch.equal(here, acting.blade(shown + 1.0, held, shown, step).expand(shown.shape)):
        return here  # it has no memory
    angles = [acting.blade(shown[:, :1], order[0], shown[:, :1], 0 * step).expand(rows, 1)]
    for k in range(1, len(run)):
        before, now, angle = shown[:, k - 1 : k], shown[:, k : k + 1], angles[-1]
        if lead[k] > 0:  # the new order came within the step
            angle = acting.blade(angle, order[k - 1], before, (1 - lead[k]) * step)
            angles.append(acting.blade(angle, order[k], now, lead[k] * step).expand(rows, 1))
        else:
            angles.append(acting.blade(angle, order[k - 1], now, step).expand(rows, 1))
    return torch.cat(angles, dim=-1)


def _memory(acting: Effect, s: Situation, rows: int, step: float) -> Tensor:
    """The effect's own states along the track; their equations are linear in them, with constant factors."""
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
    result = np.empty(still.shape)
    for row in range(rows):
        whole = expm(np.block([[matrix[row] * step, np.eye(size) * step], [np.zeros((size, 2 * size))]]))
        free, forced = whole[:size, :size], whole[:size, size:]
        mean = 0.5 * (drive[row, 1:] + drive[row, :-1]) @ forced.T
        m = start[row]
        result[row, 0] = m
        for k in range(len(mean)):
            m = free @ m + mean[k]
            result[row, k + 1] = m
    return torch.tensor(result)


def moved_by(
    acceleration: Float[Tensor, "k n 3"], stream: Float[Tensor, "k n 2"], line: Linearised
) -> Float[Tensor, "k steps 6"]:
    """What accelerations and a stream add to the state within each step.

    ``h (I + A) / 2`` times their mean, with A the derivative of the next state by the present one: what is pushed early
    in a step has been damped, turned and carried on by its end.

    Args:
        acceleration: udot, vdot [m/s^2], rdot [rad/s^2] of several columns.
        stream: North and east [m/s].
        line: The run about its track.

    Returns:
        u, v, r, x, y, psi.
    """
    h = line.run.step
    rate = torch.cat([acceleration, stream, torch.zeros_like(stream[..., :1])], dim=-1)
    push = 0.5 * h * (rate[:, 1:] + rate[:, :-1])
    carried = push.new_tensor(0.5 * (np.eye(6) + line.transition[:, :6, :6]))
    return torch.einsum("sij,ksj->ksi", carried, push)


def _recorded(acting: Effect, line: Linearised, s: Situation, rows: int) -> Float[np.ndarray, "n 8 k"]:
    """What the effect adds to the measured channels: moving water, and sensors."""
    n = len(line.run)
    added = np.zeros((n, COUNT, rows))
    if type(acting).stream is not Effect.stream:
        added[:, 2:4] = acting.stream(s).expand(rows, n, 2).permute(1, 2, 0).numpy()
    if type(acting).record is not Effect.record:
        true = perfect(s)
        written = acting.record(true, s)
        for k, name in enumerate(CHANNELS):
            added[:, k] += (written[name] - true[name]).expand(rows, n).T.numpy()
    return added


def perfect(s: Situation) -> dict[str, Tensor]:
    """What perfect sensors write in still water.

    Args:
        s: The situation.

    Returns:
        Channel -> samples.
    """
    cos, sin = torch.cos(s.psi), torch.sin(s.psi)
    vn, ve = s.u * cos - s.v * sin, s.u * sin + s.v * cos
    return {
        "x": s.x, "y": s.y, "vn": vn, "ve": ve, "psi": s.psi, "r": s.r, "u_log": s.u,
        "delta": s.delta, "n": torch.ones_like(s.u),
    }  # fmt: skip


def coefficient_columns(dynamics: Dynamics, line: Linearised, s: Situation) -> tuple[Columns, list[str]]:
    """What each correction of the calm-water model adds, by 100 %: coefficients, missing terms, inertias.

    Args:
        dynamics: The calm-water model.
        line: The run about its track.
        s: The situation along the track.

    Returns:
        One column a correction, and its name.
    """
    corrections = Corrections(dynamics)
    with torch.no_grad():
        shaft = None if bool((s.shaft == 1).all()) else s.shaft
        a = corrections(s.nu, s.delta, shaft).permute(1, 0, 2)
        moved = moved_by(a, a.new_zeros(*a.shape[:2], 2), line).permute(1, 2, 0).numpy()
    return Columns(np.zeros((len(line.run), COUNT, len(a))), moved), corrections.names


def latency_column(line: Linearised) -> Columns:
    """What a second of delay of the satellite receiver adds to its channels.

    Args:
        line: The run about its track.

    Returns:
        One column.
    """
    added = np.zeros((len(line.run), COUNT, 1))
    added[:, :4, 0] = -np.gradient(shown(line.track)[:, :4], line.run.step, axis=0)
    return Columns(added, np.zeros((len(line.run) - 1, 6, 1)))
