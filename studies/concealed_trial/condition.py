"""What changes the coefficients themselves: depth, trim, displacement, a smaller rudder, a wrong pitch, scatter.

All functions change the tables they are given. Trim, depth and displacement know which part of a printed coefficient is
the ship's mass: only the other part is hydrodynamic.
"""

from dataclasses import dataclass
from math import sqrt, tanh

import numpy as np

from studies.concealed_trial.equations import Equations, Polynomial, Tanker
from studies.concealed_trial.ships import GRAVITY, TrialShip

GYRADIUS = 0.25
"""Radius of gyration in yaw over length."""


@dataclass
class Tables:
    """Coefficients of one ship that may be changed.

    Attributes:
        ship: The ship.
        k: Hydrodynamic coefficients; the tanker's inertia is among them.
        inertia: mx, my, mz, Nvd, Yrd of a polynomial ship.
        resistance_gain: Calm-water resistance over its nominal value.
        pitch_gain: Thrust over its nominal value.
    """

    ship: TrialShip
    k: dict[str, float]
    inertia: dict[str, float]
    resistance_gain: float = 1.0
    pitch_gain: float = 1.0

    @classmethod
    def of(cls, ship: TrialShip) -> "Tables":
        """The nominal ship.

        Args:
            ship: The ship.

        Returns:
            Copies of its tables.
        """
        return cls(ship, dict(ship.model["coefficients"]), dict(ship.model.get("inertia", {})))

    def equations(self) -> Equations:
        """The equations with these coefficients.

        Returns:
            Equations of motion.
        """
        return Tanker(self.ship, self.k) if self.ship.is_tanker else Polynomial(self.ship, self.k, self.inertia)

    def scale(self, names: list[str], factor: float, mass_part: float = 0.0) -> None:
        """Multiply coefficients, but not the mass in them.

        Args:
            names: Which ones; those that the ship does not have are passed over.
            factor: By how much.
            mass_part: What of them is mass.
        """
        for name in names:
            if name in self.k:
                self.k[name] = mass_part + factor * (self.k[name] - mass_part)


def change_displacement(tables: Tables, factor: float) -> None:
    """Another mass: inertia and the mass terms of the equations.

    Args:
        tables: Changed in place.
        factor: Mass over nominal mass.
    """
    extra, ship = factor - 1.0, tables.ship
    k, inertia = tables.k, tables.inertia
    if ship.is_tanker:
        k["m11"] += extra
        k["m22"] += extra
        k["m33"] += extra * GYRADIUS**2
        k["Xvr"] += extra
        k["Yur"] -= extra
        return
    mass = extra * ship.mass_prime
    inertia["mx"] += mass
    inertia["my"] += mass
    inertia["mz"] += mass * GYRADIUS**2
    k["Xvr"] += mass
    k["Yr"] -= mass


def change_trim(tables: Tables, trim_m: float) -> None:
    """Trim by the stern.

    Args:
        tables: Changed in place.
        trim_m: Draught aft minus draught forward [m].

    Source:
        Inoue, Hirano & Kijima 1981: Yv (1 + 0.67 t), Yr (1 + 0.80 t), Nv (1 - 0.27 t Yv/Nv), Nr (1 + 0.30 t), with
        t the trim over mean draught.
    """
    ship, t = tables.ship, trim_m / tables.ship.draught
    sway, yaw, turn, mass = ("Yuv", "Nuv", "Yur", -1.0) if ship.is_tanker else ("Yv", "Nv", "Yr", -ship.mass_prime)
    arm = tables.k[yaw] / tables.k[sway]
    tables.scale([sway], 1 + 0.67 * t)
    tables.scale([yaw], 1 - 0.27 * t / arm)
    tables.scale([turn], 1 + 0.80 * t, mass)
    tables.scale(["Nur" if ship.is_tanker else "Nr"], 1 + 0.30 * t)


def change_depth(tables: Tables, depth_m: float) -> None:
    """Shallow water: the tanker by the terms of its set, the others by Kijima's factors.

    Args:
        tables: Changed in place.
        depth_m: Water depth [m].

    Raises:
        ValueError: If the ship is aground.
    """
    if depth_m <= tables.ship.draught:
        raise ValueError(f"depth {depth_m:g} m: the draught is {tables.ship.draught:g} m")
    (tanker_at_depth if tables.ship.is_tanker else _kijima)(tables, depth_m)


