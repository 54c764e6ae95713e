"""The published model: low-speed MMG with the coefficients of the Esso Osaka model and its wind loads; no fit."""

import numpy as np
import torch
from esso_osaka_data import ClosedLoop

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg

AIR = 1.220
"""Density of air in the source [kg/m^3]."""
SURGE = (-0.010466204998895, -0.821991956431999, 0.060273613257498, 0.044558221361039)
"""Cosine series of C_X over 0, 1, 3, 5 times the angle."""
SWAY = (1.058172082517226, 0.002321463294909, -0.015293451706739)
"""Sine series of C_Y over 1, 3, 5 times the angle."""
YAW = (-0.030727798087410, 0.104116370350922, -8.803014758436215e-04)
"""Sine series of C_N over 1, 2, 3 times the angle."""


def wind_load(ahead: float, across: float, frontal: float, lateral: float, length: float) -> np.ndarray:
    """Wind loads by Fujiwara's series with the coefficients that the model's owners publish for it.

    Args:
        ahead: Relative wind from ahead [m/s].
        across: Relative wind from starboard [m/s].
        frontal: A_T [m^2].
        lateral: A_L [m^2].
        length: L [m].

    Returns:
        X, Y [N], N [N m]: a wind from starboard pushes to port.

    Source:
        Fujiwara, Ueno & Nimura 1998, J. Soc. Nav. Archit. Japan 183; NAOE-5thLab/mmg-1p1r-simulator (XX0 .. NN3).
    """
    pressure, g = 0.5 * AIR * (ahead**2 + across**2), np.arctan2(across, ahead)
    surge = SURGE[0] + sum(k * np.cos(i * g) for k, i in zip(SURGE[1:], (1, 3, 5), strict=True))
    sway = -sum(k * np.sin(i * g) for k, i in zip(SWAY, (1, 3, 5), strict=True))
    yaw = -sum(k * np.sin(i * g) for k, i in zip(YAW, (1, 2, 3), strict=True))
    return pressure * np.array([frontal * surge, lateral * sway, lateral * length * yaw])


class PublishedMMG:
    """The model as it is published: recordings are not looked at."""

    def fit(self, recordings: list[Recording], ship: Particulars, wind: bool) -> ClosedLoop:
        """Set the model up.

        Args:
            recordings: Not used.
            ship: Not used: the set has its own.
            wind: Whether the wind blows.

        Returns:
            The model.
        """
        del recordings, ship
        model = esso_osaka_mmg()
        areas, p, prime = model.particulars.above_water, model.particulars, model.prime
        units = np.array([prime.force, prime.force, prime.moment])
        solve, scale = model.inertia_inverse.numpy(), model.acceleration_units.numpy()

        def rate(nu: np.ndarray, helm: np.ndarray) -> np.ndarray:
            delta, n, ahead, across = helm
            with torch.no_grad():
                force = model.force_at(torch.from_numpy(nu), torch.tensor(delta), torch.tensor(n)).numpy()
            load = wind_load(ahead, across, areas.frontal, areas.lateral, p.length) if wind else 0.0
            return solve @ (force + load / units) * scale

        return ClosedLoop(rate, wind, step=0.4)
