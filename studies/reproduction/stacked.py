"""Models of one structure as rows of a batch: hundreds of trained networks sail at once."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model


class Stacked(Model):
    """Different ships or networks of one structure as rows of a batch.

    Row i of every batch that it is given moves by model i; ``torch.func.vmap`` over the stacked parameters.
    """

    def __init__(self, models: Sequence[Model]) -> None:
        """Stack models of one class and structure.

        Args:
            models: One for each row.

        Raises:
            InputError: If the rows differ in more than their tensors: in L, U0, rudder rate or the model's own rules.
        """
        super().__init__()
        if len({(m.particulars.length, m.particulars.speed, m.particulars.rudder_rate) for m in models}) > 1:
            raise InputError("stacked models differ in L, U0 or rudder rate; run such ships one after the other")
        self._template = [models[0]]  # in a list, so that its parameters are not registered a second time
        self.parameters_of_rows, self.buffers_of_rows = torch.func.stack_module_state(list(models))
        with torch.no_grad():
            # A rule that is not a tensor (sign of the rudder, scaling) would silently be the first row's.
            unit = self._template[0].particulars
            nu = next(iter(self.buffers_of_rows.values())).new_tensor([0.8, -0.1, 0.2, 0.0, 0.0, 0.0]) * unit.speed
            state, inputs = nu / nu.new_tensor([1.0, 1.0, unit.length, 1.0, 1.0, 1.0]), Inputs(nu.new_tensor(0.2))
            alone = torch.stack([m(state, inputs) for m in models])
            together = self(state.expand(len(models), 6), Inputs(inputs.delta.expand(len(models))))
            if not torch.allclose(together, alone):
                raise InputError("stacked models differ in rules, not only in numbers; run them one after the other")

    @property
    def hull(self) -> Ship:
        """That of the first row."""
        return self._template[0].hull

    def forward(self, state: Float[Tensor, "rows 6"], inputs: Inputs) -> Float[Tensor, "rows 6"]:
        """Rate of the state of every row by its own model."""

        def one(parameters: dict, buffers: dict, own: Tensor, given: dict) -> Tensor:
            return torch.func.functional_call(self._template[0], (parameters, buffers), (own, Inputs(**given)))

        given = {name: value.expand(len(state)) for name, value in inputs.given.items()}
        return torch.func.vmap(one)(self.parameters_of_rows, self.buffers_of_rows, state, given)

    def on_approach(self, speed: float) -> "Stacked":
        """Not defined for a stack: set the speed of each model before stacking.

        Args:
            speed: Approach speed [m/s].

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("set the approach speed of each model before stacking them")
