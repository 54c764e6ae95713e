"""Levenberg-Marquardt for any module and any residual, many independent fits as one batch.

Torch has no second-order optimizer for least squares. This one keeps torch's contract (parameters in,
``step(closure)``, ``state_dict``), so that Lightning can drive it, and treats independent fits as rows: three networks
of one ship or many restarts are one batch, and each has its own damping and its own reason to stop.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import Parameter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.damping import Damping, Reason, Stops, damped_step

Jacobian = Callable[[], "Tensor | Iterable[Tensor]"]
Normal = Callable[[], tuple[Tensor, Tensor]]
REASONS = tuple(Reason)
LAYER_WIDTH = 16  # elements in the widest layer for one of the residual, assumed when autograd's memory is shared out


class LevenbergMarquardt(torch.optim.Optimizer):
    """Damped Gauss-Newton steps ``(J^T J + mu I) d = -J^T e`` on residuals e(w).

    One :meth:`step` is one epoch of TRAINLM: e and J are taken at the present weights, then mu is raised until a step
    lowers the sum of squares (or mu exceeds ``mu_max``), and lowered after it.

    With ``rows=K`` every parameter has K as its first dimension, the residual has shape (K, N), row k depends on row k
    of the parameters alone, and K problems are solved side by side.

    Attributes:
        mu: Damping of every row.
        loss: Mean square error of every row.
        stopped: Whether every row has stopped.
        reasons: Why each row stopped; empty for a row that goes on.
        evaluations: How often the residual was evaluated.

    Source:
        Levenberg 1944; Marquardt 1963; Hagan & Menhaj 1994 (TRAINLM's rule); Rajesh & Bhattacharyya 2009, section 4,
        for mu and its factors, with mu_max 1e10 for the misprinted 1e-10; see :class:`.Damping` for the rules.
    """

    def __init__(
        self,
        params: Iterable[Parameter],
        *,
        rows: int | None = None,
        damping: Damping | None = None,
        stops: Stops | None = None,
        jacobian: Jacobian | None = None,
        normal: Normal | None = None,
        max_elements: float = 2e7,
    ) -> None:
        """Set up.

        Args:
            params: Parameters, all of one type.
            rows: Number of independent problems K; None is one problem.
            damping: How mu follows the steps; by default TRAINLM's rule.
            stops: When a row is done; by default at a gradient of 1e-7, whatever the step. Its ``epochs`` do not count:
                the caller counts the steps.
            jacobian: Gives J of shape (K, N, P), or (N, P) without rows, at the present weights, or an iterable of its
                blocks along N; P runs over the parameters in their order. None takes it from autograd.
            normal: Gives J^T J (K, P, P) and J^T e (K, P) at the present weights instead, for problems whose structure
                saves the Jacobian, as :meth:`.OneHidden.normal_equations` does; asked after the closure.
            max_elements: A Jacobian with more elements is never built whole: J^T J is summed from blocks.

        Raises:
            InputError: If a setting makes no sense.
        """
        if jacobian is not None and normal is not None:
            raise InputError("Levenberg-Marquardt with jacobian and normal: expected one of them")
        self.damping, self.stops = damping or Damping(), stops or Stops(min_grad=1e-7, min_step=0.0)
        super().__init__(params, {})
        self._weights: list[Parameter] = [p for group in self.param_groups for p in group["params"]]
        if rows is not None and any(p.shape[0] != rows for p in self._weights):
            raise InputError(f"rows={rows}, but parameters have {[tuple(p.shape) for p in self._weights]}")
        self.rows, self.jacobian, self.normal, self.max_elements = rows, jacobian, normal, max_elements
        one = self._weights[0].new_ones(rows or 1)
        # Reasons and counts are kept as floats of the weights' type: torch casts them to it when a state is loaded.
        self._state.update(
            mu=self.damping.mu * one, nu=2 * one, mse=torch.full_like(one, torch.inf), reason=0 * one, fails=0 * one,
            best=torch.full_like(one, torch.inf), evaluations=one.new_zeros(()), steps=one.new_zeros(()),
        )  # fmt: skip

    @property
    def _state(self) -> dict[str, Any]:
        return self.state[self._weights[0]]

    @property
    def mu(self) -> Float[Tensor, " rows"]:
        """Damping of every row [-]."""
        return self._state["mu"]

    @property
    def loss(self) -> Float[Tensor, " rows"]:
        """Mean square error of every row at the present weights."""
        return self._state["mse"]

    @property
    def evaluations(self) -> int:
        """How often the residual was evaluated."""
        return int(self._state["evaluations"])

    @property
    def reasons(self) -> list[str]:
        """Why each row stopped; empty for a row that goes on. See :class:`.Reason`."""
        return [REASONS[int(code)] for code in self._state["reason"]]

    @property
    def stopped(self) -> bool:
        """Whether every row has stopped."""
        return bool((self._state["reason"] != 0).all())

    def step(self, closure: Callable[[], Tensor]) -> Float[Tensor, " rows"]:  # type: ignore[override]
        """One epoch.

        Args:
            closure: Gives the residual: (K, N) with rows, else any shape. Only the residual, no backward pass.

        Returns:
            Mean square error of every row after the step.
        """
        if self.stopped:
            return self.loss
        residual, normal, gradient = self._linearise(closure)
        state, count = self._state, residual.shape[1]
        state["steps"] = state["steps"] + 1
        state["mse"] = residual.square().mean(1)
        self._check_weights(2 * gradient.norm(dim=1) / count)
        if "best_mse" in state:  # a validation before the first step could not know the error yet
            state["best_mse"] = torch.where(state["best_mse"].isinf(), state["mse"], state["best_mse"])
        if int(state["steps"]) == 1:
            state["mu"] = self.damping.first(normal)
        start = origin = self._flat()
        before = state["mse"]
        pending = state["reason"] == 0
        while pending.any():
            move, solved = damped_step(normal, gradient, self.mu)
            move = torch.where((pending & solved)[:, None], move, 0.0)
            self._set(start + move)
            with torch.no_grad():
                after = self._rows(closure()).square().mean(1)
            state["evaluations"] = state["evaluations"] + 1
            better = pending & solved & (after < before)  # a comparison with NaN is false
            state["mse"] = torch.where(better, after, state["mse"])
            start = torch.where(better[:, None], start + move, start)
            self._damp(pending, better, move, gradient, 0.5 * count * (before - after))
            pending = pending & ~better & (state["reason"] == 0)
        self._set(start)
        self._check_step(origin, start, before)
        return self.loss

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take up a stored state.

        Args:
            state_dict: What ``state_dict()`` gave.

        Raises:
            InputError: If it is of another number of rows, or holds a damping that no step could come from.
        """
        own = {name: value for name, value in self._state.items() if isinstance(value, Tensor)}
        super().load_state_dict(state_dict)
        state = self._state
        for name, value in own.items():
            if not isinstance(state.get(name), Tensor) or state[name].shape != value.shape:
                raise InputError(f"stored state of Levenberg-Marquardt: {name} is no tensor of {tuple(value.shape)}")
        known = (state["reason"] >= 0) & (state["reason"] < len(REASONS))
        if not bool(((state["mu"] >= 0) & (state["nu"] >= 2) & known).all()):  # from a smaller nu no search ends
            raise InputError("stored state of Levenberg-Marquardt: expected mu >= 0, nu >= 2 and a known reason")

    @torch.no_grad()
    def validate(self, mse: Float[Tensor, " rows"]) -> None:
        """Tell the optimizer the error on data kept back; it remembers the best weights of every row.

        A row whose validation error was above its best (or not a number) ``max_fail`` times since that best stops; a
        row that has stopped, for whatever reason, takes its best weights back.

        Args:
            mse: Validation error of every row.
        """
        state = self._state
        mse = mse.to(state["best"])
        better = mse < state["best"]
        flat = self._flat()
        kept, kept_mse = state.get("best_weights", flat), state.get("best_mse", state["mse"])
        state["best_weights"] = torch.where(better[:, None], flat, kept)
        state["best_mse"] = torch.where(better, state["mse"], kept_mse)
        state["best"] = torch.where(better, mse, state["best"])
        state["fails"] = torch.where(better, 0.0, state["fails"] + (~(mse <= state["best"])).to(mse))
        self._stop(state["fails"] >= self.stops.max_fail, Reason.VALIDATION)
        over = state["reason"] != 0
        state["mse"] = torch.where(over, state["best_mse"], state["mse"])
        self._set(torch.where(over[:, None], state["best_weights"], flat))

    def _stop(self, where: Bool[Tensor, " rows"], reason: Reason) -> None:
        """Note why rows stop, unless they have already."""
        state = self._state
        state["reason"] = torch.where(where & (state["reason"] == 0), reason.code, state["reason"])

    def _check_weights(self, slope: Float[Tensor, " rows"]) -> None:
        """Stop rows whose error is not a number, is at the goal, or whose gradient is flat."""
        mse = self._state["mse"]
        self._stop(~(mse.isfinite() & slope.isfinite()), Reason.NOT_FINITE)
        self._stop(mse <= self.stops.goal, Reason.GOAL)
        self._stop(slope < self.stops.min_grad, Reason.GRADIENT)

    def _check_step(self, origin: Tensor, start: Tensor, before: Tensor) -> None:
        """Stop rows that came to the goal or moved or gained too little; one that did not move has its reason."""
        mse = self._state["mse"]
        better = mse < before
        self._stop(mse <= self.stops.goal, Reason.GOAL)
        self._stop(better & ((start - origin).norm(dim=1) < self.stops.min_step * origin.norm(dim=1)), Reason.STEP)
        self._stop(better & (before - mse < self.stops.min_fall * before), Reason.FALL)

    def _damp(
        self, pending: Tensor, better: Tensor, move: Float[Tensor, "k p"], gradient: Float[Tensor, "k p"], fall: Tensor
    ) -> None:
        """New damping of the pending rows; those beyond mu_max stop."""
        state = self._state
        mu, nu = self.damping.after(state["mu"], state["nu"], better, move, gradient, fall)
        state["mu"], state["nu"] = torch.where(pending, mu, state["mu"]), torch.where(pending, nu, state["nu"])
        self._stop(pending & ~better & (state["mu"] > self.damping.mu_max), Reason.DAMPING)

    def _linearise(self, closure: Callable[[], Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Residual (K, N), J^T J (K, P, P) and J^T e (K, P) at the present weights."""
        self._state["evaluations"] = self._state["evaluations"] + 1
        if self.normal is not None:
            with torch.no_grad():
                return self._rows(closure()), *self.normal()
        if self.jacobian is not None:
            with torch.no_grad():
                residual = self._rows(closure())
                blocks: Iterator[Tensor] = iter(_blocks(self.jacobian()))
                return residual, *_normal_equations(residual, blocks, self.rows is None)
        with torch.enable_grad():
            residual = self._rows(closure())
        return residual.detach(), *_normal_equations(residual.detach(), self._autograd_blocks(residual), False)

    def _autograd_blocks(self, residual: Tensor) -> Iterator[Tensor]:
        """Blocks of J along the residuals, by the cheaper direction that fits into memory."""
        count = sum(p.numel() for p in self._weights) // len(residual)
        if residual.shape[1] <= count or residual.numel() * count > self.max_elements:
            yield from self._reverse_blocks(residual, count)
        else:
            yield self._forward_block(residual, count)

    def _reverse_blocks(self, residual: Tensor, count: int) -> Iterator[Tensor]:
        """Rows of J from vector-Jacobian products, as many at once as memory allows."""
        rows, total = residual.shape
        size = min(total, self._at_once(rows * max(count, total)))
        for first in range(0, total, size):
            chosen = torch.arange(first, min(first + size, total), device=residual.device)
            seeds = torch.zeros(len(chosen), rows, total, dtype=residual.dtype, device=residual.device)
            seeds[torch.arange(len(chosen)), :, chosen] = 1.0
            parts = torch.autograd.grad(
                residual, self._weights, seeds, retain_graph=True, is_grads_batched=True, allow_unused=True
            )
            filled = [
                seeds.new_zeros(len(chosen), *p.shape) if part is None else part
                for part, p in zip(parts, self._weights, strict=True)
            ]
            yield torch.cat([part.reshape(len(chosen), rows, -1) for part in filled], -1).movedim(1, 0)

    def _forward_block(self, residual: Tensor, count: int) -> Tensor:
        """All of J by columns: the derivative of ``J^T w`` by w, which any closure allows, times unit vectors."""
        rows, total = residual.shape
        weight = torch.zeros_like(residual, requires_grad=True)
        pulled = torch.autograd.grad(residual, self._weights, weight, create_graph=True, allow_unused=True)
        used = [k for k, part in enumerate(pulled) if part is not None]
        unit = torch.eye(count, dtype=residual.dtype, device=residual.device)
        columns = []
        for chunk in unit.split(self._at_once(rows * total)):
            parts = chunk.split([p.numel() // rows for p in self._weights], dim=1)
            seeds = [
                part[:, None].expand(-1, rows, -1).reshape(len(chunk), *p.shape)
                for part, p in zip(parts, self._weights, strict=True)
            ]
            (column,) = torch.autograd.grad(
                [pulled[k] for k in used], weight, [seeds[k] for k in used], retain_graph=True, is_grads_batched=True
            )
            columns.append(column)
        return torch.cat(columns).movedim(0, -1)

    def _at_once(self, elements: int) -> int:
        """How many derivatives to take at once; on their way they pass layers wider than the residual."""
        return max(1, int(self.max_elements / (LAYER_WIDTH * elements)))

    def _rows(self, residual: Tensor) -> Float[Tensor, "k n"]:
        if self.rows is None:
            return residual.reshape(1, -1)
        if residual.ndim != 2 or len(residual) != self.rows:
            raise InputError(f"residual of shape {tuple(residual.shape)}: with rows={self.rows} give ({self.rows}, N)")
        return residual

    def _flat(self) -> Float[Tensor, "k p"]:
        return torch.cat([p.detach().reshape(self.rows or 1, -1) for p in self._weights], dim=1)

    @torch.no_grad()
    def _set(self, flat: Float[Tensor, "k p"]) -> None:
        rows = self.rows or 1
        parts = flat.split([p.numel() // rows for p in self._weights], dim=1)
        for parameter, part in zip(self._weights, parts, strict=True):
            parameter.copy_(part.reshape(parameter.shape))


def _blocks(jacobian: Tensor | Iterable[Tensor]) -> Iterable[Tensor]:
    return [jacobian] if isinstance(jacobian, Tensor) else jacobian


def _normal_equations(residual: Tensor, blocks: Iterable[Tensor], single: bool) -> tuple[Tensor, Tensor]:
    """Sum J^T J and J^T e over blocks of residuals."""
    normal: Tensor | None = None
    gradient: Tensor | None = None
    first = 0
    for given in blocks:
        block = given[None] if single and given.ndim == 2 else given
        part = residual[:, first : first + block.shape[1]]
        first += block.shape[1]
        square, product = block.mT @ block, (block.mT @ part[..., None])[..., 0]
        normal = square if normal is None else normal + square
        gradient = product if gradient is None else gradient + product
    if normal is None or gradient is None or first != residual.shape[1]:
        raise InputError(f"Jacobian of {first} residuals: the closure gives {residual.shape[1]}, in the same order")
    return normal, gradient
