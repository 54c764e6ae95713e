"""A ship's own products as the closed-loop fit sees them: published coefficients are the prior."""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.ship.tanker import TankerShip

MIN_RELATIVE_SD = 0.02
"""Standard deviation of a published coefficient over the largest effect of its equation, where it is small itself."""


class ProductsForce:
    """Accelerations of a ship's own products in units of L and the approach speed.

    Of the tanker family the coefficients are those of its table in the BIS system (Yuv, Yccd, ...), the thrust's among
    them as ``1 - t``, ``YT`` and ``NT``; of a Taylor series the factors of the bare products, the rudder as the source
    counts it.

    Attributes:
        names: Output (0 X, 1 Y, 2 N) and product of each coefficient that the ship has.
        count: Number of them.
        published: Their values.
    """

    def __init__(self, ship: Ship) -> None:
        """Take a ship apart.

        Args:
            ship: The ship.

        Raises:
            InputError: If its forces are no sum of products.
        """
        if ship.table is None:
            raise InputError(f"terms=own: the forces of the {ship.particulars.name} are no sum of known products")
        self.ship, self.table = ship, ship.table.detach().double()
        used = self.table.T.nonzero().numpy()
        self._outputs, self._products = used[:, 0], used[:, 1]
        self._shaft = isinstance(ship, TankerShip)
        self._unit = ship.prime.speed**2 if self._shaft else 1.0
        written = ship.terms if self._shaft else [" ".join(t).replace("u", "a") or "1" for t in ship.terms]
        self.names = [(int(o), written[k]) for o, k in used]
        self.count = len(self.names)
        self.published = (self.table.numpy()[self._products, self._outputs] * self._unit).copy()
        p = ship.particulars
        unit = np.array([1.0, 1.0, 1 / p.length]) * p.speed**2 / p.length
        push = ship.acceleration_from_force(ship.velocity_units.expand(3, 3), torch.eye(3).to(ship.inertia))
        self._push = push.double().numpy() / unit / self._unit
        self._scale = torch.tensor([p.speed, p.speed, p.speed / p.length], dtype=torch.float64)

    def columns(
        self, state: Float[np.ndarray, "n 6"], inputs: Mapping[str, Float[np.ndarray, " n"]]
    ) -> Float[np.ndarray, "n 3 p"]:
        """Accelerations for coefficients of 1.

        Args:
            state: u, v, r, x, y, psi.
            inputs: ``delta`` [rad], ``n`` over the ship's own shaft speed where the family knows it.

        Returns:
            Columns.
        """
        nu, delta = torch.as_tensor(state[:, :3].copy()) * self._scale, torch.as_tensor(inputs["delta"])
        with torch.no_grad():
            if isinstance(self.ship, TankerShip):
                products = self.ship.products(nu, delta, torch.as_tensor(inputs["n"]))
            else:
                products = self.ship.products(nu, delta)
        return products.double().numpy()[:, None, self._products] * self._push[self._outputs].T[None]

    def prior(self, relative: float) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """The published values and how far they are believed.

        Args:
            relative: Standard deviation over the value; small values get some of what their equation's largest has.

        Returns:
            Mean and standard deviation.

        Raises:
            InputError: If ``relative`` is not positive.
        """
        if not relative > 0:
            raise InputError(f"fit.prior.relative={relative}: expected more than 0")
        sizes = np.abs(self.published)
        largest = np.array([sizes[self._outputs == o].max(initial=0.0) for o in range(3)])
        return self.published, relative * np.maximum(sizes, MIN_RELATIVE_SD * largest[self._outputs])

    def with_coefficients(self, values: Float[np.ndarray, " p"]) -> Float[torch.Tensor, "terms 3"]:
        """The ship's table with other coefficients.

        Args:
            values: In the order of :attr:`names`.

        Returns:
            One row a product, as :attr:`.Ship.table`.
        """
        table = self.table.clone()
        table[self._products, self._outputs] = torch.as_tensor(values / self._unit)
        return table

    @property
    def particulars(self) -> Particulars:
        """Those of the ship."""
        return self.ship.particulars