def tanker_at_depth(tables: Tables, depth_m: float) -> None:
    """The tanker's coefficients with ``zeta = T/(h - T)`` taken in.

    Args:
        tables: Changed in place.
        depth_m: Water depth [m].

    Source:
        Van Berlekom & Goddard 1972.
    """
    k, draught = tables.k, tables.ship.draught
    zeta = draught / (depth_m - draught)
    for name in ("Xuu", "Xvr", "Yur", "Yvv", "Yccbbd", "Nur", "Nuv", "Nvr", "Nccbbd"):
        k[name] += k[f"{name}z"] * zeta
    k["Xvv"] += k["Xvvzz"] * zeta**2
    k["Yuv"] += 0.0 if zeta < 0.8 else -0.85 * (1 - 0.8 / zeta) * zeta
    for inertia, name in (("m11", "Xudz"), ("m22", "Yvdz"), ("m33", "Nrdz")):
        k[inertia] -= k[name] * zeta


def _kijima(tables: Tables, depth_m: float) -> None:
    """Factors (1 - T/h)^-q - T/h of the linear derivatives, and more added mass and resistance.

    Source:
        Kijima et al. 1990 for q of Yv, Nv and Nr, from memory for Nv; Yr takes the factor of Nr. The factors of the
        added masses follow the trend of van Berlekom & Goddard's tanker, the resistance that of Lackenby 1963 in
        the form dV/V = 1 - sqrt(tanh(g h/V^2)).
    """
    ship = tables.ship
    ratio, fullness = ship.draught / depth_m, ship.particulars["block_coefficient"] * ship.beam / ship.draught
    zeta = ratio / (1 - ratio)
    mass = ship.mass_prime

    def factor(q: float) -> float:
        return (1 - ratio) ** -q - ratio

    turn = factor(1.5 - 14.28 * ship.draught / ship.length)
    tables.scale(["Yv", "Yvvv"], factor(0.40 * fullness))
    tables.scale(["Nv"], factor(0.425 * fullness))
    tables.scale(["Yr"], turn, -mass)
    tables.scale(["Nr"], turn)
    inertia = tables.inertia
    inertia["my"] = mass + (inertia["my"] - mass) * (1 + 0.38 * zeta)
    gyration = mass * GYRADIUS**2
    inertia["mz"] = gyration + (inertia["mz"] - gyration) * (1 + 0.15 * zeta)
    tables.resistance_gain *= tanh(GRAVITY * depth_m / ship.speed**2) ** -1.0


def lose_rudder(tables: Tables, fraction: float) -> None:
    """Less rudder force at all angles.

    Args:
        tables: Changed in place.
        fraction: What is lost.
    """
    names = [
        name for name in tables.k if name[0] in "XYN" and "d" in name[1:] and name[1:] not in {"udz", "vdz", "rdz"}
    ]
    tables.scale(names, 1 - fraction)


def change_pitch(tables: Tables, fraction: float) -> None:
    """Another thrust at the same shaft speed.

    Args:
        tables: Changed in place.
        fraction: Deviation of the thrust.
    """
    tables.pitch_gain *= 1 + fraction
    if tables.ship.is_tanker:
        tables.k["pitch"] = tables.pitch_gain


def scatter(tables: Tables, relative_sd: float, rng: np.random.Generator, correlation: float = 0.6) -> None:
    """Coefficients that are a little off, those of one term in Y and N together.

    Args:
        tables: Changed in place.
        relative_sd: Relative standard deviation.
        rng: Source of chance.
        correlation: Of the errors of one term in Y and N.
    """
    terms = sorted({name[1:] for name in tables.k if name[0] in "XYN" and not name.endswith("z")})
    shared, own = sqrt(correlation), sqrt(1 - correlation)
    for term in terms:
        common = rng.standard_normal()
        for equation in "XYN":
            error = rng.standard_normal() if equation == "X" else shared * common + own * rng.standard_normal()
            tables.scale([equation + term], 1 + relative_sd * error)
