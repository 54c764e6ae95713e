"""Ships in the form of mariner.m of the Marine Systems Simulator: Abkowitz' series about the approach speed."""

import re
from collections.abc import Sequence

import numpy as np

from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.prime import length_system
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.formulas.conversions import ForceSamples, fitted, inertia_of, rigid_body
from manoeuvre_nn.formulas.fmu import slug
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.ship.taylor import TaylorShip

SIDES = ("v", "r", "v v v", "v v r", "v u", "r u", "d", "d d d", "u d", "u u d", "v d d", "v v d", "1", "u", "u u")
TERMS = {
    "X": ("u", "u u", "u u u", "v v", "r r", "r v", "d d", "u d d", "v d", "u v d"), "Y": SIDES, "N": SIDES,
}  # fmt: skip
"""Products of mariner.m: Chislett & Stroem-Tejsen 1965."""
CONSTANTS = {"1": "0", "u": "0u", "u u": "0uu"}
"""Products of sway and yaw that a ship with one screw has on a straight course, and how mariner.m calls them."""
NUMBER = re.compile(r"^(\w+) = ([-+.\deE]+);", re.MULTILINE)


def mss_text(program: Program, samples: ForceSamples, price: Sequence[str] = ()) -> str:
    """A function of MATLAB with states, input, signs and names as those of mariner.m.

    Args:
        program: Accelerations of a ship in calm water.
        samples: What the coefficients are fitted to.
        price: What the conversion costs, for the header.

    Returns:
        Its text.
    """
    assert program.vessel is not None
    hull, name = program.vessel.model.hull, slug(program)
    p, values = hull.particulars, _values(hull, samples)
    written = [f"{key} = {value!r};" for key, value in values.items()]
    comments = [harmless(line).replace("\n", " ") for line in (*program.notes, *price)]
    return "\n".join([
        f"function [xdot,U] = {name}(x,ui,U0)",
        f"% [xdot,U] = {name}(x,ui,U0): the {harmless(p.name)} in the form of mariner.m of MSS.",
        *(f"% {line}" for line in comments),
        *EXPLAINED.splitlines(),
        f"if nargin < 3, U0 = {p.speed!r}; end", *written, *EQUATIONS.splitlines(), "",
    ])  # fmt: skip


def _values(hull: Ship, samples: ForceSamples) -> dict[str, float]:
    """All numbers by the names of mariner.m."""
    p = hull.particulars
    prime = length_system(p.length, p.speed, p.rho)
    speed = np.hypot(samples.u, samples.v)
    variables = {"u": (samples.u - p.speed) / speed, "v": samples.v / speed, "r": samples.r * p.length / speed}
    units = np.array([prime.force, prime.force, prime.moment]) * (speed[:, None] / p.speed) ** 2
    found = fitted(TERMS, {**variables, "d": -samples.d}, samples.forces / units)
    mass, turning = rigid_body(hull)
    scale = prime.mass * p.length ** np.array([[0, 0, 1], [0, 0, 1], [1, 1, 2]])
    inertia, m, iz = inertia_of(hull) / scale, mass / prime.mass, turning / (prime.mass * p.length**2)
    values = {"L": p.length, "m": m, "Iz": iz, "xG": 0.0}
    values |= {"delta_max": p.rudder_limit / DEGREE, "Ddelta_max": p.rudder_rate / DEGREE}
    values |= {"Xudot": m - inertia[0, 0], "Yvdot": m - inertia[1, 1], "Yrdot": -inertia[1, 2]}
    values |= {"Nvdot": -inertia[2, 1], "Nrdot": iz - inertia[2, 2]}
    values |= {_name(e, term): value for e, terms in found.items() for term, value in terms.items()}
    return {key: float(value) for key, value in values.items()}


def _name(equation: str, term: str) -> str:
    """``Yvvr``; of what does not change with v, r and the rudder ``Y0u``."""
    return equation + (CONSTANTS[term] if equation != "X" and term in CONSTANTS else term.replace(" ", ""))


def mss_ship(program: Program, text: str) -> Model:
    """The ship that a written function says, read back from its numbers."""
    assert program.vessel is not None
    p = program.vessel.model.particulars
    values = {name: float(number) for name, number in NUMBER.findall(text)}
    inertia = {
        "mx": values["m"] - values["Xudot"], "my": values["m"] - values["Yvdot"],
        "Yrdot": values["Yrdot"], "Nvdot": values["Nvdot"], "mz": values["Iz"] - values["Nrdot"],
    }  # fmt: skip
    coefficients = {
        e: {"".join(term.replace("1", "0").split()): values[_name(e, term)] for term in terms}
        for e, terms in TERMS.items()
    }
    return CalmWater(TaylorShip(
        p, inertia, coefficients, positive_rudder_turns_to="port", taylor=False, scaling="instantaneous",
        prime=length_system(p.length, p.speed, p.rho),
    ))  # fmt: skip


EXPLAINED = """\
% x = [u v r x y psi delta]': u about U0, v [m/s], r [rad/s], x north, y east [m], psi [rad], rudder delta [rad], which
% is positive to port; ui is the ordered angle [rad], positive turns to starboard. xdot is the rate of x, U the speed
% [m/s]. Coefficients are those of the (rho, L, U) system, by least squares to runs of the model. Mass and added mass
% are parted by the displacement and a radius of gyration of .25 L; only their sum is known."""
EQUATIONS = """\
U = sqrt((U0 + x(1))^2 + x(2)^2);
u = x(1)/U; v = x(2)/U; r = x(3)*L/U; psi = x(6); delta = x(7);
delta_c = max(min(-ui, delta_max*pi/180), -delta_max*pi/180);
delta_dot = max(min(delta_c - delta, Ddelta_max*pi/180), -Ddelta_max*pi/180);
m11 = m - Xudot; m22 = m - Yvdot; m23 = m*xG - Yrdot; m32 = m*xG - Nvdot; m33 = Iz - Nrdot;
X = Xu*u + Xuu*u^2 + Xuuu*u^3 + Xvv*v^2 + Xrr*r^2 + Xrv*r*v + Xdd*delta^2 + Xudd*u*delta^2 + Xvd*v*delta ...
    + Xuvd*u*v*delta;
Y = Yv*v + Yr*r + Yvvv*v^3 + Yvvr*v^2*r + Yvu*v*u + Yru*r*u + Yd*delta + Yddd*delta^3 + Yud*u*delta ...
    + Yuud*u^2*delta + Yvdd*v*delta^2 + Yvvd*v^2*delta + Y0 + Y0u*u + Y0uu*u^2;
N = Nv*v + Nr*r + Nvvv*v^3 + Nvvr*v^2*r + Nvu*v*u + Nru*r*u + Nd*delta + Nddd*delta^3 + Nud*u*delta ...
    + Nuud*u^2*delta + Nvdd*v*delta^2 + Nvvd*v^2*delta + N0 + N0u*u + N0uu*u^2;
det = m22*m33 - m23*m32;
xdot = [ X*(U^2/L)/m11
         (m33*Y - m23*N)*(U^2/L)/det
         (m22*N - m32*Y)*(U^2/L^2)/det
         (cos(psi)*(U0/U + u) - sin(psi)*v)*U
         (sin(psi)*(U0/U + u) + cos(psi)*v)*U
         r*(U/L)
         delta_dot ];
end"""
