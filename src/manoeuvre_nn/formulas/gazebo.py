"""Ships for Gazebo: added mass, linear and quadratic damping of the plugin gz-sim-hydrodynamics-system."""

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as xml

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, rate_of_state
from manoeuvre_nn.formulas.conversions import (
    Coefficients,
    ForceSamples,
    fitted,
    inertia_of,
    product_of,
    rigid_body,
)
from manoeuvre_nn.formulas.fmu import slug
from manoeuvre_nn.formulas.program import Program

SIDES = ("v", "r", "u v", "u r", "v |v|", "v |r|", "r |v|", "r |r|")
DAMPING = {"X": ("u", "u |u|", "v v", "v r", "r r"), "Y": SIDES, "N": SIDES}
"""Products that the plugin knows, by its own names: ``v |r|`` of sway is yVabsR."""
CONTROL = {"X": ("1", "d d", "u d d"), "Y": ("1", "d", "u d"), "N": ("1", "d", "u d")}
"""Products of propeller and rudder, which the plugin does not know."""
NAMESPACE = "https://manoeuvre-nn/control"
EXPLAINED = (
    "Axes of Gazebo: x forward, y to port, z up; the link's origin is midship and its centre of gravity is there.",
    "Mass and added mass are parted by the displacement and a radius of gyration of .25 L; only their sum is known.",
    "Centripetal terms of the water are among the quadratic ones, therefore disable_coriolis.",
    "Three degrees of freedom: what damps heave, roll and pitch is not here. Units are kg, m, s, N, rad.",
    "The plugin knows neither rudder nor propeller: apply force and moment of mnn:control to the link, with the rudder",
    "angle d, positive to starboard, and the forward speed u; they are about axes forward, to starboard, down.",
)


def sdf_text(program: Program, samples: ForceSamples, price: Sequence[str] = ()) -> str:
    """A model of SDFormat with the plugin's parameters.

    Args:
        program: Accelerations of a ship in calm water.
        samples: What the coefficients are fitted to.
        price: What the conversion costs, for the header.

    Returns:
        Its text.

    Source:
        Parameters and signs as gz-sim-hydrodynamics-system of Gazebo Garden and later documents and uses them: SNAME's,
        negative for added mass and damping.
    """
    assert program.vessel is not None
    hull = program.vessel.model.hull
    mass, turning = rigid_body(hull)
    forces = samples.forces.copy()  # a rigid body's own centripetal forces are the simulator's
    forces[:, 0] -= mass * samples.v * samples.r
    forces[:, 1] += mass * samples.u * samples.r
    variables = {name: getattr(samples, name) for name in "uvrd"}
    found = fitted({e: (*DAMPING[e], *CONTROL[e]) for e in "XYN"}, variables, forces)
    root = xml.Element("sdf", {"version": "1.9", "xmlns:mnn": NAMESPACE})
    model = xml.SubElement(root, "model", {"name": slug(program)})
    notes = "\n".join(f"    {harmless(line).replace('--', '- -')}" for line in (*program.notes, *price, *EXPLAINED))
    root.insert(0, xml.Comment(f"\n{notes}\n"))
    inertial = xml.SubElement(xml.SubElement(model, "link", {"name": "hull"}), "inertial")
    xml.SubElement(inertial, "mass").text = repr(mass)
    inertia = xml.SubElement(inertial, "inertia")
    narrow = mass * (0.35 * hull.particulars.beam) ** 2
    for name, value in {"ixx": narrow, "iyy": turning, "izz": turning}.items():
        xml.SubElement(inertia, name).text = repr(float(value))
    _add_plugin(model, hull, found)
    control = xml.SubElement(model, "mnn:control")
    for e, terms in CONTROL.items():
        for term in terms:
            xml.SubElement(control, "mnn:term", {"equation": e, "product": term}).text = repr(found[e][term])
    xml.indent(root)
    return '<?xml version="1.0"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def _add_plugin(model: xml.Element, hull: Ship, found: Coefficients) -> None:
    """The plugin's parameters."""
    plugin = xml.SubElement(
        model, "plugin", {"filename": "gz-sim-hydrodynamics-system", "name": "gz::sim::systems::Hydrodynamics"}
    )
    xml.SubElement(plugin, "link_name").text = "hull"
    xml.SubElement(plugin, "water_density").text = repr(hull.particulars.rho)
    xml.SubElement(plugin, "disable_coriolis").text = "true"
    for name, value in {**_added_masses(hull), **_damping(found)}.items():
        xml.SubElement(plugin, name).text = repr(float(value))


