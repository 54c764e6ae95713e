"""Gradient of a closed loop by its adjoint: many times fewer operations than automatic differentiation step by step.

The loop is run without a record of its operations. All steps are then linearised at once, as rows of one batch; what is
left to do step by step, from the last to the first, is a handful of products.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from manoeuvre_nn.dynamics.recursion import MIN_SPEED, Recursion

if TYPE_CHECKING:
    from manoeuvre_nn.dynamics.recursive import RecursiveShip

Controls = Callable[[Float[Tensor, " rows"]], Float[Tensor, "rows _"]]


def closed_loop(
    ship: "RecursiveShip", start: Recursion, controls: Controls, speed: Float[Tensor, " rows"], steps: int
) -> tuple[Float[Tensor, "steps rows freedom"], Float[Tensor, "steps rows angles"], Float[Tensor, "steps rows"]]:
    """Steps in closed loop with their gradients by the network's weights.

    Args:
        ship: Ship and network.
        start: Where every row stands; taken as given.
        controls: Time of every row in L/U0 -> controls then.
        speed: Approach speeds U0 [m/s].
        steps: How many.

    Returns:
        Velocities, angles and time; the start first.
    """
    weights, biases, links = ship.network.folded()
    given = [b for b in (*biases, links) if b is not None]
    return _ClosedLoop.apply(ship, start, controls, speed, steps, *weights, *given)


class _ClosedLoop(torch.autograd.Function):
    """The loop, and the adjoint of its steps.

    With the state ``s = (y, angles, t)``, forces ``f_k = f(s_k)`` and the network's
    ``y_{k+1} = g(f_k, ..., f_{k-7}, y_k, y_{k-1})``, the cotangents of states and forces follow backwards from
    ``l_y(k+1) -> G^T l_y`` (on the forces of eight steps, y_k and y_{k-1}), from the kinematics
    ``angles_{k+1} = angles_k + dt (rates_k + rates_{k+1}) / 2``, ``t_{k+1} = t_k + dt``, ``dt = step / |u, v|``,
    and from ``F^T l_f``, where G and F are the Jacobians of g and f at step k.
    """

    @staticmethod
    def forward(ctx: Any, ship: "RecursiveShip", start: Recursion, controls: Controls, speed: Tensor, steps: int,
                *folded: Tensor) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
        """Run the loop."""
        froude, layers = ship.froude(speed), _layers(ship, folded)
        passed = [start]
        for _ in range(steps):
            passed.append(ship.advance(passed[-1], controls(passed[-1].time), froude, layers))
        made = (
            torch.stack([p.velocities for p in passed]),
            torch.stack([p.angles for p in passed]),
            torch.stack([p.time for p in passed]),
        )
        forces = [*reversed(start.forces), *(p.forces[0] for p in passed[1:])] if start.forces else []
        ctx.of = ship, controls, froude, start.before
        ctx.save_for_backward(*made, torch.stack(forces), *folded)
        return made

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *cotangents: Tensor) -> tuple[Any, ...]:  # type: ignore[override]
        """Cotangents of the weights."""
        ship, controls, froude, before = ctx.of
        velocities, angles, time, forces, *folded = ctx.saved_tensors
        seen = _inputs(ship, velocities, before, forces)
        jacobian = _force_jacobian(ship, controls, froude, (velocities[:-1], angles[:-1], time[:-1]))
        values, slopes = ship.network.nodes(seen, _layers(ship, folded))
        carried = _carried_back(ship, (velocities, angles), (slopes, folded), jacobian, cotangents)
        # With v the values of a layer and l the cotangents of what the next is given: dW = v^T l, db = sum l.
        sums = [c.flatten(0, 1) for c in carried]
        weights = [v.flatten(0, 1).T @ c for v, c in zip([seen, *values], sums, strict=True)]
        links = _links_gradient(ship, seen, sums[-1])
        biases = [c.sum(0) for c in sums[: len(folded) - len(weights) - len(links)]]
        return None, None, None, None, None, *weights, *biases, *links


def _links_gradient(
    ship: "RecursiveShip", seen: Float[Tensor, "steps rows inputs"], outputs: Float[Tensor, "n freedom"]
) -> list[Tensor]:
    """Cotangents of what the wind acts on the output nodes by; none where it does not."""
    network = ship.network
    if network.links is None:
        return []
    if network.settings.symmetric:  # half of it went to the network, and half to its mirror image
        outputs = 2 * outputs.view(-1, 2, outputs.shape[-1])[:, 0]
    return [seen[..., network.wind_places].flatten(0, 1).T @ outputs]


def _layers(ship: "RecursiveShip", flat: Sequence[Tensor]) -> Any:
    """Folded weights from their list."""
    count = len(ship.network.weights)
    *given, links = flat if ship.network.links is not None else [*flat, None]
    biases: list[Tensor | None] = [*given[count:]]
    return list(given[:count]), biases + [None] * (count - len(biases)), links


def _inputs(
    ship: "RecursiveShip",
    velocities: Float[Tensor, "after rows freedom"],
    before: Float[Tensor, "rows freedom"],
    forces: Float[Tensor, "longer rows columns"],
) -> Float[Tensor, "steps rows inputs"]:
    """What the network saw at every step."""
    steps, past = len(velocities) - 1, ship.network.settings.past
    kept = [forces[past - k : past - k + steps] for k in range(past + 1)]
    return ship.network.join(kept, (velocities[:-1], torch.cat([before[None], velocities[:-2]])))


def _force_jacobian(
    ship: "RecursiveShip", controls: Controls, froude: Tensor, states: tuple[Tensor, Tensor, Tensor]
) -> Float[Tensor, "steps rows columns state"]:
    """Derivatives of the forces of every step by velocities, angles and time."""
    with torch.enable_grad():
        velocities, angles, time = (s.detach().requires_grad_() for s in states)
        driving = controls(time.T).transpose(0, 1)
        forces = ship.forces(velocities, angles, driving, froude)
        rows = []
        for k in range(forces.shape[-1]):
            total = forces[..., k].sum()
            found = torch.autograd.grad(total, (velocities, angles, time), retain_graph=True, materialize_grads=True)
            rows.append(torch.cat([found[0], found[1], found[2][..., None]], dim=-1))
    return torch.stack(rows, dim=-2)


def _carried_back(
    ship: "RecursiveShip",
    states: tuple[Float[Tensor, "after rows freedom"], Float[Tensor, "after rows angles"]],
    network: tuple[Sequence[Tensor], Sequence[Tensor]],
    jacobian: Float[Tensor, "steps rows columns state"],
    cotangents: Sequence[Tensor],
) -> list[Float[Tensor, "steps _ nodes"]]:
    """Cotangents of what the nodes of each layer are given, from the last step to the first."""
    (velocities, angles), (slopes, flat), s = states, network, ship.network.settings
    count, turned, layers = velocities.shape[-1], angles.shape[-1], _layers(ship, flat)
    steps, rows, width = jacobian.shape[:3]
    by_step, carried = [part.unbind() for part in slopes], []
    state = torch.cat([cotangents[0], cotangents[1], cotangents[2][..., None]], dim=-1)
    # The latest first: forces of past steps then follow each other as the network's inputs do.
    force = jacobian.new_zeros(steps + s.past, rows, width)
    whole, kept = s.past_thrust + 1, len(s.long_kept)
    first, second = whole * width, whole * width + (s.past - s.past_thrust) * kept
    speed = torch.linalg.vector_norm(velocities[:-1, :, :2], dim=-1, keepdim=True)
    step = s.step / speed.clamp(min=MIN_SPEED)
    by_speed = torch.where(speed > MIN_SPEED, -step / speed.square() * velocities[:-1, :, :2], 0.0)
    half, mean = 0.5 * step, 0.5 * (velocities[:-1] + velocities[1:])[..., -turned:]
    rates = slice(count - turned, count)
    for k in range(steps - 1, -1, -1):
        after, now = state[k + 1], state[k]
        turn = half[k] * after[:, count:-1]
        after[:, rates] += turn
        now[:, rates] += turn
        in_step = torch.linalg.vecdot(after[:, count:-1], mean[k])[:, None] + after[:, -1:]
        now[:, :2].addcmul_(in_step, by_speed[k])
        now[:, count:] += after[:, count:]
        back, passed = ship.network.pulled_back(after[:, :count], [part[k] for part in by_step], layers)
        carried.append(passed)
        j = steps - 1 - k
        force[j : j + whole] += back[:, :first].view(rows, whole, width).transpose(0, 1)
        force[j + whole : j + s.past + 1, :, 2 : 2 + kept] += back[:, first:second].view(rows, -1, kept).transpose(0, 1)
        now[:, :count] += back[:, second : second + count]
        if k:
            state[k - 1, :, :count] += back[:, second + count :]
        now += torch.bmm(force[j, :, None], jacobian[k])[:, 0]
    return [torch.stack(layer[::-1]) for layer in reversed(list(zip(*carried, strict=True)))]
