"""Equations of motion of the trial's ships for many runs at once; nothing of the package's own ships is used.

Speeds u, v [m/s] are through the water, r [rad/s]; rudder angle d [rad] is positive to **port**; n [rpm].
"""

from collections.abc import Mapping
from math import factorial

import numpy as np

from studies.concealed_trial.ships import RHO, TrialShip

VARIABLES = "uvrd"
"""The letters of a Taylor coefficient's name, after that of the equation."""
EQUATIONS = ("X", "Y", "N")


class Polynomial:
    """Third-order Taylor model with constant scaling speed U0.

    With ``a = (u - U0)/U0``, ``b = v/U0``, ``q = r L/U0`` and F = 0.5 rho L T U0^2, a coefficient such as Yrvv stands
    with ``q b^2 / 2!``; external forces are divided by F, moments by F L.

    Source:
        Chislett & Strom-Tejsen 1965 (Mariner), Fedyaevskii & Sobolev's form as used for the Great Lakes bulk carrier.
    """

    def __init__(self, ship: TrialShip, coefficients: Mapping[str, float], inertia: Mapping[str, float]) -> None:
        """Collect the terms of the three equations in one table.

        Args:
            ship: The ship.
            coefficients: Xuu, Yc0, Nrvv and so on.
            inertia: mx, my, mz, Nvd, Yrd.
        """
        self.ship, length = ship, ship.length
        terms = sorted({name[1:] for name in coefficients})
        powers = [[1 + VARIABLES.index(letter) for letter in term if letter in VARIABLES] for term in terms]
        powers = [([0, 0, 0] + (p if term != "c0" else []))[-3:] for p, term in zip(powers, terms, strict=True)]
        self.first, self.second, self.third = np.array(powers).T
        taylor = [_taylor_divisor(term) for term in terms]
        table = [[coefficients.get(e + t, 0.0) / w for t, w in zip(terms, taylor, strict=True)] for e in EQUATIONS]
        mass = np.zeros((3, 3))
        mass[0, 0] = inertia["mx"]
        mass[1, 1:] = [inertia["my"], -inertia["Yrd"] * length]
        mass[2, 1:] = [-inertia["Nvd"], inertia["mz"] * length]
        per_unit = ship.speed**2 / length * np.linalg.inv(mass)
        self.table = per_unit @ np.array(table)
        self.external = per_unit / (ship.force_unit * np.array([1.0, 1.0, length]))
        slope = ship.model["thrust_slope"]
        self.shaft = per_unit[0, 0] * ship.resistance / ship.force_unit * np.array([1 + slope, slope])

    def accelerations(self, u, v, r, d, n, forces) -> np.ndarray:
        """Accelerations.

        Args:
            u: Forward speed [m/s], one for each run, as all that follow.
            v: Sway speed [m/s].
            r: Yaw rate [rad/s].
            d: Rudder angle [rad].
            n: Shaft speed [rpm].
            forces: External X, Y [N], N [N m]; 3 rows.

        Returns:
            du/dt, dv/dt [m/s^2], dr/dt [rad/s^2]; 3 rows.
        """
        ship, z = self.ship, np.empty((5, u.size))
        z[0] = 1.0
        np.subtract(u / ship.speed, 1.0, out=z[1])
        np.divide(v, ship.speed, out=z[2])
        np.multiply(r, ship.length / ship.speed, out=z[3])
        z[4] = d
        found = self.table @ (z[self.first] * z[self.second] * z[self.third]) + self.external @ forces
        turns = n / ship.rpm
        found[0] += self.shaft[0] * (turns * turns - 1.0) - self.shaft[1] * (turns - 1.0) * (1.0 + z[1])
        return found

    def thrust(self, u, n) -> np.ndarray:
        """Net thrust [N]: resistance at U0 and nominal rpm.

        Args:
            u: Forward speed [m/s].
            n: Shaft speed [rpm].

        Returns:
            One value for each run.
        """
        turns, slope = n / self.ship.rpm, self.ship.model["thrust_slope"]
        return self.ship.resistance * turns * ((1 + slope) * turns - slope * u / self.ship.speed)


