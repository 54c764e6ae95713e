"""Accelerations that are linear in coefficients, as the closed-loop fit sees them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.ship.tanker import TankerShip

State = Float[np.ndarray, "n 6"]
"""u, v, r, x, y, psi at all samples."""
Inputs = Mapping[str, Float[np.ndarray, " n"]]
"""Rudder angle ``delta`` [rad], ``n`` over the nominal shaft speed, ``wind_north`` and ``wind_east`` over U0."""


class CoefficientForces:
    """Accelerations that are linear in coefficients, in units of L and the approach speed.

    Each coefficient has a product of motion and inputs in one equation:
    ``nudot = sum_c theta_c product_c(state, inputs) push_c``.

    Attributes:
        names: Output (0 X, 1 Y, 2 N) and product of each coefficient.
        count: Number of coefficients.
    """

    def __init__(
        self,
        names: Sequence[tuple[int, str]],
        products: Callable[[State, Inputs], Float[Tensor, "n k"]],
        product: Int[np.ndarray, " p"],
        push: Float[np.ndarray, "3 3"],
    ) -> None:
        """Store the parts.

        Args:
            names: Output and product of each coefficient.
            products: All products at given states and inputs.
            product: Which of them each coefficient has.
            push: Accelerations for a force of 1 in each output, one a row.
        """
        self.names, self.count = list(names), len(names)
        self._products, self._product = products, product
        self._push = push[[output for output, _ in names]].T

    def columns(self, state: State, inputs: Inputs) -> Float[np.ndarray, "n 3 p"]:
        """What the coefficients are multiplied by.

        Returns:
            Columns: accelerations of surge, sway and yaw for a coefficient of 1.
        """
        with torch.no_grad():
            products = self._products(state, inputs).double().numpy()
        return products[:, None, self._product] * self._push


def series_forces(model: IdentifiedShip) -> CoefficientForces:
    """Accelerations of a series of products.

    Args:
        model: Its network is a series, its known part has no forces.

    Returns:
        One coefficient a product of the series.

    Raises:
        InputError: If the known part has forces: they are what the coefficients are about.
    """
    assert isinstance(model.network, Series)
    network, known = model.network, model.known
    nudge = known.inertia.new_tensor([[1.0, 0.1, 0.1]]) * known.velocity_units
    with torch.no_grad():
        if known.force(nudge, nudge[:, 0] * 0 + 0.1).abs().max() > 0:
            raise InputError("fit=closed_loop estimates all forces: write linear=clarke_inertia (or none)")
        push = known.acceleration_from_force(torch.diag(model.scaling.output_scale))

    def products(state: State, inputs: Inputs) -> Float[Tensor, "n k"]:
        ahead, aside = earth_to_body(inputs["wind_north"], inputs["wind_east"], state[:, 5])
        wind = ahead - state[:, 0], aside - state[:, 1]
        x = np.stack([state[:, 0], state[:, 1], state[:, 2], inputs["delta"], inputs["n"], *wind], axis=1)
        return network.products(torch.as_tensor(x))

    product = network.used.nonzero()[:, 1].numpy()
    return CoefficientForces(
        network.names, products, product, push.double().numpy() / _acceleration_units(known.particulars)
    )


def own_forces(ship: Ship) -> CoefficientForces:
    """Accelerations of a ship's own products.

    Of the tanker family the coefficients are those of its table in the BIS system (Yuv, Yccd, ...), the thrust's among
    them as ``1 - t``, ``YT`` and ``NT``; of a Taylor series the factors of the bare products, the rudder as the source
    counts it.

    Returns:
        One coefficient an entry of its table.

    Raises:
        InputError: If its forces are no sum of products.
    """
    if ship.table is None:
        raise InputError(f"terms=own: the forces of the {ship.particulars.name} are no sum of known products")
    outputs, product = ship.table.T.nonzero().numpy().T
    p, tanker = ship.particulars, isinstance(ship, TankerShip)
    written = ship.terms if tanker else [" ".join(t).replace("u", "a") or "1" for t in ship.terms]
    push = ship.acceleration_from_force(torch.eye(3).to(ship.inertia))
    scale = torch.tensor([p.speed, p.speed, p.speed / p.length], dtype=torch.float64)

    def products(state: State, inputs: Inputs) -> Float[Tensor, "n k"]:
        nu, delta = torch.as_tensor(state[:, :3].copy()) * scale, torch.as_tensor(inputs["delta"])
        if isinstance(ship, TankerShip):
            return ship.products(nu, delta, torch.as_tensor(inputs["n"]))
        return ship.products(nu, delta)

    names = [(int(o), written[k]) for o, k in zip(outputs, product, strict=True)]
    return CoefficientForces(names, products, product, push.double().numpy() / _acceleration_units(p) / own_unit(ship))


def own_unit(ship: Ship) -> float:
    """A coefficient as its source prints it over that of the ship's table.

    Args:
        ship: The ship; the tanker family's table is made for one speed, the BIS system has none.

    Returns:
        The factor.
    """
    return ship.prime.speed**2 if isinstance(ship, TankerShip) else 1.0


def _acceleration_units(ship: Particulars) -> Float[np.ndarray, " 3"]:
    """U0^2/L, in yaw U0^2/L^2."""
    return np.array([1.0, 1.0, 1 / ship.length]) * ship.speed**2 / ship.length
