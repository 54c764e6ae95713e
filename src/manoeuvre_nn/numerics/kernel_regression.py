"""Kernel regression: a mean of stored values, weighted by nearness, and the widths at which it foretells best."""

import copy
from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.numerics.radial_basis import squared_distances


def kernel_mean(
    x: Float[Tensor, "n i"],
    records: Float[Tensor, "m i"],
    values: Float[Tensor, "m o"],
    widths: Float[Tensor, " i"],
    *,
    leave_one_out: bool = False,
) -> Float[Tensor, "n o"]:
    """``y(x) = sum_m w_m(x) y_m / sum_m w_m(x)`` with ``w_m(x) = exp(-sum_i ((x_i - x_mi) / s_i)^2 / 2)``.

    The weights are divided by the largest of them before they are summed, so that far from all records the nearest one
    answers, where Specht's formula is 0/0.

    Args:
        x: Where.
        records: Inputs of the stored records.
        values: Their values.
        widths: s, one an input; as s goes to 0 the nearest record answers, as it goes to infinity the mean.
        leave_one_out: Whether x are the records themselves, and each is foretold by the others.

    Returns:
        Weighted means.

    Source:
        Nadaraya 1964; Watson 1964; Specht 1991, eq. 5.
    """
    logarithm = -0.5 * squared_distances(x / widths, records / widths)
    if leave_one_out:
        logarithm = logarithm.masked_fill(torch.eye(len(x), dtype=torch.bool, device=x.device), -torch.inf)
    return logarithm.softmax(1) @ values


def leave_one_out_error(
    records: Float[Tensor, "m i"], values: Float[Tensor, "m o"], widths: Float[Tensor, " i"]
) -> Float[Tensor, ""]:
    """Mean square error of every record foretold by the others; it can be differentiated by the widths."""
    foretold = kernel_mean(records, records, values, widths, leave_one_out=True)
    return (foretold - values).square().mean()


def first_widths(records: Float[Tensor, "m i"]) -> Float[Tensor, " i"]:
    """Widths to begin with: ``s_i = sd_i (4 / ((I + 2) m))^(1 / (I + 4))``.

    Args:
        records: Inputs.

    Returns:
        s; 1 for an input that does not vary.

    Source:
        Silverman 1986, section 4.3.2, the rule for densities of normal data.
    """
    count, inputs = records.shape
    spread = records.std(0, correction=0) * (4 / ((inputs + 2) * count)) ** (1 / (inputs + 4))
    return torch.where(spread > 0, spread, 1.0)


class WidthSearch:
    """Widths of least leave-one-out error, found by L-BFGS in their logarithms.

    Attributes:
        widths: The best so far.
        error: Their mean square leave-one-out error.
        stopped: Whether no step lowers it any more.
    """

    def __init__(
        self,
        records: Float[Tensor, "m i"],
        values: Float[Tensor, "m o"],
        *,
        common: bool = False,
    ) -> None:
        """Begin at :func:`first_widths`.

        Args:
            records: Inputs.
            values: Values.
            common: Whether all inputs have one width, as in Specht's paper.
        """
        self.records, self.values = records, values
        logarithm = first_widths(records).log()
        self._logarithm = (logarithm.mean()[None] if common else logarithm.clone()).requires_grad_(True)
        self._optimizer = torch.optim.LBFGS([self._logarithm], max_iter=1, line_search_fn="strong_wolfe")
        self.widths = self._expanded().detach()
        self.error = float(leave_one_out_error(records, values, self.widths))
        self.stopped = False

    def step(self, min_fall: float = 1e-6) -> float:
        """One iteration of L-BFGS.

        Args:
            min_fall: Fall of the error over the error at which the search is done [-].

        Returns:
            The least error so far.
        """
        with torch.enable_grad():
            self._optimizer.step(self._closure)
        widths = self._expanded().detach()
        error = float(leave_one_out_error(self.records, self.values, widths))
        self.stopped = not error < (1 - min_fall) * self.error
        if error < self.error:
            self.widths, self.error = widths, error
        return self.error

    def state_dict(self) -> dict[str, Any]:
        """Where the search is, so that it can be gone on with."""
        place = self._logarithm.detach().clone(), copy.deepcopy(self._optimizer.state_dict())
        return {"place": place, "found": (self.widths, self.error, self.stopped)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from where a search was."""
        logarithm, optimizer = state["place"]
        with torch.no_grad():
            self._logarithm.copy_(logarithm)
        self._optimizer.load_state_dict(optimizer)
        self.widths, self.error, self.stopped = state["found"]

    def _closure(self) -> Tensor:
        self._optimizer.zero_grad()
        error = leave_one_out_error(self.records, self.values, self._expanded())
        error.backward()
        return error

    def _expanded(self) -> Tensor:
        return self._logarithm.exp().expand(self.records.shape[1])