def _taylor_divisor(term: str) -> int:
    """The factorials of a term's powers: 2 for ``rvv``."""
    return int(np.prod([factorial(term.count(letter)) for letter in set(term)]))


class Tanker:
    """Van Berlekom & Goddard's tanker with propeller, rudder in the race and shallow water.

    ``zeta = T/(h - T)`` enters through the coefficients (:func:`studies.concealed_trial.condition.tanker_at_depth`).

    Source:
        Van Berlekom & Goddard 1972; Norrbin's bis system.
    """

    def __init__(self, ship: TrialShip, coefficients: Mapping[str, float]) -> None:
        """Collect the terms of the three equations in one table.

        Args:
            ship: The ship.
            coefficients: The set, at the depth in question.
        """
        self.ship, self.k, length = ship, dict(coefficients), ship.length
        k = self.k
        none = [0.0] * 5
        surge = [k["Xuu"], k["Xvr"], k["Xvv"], k["Xccdd"], k["Xccbd"], length * (1 - k["t"]), *none, 0.0]
        sway = [*none, length * k["YT"], k["Yuv"], k["Yvv"], k["Yccd"], k["Yur"], k["Yccbbd"], 0.0]
        yaw = [*none, length * k["NT"], k["Nuv"], 0.0, k["Nccd"], k["Nur"], k["Nccbbd"], k["Nvr"]]
        per_unit = np.diag([1 / k["m11"], 1 / k["m22"], 1 / (k["m33"] * length)]) / length
        self.table = per_unit @ np.array([surge, sway, yaw])
        scale = RHO * ship.model["volume"] / length * np.array([1.0, 1.0, length])
        self.external = per_unit / scale
        self.thrust_gain = k.get("pitch", 1.0)

    def accelerations(self, u, v, r, d, n, forces) -> np.ndarray:
        """Accelerations; arguments as for :meth:`Polynomial.accelerations`.

        Args:
            u: Forward speed [m/s].
            v: Sway speed [m/s].
            r: Yaw rate [rad/s].
            d: Rudder angle [rad].
            n: Shaft speed [rpm].
            forces: External X, Y [N], N [N m]; 3 rows.

        Returns:
            du/dt, dv/dt [m/s^2], dr/dt [rad/s^2]; 3 rows.
        """
        k, turns, q = self.k, n / 60.0, r * self.ship.length
        beta, across = v / u, np.abs(v)
        race = turns * (k["cun"] * u + k["cnn"] * turns)
        rudder = race * d
        products = np.empty((12, u.size))
        products[0] = u * u
        products[1] = v * q
        products[2] = v * v
        products[3] = rudder * d
        products[4] = rudder * beta
        products[5] = self._specific_thrust(u, turns)
        products[6] = u * v
        products[7] = across * v
        products[8] = rudder
        products[9] = u * q
        products[10] = np.abs(products[4]) * beta
        products[11] = across * q
        return self.table @ products + self.external @ forces

    def _specific_thrust(self, u, turns) -> np.ndarray:
        """Thrust over mass gT [m/s^2]; ``turns`` in rev/s."""
        k, length = self.k, self.ship.length
        series = k["Tuu"] / length * u * u + k["Tun"] * u * turns + length * k["Tnn"] * turns * turns
        return self.thrust_gain * series

    def thrust(self, u, n) -> np.ndarray:
        """Net thrust (1 - t) T [N].

        Args:
            u: Forward speed [m/s].
            n: Shaft speed [rpm].

        Returns:
            One value for each run.
        """
        return RHO * self.ship.model["volume"] * (1 - self.k["t"]) * self._specific_thrust(u, n / 60.0)


Equations = Polynomial | Tanker
