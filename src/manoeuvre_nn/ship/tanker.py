"""Large tankers: propeller, rudder in the propeller race and shallow water in the BIS system."""

from collections.abc import Mapping
from math import inf
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.prime import bis_system
from manoeuvre_nn.core.ship import Particulars, Ship, check_speed
from manoeuvre_nn.core.units import RPM


class TankerShip(Ship):
    """Van Berlekom & Goddard's tanker model.

    With n [1/s], ``beta = v/u``, ``gT = Tuu u^2/L + Tun u n + L Tnn |n| n``, ``c^2 = cun u n + cnn n^2`` and
    ``zeta = T/(h - T)``, the accelerations [m/s^2] that the forces make are

        X: [(Xuu + Xuuz zeta) u^2 + L (Xvr + Xvrz zeta) v r + (Xvv + Xvvzz zeta^2) v^2 + Xccdd c^2 d^2
            + Xccbd c^2 beta d + L gT (1 - t)] / L
        Y: [(Yuv + Yuvz zeta) u v + (Yvv + Yvvz zeta) |v| v + Yccd c^2 d + L (Yur + Yurz zeta) u r
            + (Yccbbd + Yccbbdz zeta) c^2 |beta| beta |d| + L YT gT] / L
        N: [(Nuv + Nuvz zeta) u v + L (Nvr + Nvrz zeta) |v| r + Nccd c^2 d + L (Nur + Nurz zeta) u r
            + (Nccbbd + Nccbbdz zeta) c^2 |beta| beta |d| + L NT gT] / L^2

    with d positive to port, and are divided by ``1 - Xudot - Xudz zeta`` and so on. ``|c| c`` is written c^2: the set
    holds for a propeller that turns ahead on a ship that moves ahead.

    Attributes:
        rpm: Shaft speed [rpm], constant in a manoeuvre.
        depth: Water depth h [m]; ``inf`` is deep water.

    Source:
        Van Berlekom & Goddard 1972; Rajesh & Bhattacharyya 2009, eqs 1-15, read as follows: n in rev/s; eq 13 has
        ``Xvvzz zeta^2``; "Y_rdot .04" of Table 1 is YT, "N_rdot -.02" is NT, "Yv zeta" is Yvdot zeta.
    """

    def __init__(
        self,
        particulars: Particulars,
        volume: float,
        coefficients: Mapping[str, float],
        *,
        rpm: float,
        self_propulsion: float,
        depth: float = inf,
        shaft: Literal["hold", "similarity"] = "hold",
        dtype: torch.dtype = torch.float64,
    ) -> None:
        """Build a tanker from its table.

        Args:
            particulars: Main dimensions and steering gear.
            volume: Displaced volume [m^3].
            coefficients: The table of the source; sums such as ``1 + Xvr`` under the name of the derivative.
            rpm: Shaft speed [rpm].
            self_propulsion: Speed that this shaft speed keeps up on a straight course in deep water [m/s].
            depth: Water depth h [m].
            shaft: What the shaft does at another approach speed: ``hold`` keeps its rpm (the ship speeds up in the
                manoeuvre, as in the paper), ``similarity`` scales it with the speed.
            dtype: Floating type.

        Raises:
            InputError: If the water is not deeper than the draught or ``shaft`` is unknown.
        """
        if not depth > particulars.draught:
            raise InputError(
                f"ship.depth={depth} m; the {particulars.name} draws {particulars.draught} m: write a larger depth"
            )
        check_choice("ship.shaft", shaft, ["hold", "similarity"])
        zeta = particulars.draught / (depth - particulars.draught)
        k = dict(coefficients)
        inertia = [k["m11"] - k["Xudz"] * zeta, k["m22"] - k["Yvdz"] * zeta, k["m33"] - k["Nrdz"] * zeta]
        prime = bis_system(particulars.length, particulars.rho * volume)
        super().__init__(particulars, prime, torch.diag(torch.tensor(inertia, dtype=dtype)))
        self.volume, self.coefficients, self.rpm, self.self_propulsion = (
            volume,
            coefficients,
            rpm,
            self_propulsion,
        )
        self.depth, self.shaft, self.zeta = depth, shaft, zeta
        # A buffer, so that tankers in different depths or at different rpm can be rows of one batch.
        values = _at_depth(k, zeta) | {"n": rpm * RPM}
        self._names = tuple(values)
        self.register_buffer("table", torch.tensor(list(values.values()), dtype=dtype))

    @property
    def k(self) -> dict[str, Tensor]:
        """Coefficients at this depth, and the shaft speed n [1/s]."""
        return dict(zip(self._names, self.table.unbind(), strict=True))

    def thrust(self, u: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        """Propeller thrust over mass, gT.

        Args:
            u: Forward speed [m/s].

        Returns:
            gT [m/s^2].
        """
        k, length = self.k, self.particulars.length
        n = k["n"]
        return k["Tuu"] * u.square() / length + k["Tun"] * u * n + length * k["Tnn"] * n.abs() * n

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides over g (X, Y) and over g/L (N).

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            f'' [-] in the BIS system.
        """
        k, length = self.k, self.particulars.length
        n = k["n"]
        u, v, r, d = nu[..., 0], nu[..., 1], nu[..., 2], -delta
        beta, race = v / u, k["cun"] * u * n + k["cnn"] * n.square()
        thrust = length * self.thrust(u)
        cross = race * beta.abs() * beta * d.abs()
        uv, ur, vv, cd = u * v, length * u * r, v.abs() * v, race * d
        surge = k["Xuu"] * u.square() + length * k["Xvr"] * v * r + k["Xvv"] * v.square() + (1 - k["t"]) * thrust
        surge = surge + k["Xccdd"] * race * d.square() + k["Xccbd"] * race * beta * d
        sway = k["Yuv"] * uv + k["Yvv"] * vv + k["Yccd"] * cd + k["Yur"] * ur + k["Yccbbd"] * cross
        yaw = k["Nuv"] * uv + length * k["Nvr"] * v.abs() * r + k["Nccd"] * cd + k["Nur"] * ur
        yaw = yaw + k["Nccbbd"] * cross
        per_mass = torch.stack([surge, sway + k["YT"] * thrust, yaw + k["NT"] * thrust], dim=-1)
        return per_mass / self.prime.speed**2

    def on_approach(self, speed: float) -> "TankerShip":
        """The tanker at another approach speed; the forces are as they are, ``shaft`` says what the propeller does.

        Args:
            speed: Approach speed [m/s].

        Returns:
            A new ship.
        """
        check_speed(self.particulars, speed)
        rpm = self.rpm * speed / self.self_propulsion if self.shaft == "similarity" else self.rpm
        return TankerShip(
            self.particulars.at_speed(speed),
            self.volume,
            self.coefficients,
            rpm=rpm,
            self_propulsion=speed if self.shaft == "similarity" else self.self_propulsion,
            depth=self.depth,
            shaft=self.shaft,
            dtype=self.inertia.dtype,
        )


def _at_depth(k: Mapping[str, float], zeta: float) -> dict[str, float]:
    """Coefficients with the depth terms taken in: ``Xvr + Xvrz zeta`` and so on."""
    yuvz = 0.0 if zeta < 0.8 else -0.85 * (1 - 0.8 / zeta)  # Rajesh 2009, Table 1
    deep = dict(k)
    for name in ("Xuu", "Xvr", "Yur", "Yvv", "Yccbbd", "Nur", "Nuv", "Nvr", "Nccbbd"):
        deep[name] = k[name] + k[f"{name}z"] * zeta
    deep["Xvv"] = k["Xvv"] + k["Xvvzz"] * zeta**2
    deep["Yuv"] = k["Yuv"] + yuvz * zeta
    return deep
