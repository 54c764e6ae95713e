"""Steepest descent as in the 1990s: momentum, a falling training rate, shaking, and three rules for stopping."""

from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import accumulate
from math import inf, isfinite
from typing import Any

import torch
from torch import Tensor
from torch.nn import Parameter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless, Factor, NotNegative, Weight


@dataclass(frozen=True)
class RateSchedule:
    """Training rate over iterations: stages, then shaking for ever.

    Attributes:
        rates: Rate of each stage [-]; the last one goes on after its iterations.
        iterations: Iterations of each stage.
        shake_rate: Rate while the network is shaken [-]; 0 never shakes.
        shake_every: Iterations from one shaking to the next, counted from the end of the stages.
        shake_iterations: Iterations of a shaking.

    Source:
        Wang 1996, section 4.4.3: 1e-2 for 6000 iterations, 1e-3 for 10 000, 1e-6 for 60 000; then the rate is raised
        from 1e-6 to 1e-3 and restored, periodically (how often and for how long is not stated).
    """

    rates: tuple[Factor, ...] = (1e-2, 1e-3, 1e-6)
    iterations: tuple[int, ...] = (6_000, 10_000, 60_000)
    shake_rate: Weight = 1e-3
    shake_every: int = 70_000
    shake_iterations: int = 10_000

    def __post_init__(self) -> None:
        """Check the stages.

        Raises:
            InputError: If they do not match or a number is out of range.
        """
        object.__setattr__(self, "rates", tuple(self.rates))
        object.__setattr__(self, "iterations", tuple(self.iterations))
        matched = self.rates and len(self.rates) == len(self.iterations)
        if not matched or min(self.rates) <= 0 or min(self.iterations) < 1:
            raise InputError(
                f"fit.schedule with rates {list(self.rates)} and iterations {list(self.iterations)}: expected as many "
                "iterations as rates, all positive"
            )
        if self.shake_rate < 0 or (self.shake_rate and not 0 < self.shake_iterations < self.shake_every):
            raise InputError(
                f"fit.schedule shakes {self.shake_iterations} of every {self.shake_every} iterations at rate "
                f"{self.shake_rate}: expected 0 < shake_iterations < shake_every and a rate of 0 or more"
            )

    def stage(self, iteration: int) -> tuple[float, int | float]:
        """Training rate of an iteration, and the first later one at which it may differ.

        Returns:
            eta [-]; a number, ``inf`` if the rate never changes again.
        """
        ends = list(accumulate(self.iterations))
        if iteration < ends[-1]:
            stage = bisect_right(ends, iteration)
            return self.rates[stage], ends[stage]
        if not self.shake_rate:
            return self.rates[-1], inf
        into = (iteration - ends[-1]) % self.shake_every
        if into < self.shake_iterations:
            return self.shake_rate, iteration - into + self.shake_iterations
        return self.rates[-1], iteration - into + self.shake_every


@dataclass(frozen=True)
class StoppingRules:
    """Three rules combined: enough iterations, a small enough error, or a test error that has begun to rise.

    An error that is not finite also ends the fit: no later iteration could mend it.

    Attributes:
        max_iterations: Iterations after which the fit ends.
        goal: Mean square error on the training data at which it ends.
        test_rise: Ratio to the best test error so far above which it ends; ``inf`` never.

    Source:
        Wang 1996, section 2.5: "the last three methods are combined". Deviation: there the person compares manoeuvres
        simulated with the trained network with test data after a fixed number of iterations; here the error on test
        tuples is watched and the fit ends by itself.
    """

    max_iterations: int | Endless = inf
    goal: NotNegative = 0.0
    test_rise: Endless = inf

    def reason(self, iteration: int, error: float, test: float | None = None, best_test: float | None = None) -> str:
        """Whether to stop.

        Args:
            iteration: Iterations done.
            error: Mean square error on the training data.
            test: Mean square error on the test data, if there are any.
            best_test: The smallest test error so far.

        Returns:
            Why to stop; empty to go on.
        """
        if not isfinite(error):
            return "error is not finite"
        if error <= self.goal:
            return "goal reached"
        if iteration >= self.max_iterations:
            return "iterations used up"
        if test is not None and best_test is not None and test > self.test_rise * best_test:
            return "error on the test data rises"
        return ""


class SteepestDescent(torch.optim.Optimizer):
    """``w(n+1) = w(n) - eta dE/dw + alpha (w(n) - w(n-1))``.

    The gradients are taken as they stand. The thesis' E is the SUM of squares over the outputs of ONE sample (eq 2.6),
    and its rates belong to that E: for a mini-batch give the mean of E over the samples, without the factor 1/2 and not
    divided by the number of outputs. The gradient of the sum over n samples takes rates n times smaller.

    The count of iterations and the moves ``w(n) - w(n-1)`` are in ``state_dict()``; the schedule is not.

    Source:
        Wang 1996, eqs 2.20 and 2.21.
    """

    def __init__(self, params: Iterable[Parameter], *, momentum: float, schedule: RateSchedule) -> None:
        """Set up.

        Args:
            params: Parameters.
            momentum: alpha [-].
            schedule: Training rate over iterations.

        Raises:
            InputError: If the momentum is not in [0, 1), or the parameters come in several groups.
        """
        if not 0 <= momentum < 1:
            raise InputError(f"fit.momentum={momentum}: expected 0 or more and less than 1")
        super().__init__(params, {"momentum": momentum, "iteration": 0})
        if len(self.param_groups) > 1:
            raise InputError(f"{len(self.param_groups)} groups of parameters: give one, which has one rate")
        self.schedule = schedule
        self._rate, self._until = 0.0, -1.0
        self._moves: list[Tensor] = []

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:  # type: ignore[override]
        """One iteration with the gradients that stand in the parameters.

        Args:
            closure: Recomputes the loss and the gradients, as torch allows; None takes what is there.

        Returns:
            What the closure gave.
        """
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        group = self.param_groups[0]
        parameters = group["params"]
        if not self._moves:
            for p in parameters:
                self.state[p].setdefault("move", torch.zeros_like(p))
            self._moves = [self.state[p]["move"] for p in parameters]
        now = group["iteration"]
        if now >= self._until:
            # The schedule is asked only when its answer may change: this loop runs hundreds of thousands of times.
            self._rate, self._until = self.schedule.stage(now)
        torch._foreach_mul_(self._moves, group["momentum"])
        torch._foreach_add_(self._moves, [p.grad for p in parameters], alpha=-self._rate)
        torch._foreach_add_(parameters, self._moves)
        group["iteration"] = now + 1
        return loss

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take up a stored state.

        Args:
            state_dict: What ``state_dict()`` gave.
        """
        super().load_state_dict(state_dict)
        self._moves, self._until = [], -1.0