def _added_masses(hull: Ship) -> dict[str, float]:
    """Added masses, negative as derivatives are."""
    mass, turning = rigid_body(hull)
    inertia = inertia_of(hull)
    return {
        "xDotU": mass - inertia[0, 0], "yDotV": mass - inertia[1, 1], "nDotR": turning - inertia[2, 2],
        "yDotR": -inertia[1, 2], "nDotV": -inertia[2, 1],
    }  # fmt: skip


def _damping(found: Coefficients) -> dict[str, float]:
    """Damping by the plugin's names; the products are such that a turn of the axes to port changes no sign."""
    made = {}
    for e, terms in DAMPING.items():
        for term in terms:
            made[parameter(e, term)] = found[e][term]
    return made


def parameter(equation: str, term: str) -> str:
    """The plugin's name of a coefficient: ``yVabsR`` is ``v |r|`` of sway."""
    first, *more = term.split()
    more = [f"abs{token[1].upper()}" if token.startswith("|") else token.upper() for token in more]
    return f"{equation.lower()}{first.upper()}{''.join(more)}"


class GazeboShip(Model):
    """The ship that a written model of SDFormat says, moved as Gazebo and its plugin move her."""

    def __init__(self, program: Program, text: str) -> None:
        """Read the numbers back."""
        super().__init__()
        assert program.vessel is not None
        self.written, root = program.vessel.model, xml.fromstring(text)
        self.numbers = {one.tag: float(one.text or 0) for one in root.iter() if _is_number(one.text)}
        self.control: Coefficients = {e: {} for e in CONTROL}
        for one in root.iter(f"{{{NAMESPACE}}}term"):
            self.control[one.attrib["equation"]][one.attrib["product"]] = float(one.text or 0)
        n = self.numbers
        mass = torch.diag(torch.tensor([n["mass"], n["mass"], n["izz"]], dtype=torch.float64))
        added = torch.tensor(
            [[n["xDotU"], 0.0, 0.0], [0.0, n["yDotV"], n["yDotR"]], [0.0, n["nDotV"], n["nDotR"]]], dtype=torch.float64
        )
        self.mass, self.inverse = n["mass"], torch.linalg.inv(mass - added)

    @property
    def hull(self) -> Ship:
        """The ship that was written down."""
        return self.written.hull

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state by the plugin's forces, in axes that have y to port, and those of rudder and propeller."""
        u, v, r = state[..., :3].unbind(-1)
        own = self._sums(
            {"u": u, "v": -v, "r": -r}, {e: {t: self.numbers[parameter(e, t)] for t in DAMPING[e]} for e in DAMPING}
        )
        steered = self._sums({"u": u, "d": inputs.delta.expand_as(u)}, self.control)
        forces = own * own.new_tensor([1.0, -1.0, -1.0]) + steered
        centripetal = torch.stack([self.mass * v * r, -self.mass * u * r, 0.0 * r], dim=-1)
        return rate_of_state(state, (forces + centripetal) @ self.inverse.T)

    @staticmethod
    def _sums(variables: Mapping[str, Tensor], coefficients: Coefficients) -> Float[Tensor, "*batch 3"]:
        """Sums of products in each equation."""
        given = {name: values.numpy() for name, values in variables.items()}
        totals = [sum(a * product_of(term, given) for term, a in terms.items()) for terms in coefficients.values()]
        return torch.stack([torch.as_tensor(total) for total in totals], dim=-1)

    def on_approach(self, speed: float) -> "GazeboShip":
        """The same: the numbers hold for the approach speed that they were fitted at."""
        return self


def _is_number(text: str | None) -> bool:
    try:
        float(text or "")
    except ValueError:
        return False
    return True
