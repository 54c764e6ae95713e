"""What the inputs of a ship's program are to who integrates it: states, inputs and parameters."""

from manoeuvre_nn.formulas.motion import HEADING, MOTION
from manoeuvre_nn.formulas.program import Program, Quantity

OWN = "own_"
"""How names of states of the effects' own begin."""
PLACE = (Quantity("x", "m", "position, north"), Quantity("y", "m", "position, east"))


def state_of(program: Program) -> list[Quantity]:
    """u, v, r, x, y, psi and states of the effects' own, as the program describes them where it takes them."""
    given = {q.name: q for q in program.inputs}
    own = [q for q in program.inputs if q.name.startswith(OWN) and f"{q.name}dot" in {o.name for o in program.outputs}]
    return [*(given.get(q.name, q) for q in (*MOTION[:3], *PLACE, HEADING)), *own]


def parameters_of(program: Program) -> list[Quantity]:
    """What is chosen once for a run."""
    return [q for q in program.inputs if q.parameter]


def rate_of(q: Quantity) -> Quantity:
    """The rate of a state, as an output."""
    unit = {"m/s": "m/s^2", "rad/s": "rad/s^2", "-": "1/s"}.get(q.unit, f"{q.unit}/s")
    return Quantity(f"{q.name}dot", unit, f"rate of {q.name}")
