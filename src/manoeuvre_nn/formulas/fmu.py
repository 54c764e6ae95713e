"""Ships as units of co-simulation by FMI 2.0: generated C, its description, and a binary where there is a compiler."""

import io
import math
import platform
import re
import sys
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree as xml

import torch

from manoeuvre_nn import __version__
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.units import DEGREE, RPM
from manoeuvre_nn.dynamics.limits import MAX_PRIME_VELOCITIES
from manoeuvre_nn.dynamics.rollout import STEPS_PER_LENGTH
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.check import compiled
from manoeuvre_nn.formulas.code import c_text
from manoeuvre_nn.formulas.program import Program, Quantity
from manoeuvre_nn.formulas.state import parameters_of, state_of

UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1}, "s": {"s": 1}, "m/s": {"m": 1, "s": -1}, "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1},
    "deg": {"rad": 1, "factor": DEGREE}, "kN": {"kg": 1, "m": 1, "s": -2, "factor": 1e3}, "1": {},
    "rev/min": {"rad": 1, "s": -1, "factor": 2 * math.pi * RPM},
    "m/s per hour": {"m": 1, "s": -2, "factor": 1 / 3600},
}  # fmt: skip
"""Unit -> exponents of the base units of SI, and the factor to it."""
SPARE = 1e9
"""What stands for no bound in the table of ranges."""
MACHINE, FOLDER = ("linux", "x86_64"), "linux64"
"""Operating system and processor that a binary is compiled on and for, and what FMI calls them."""
FILES = ("fmu.c", "fmi2.h")
ZIP_DATE = (1980, 1, 1, 0, 0, 0)
"""Date in the archive, so that the same model is the same file."""


@dataclass(frozen=True)
class Signal:
    """A variable of the unit.

    Attributes:
        constant: What it is called in C.
        quantity: Name, unit, meaning, start value and range.
        kind: ``state``, ``output``, ``input``, ``tunable`` or ``fixed``.
    """

    constant: str
    quantity: Quantity
    kind: str


def fmu_bytes(program: Program) -> bytes:
    """A unit of co-simulation.

    Args:
        program: Accelerations of a ship.

    Returns:
        The archive: modelDescription.xml, sources, and a binary for this machine where there is a compiler of C.

    Raises:
        InputError: If it is not of a ship.
    """
    if not program.gives_rates:
        raise InputError(
            "format=fmu is for models of a ship's motion; a response is no system over time, and a recursive network "
            "takes steps of its own length: write format=c"
        )
    signals, name = signals_of(program), slug(program)
    sources = {
        **{file: (resources.files("manoeuvre_nn.formulas") / "fmi2" / file).read_text("utf-8") for file in FILES},
        "accelerations.c": c_text(program).replace("\nvoid accelerations(", "\nstatic void accelerations("),
    }
    # Of everything that the numbers depend on: a unit is never taken for another one.
    content = "".join([*sources.values(), _model_header(program, signals, "")])
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, content)}}}"
    sources["model.h"] = _model_header(program, signals, guid)
    files: dict[str, str | bytes] = {"modelDescription.xml": _description(program, signals, name, guid)}
    files |= {f"sources/{file}": text for file, text in sources.items()}
    if (sys.platform, platform.machine()) == MACHINE:
        with TemporaryDirectory() as scratch:
            library = compiled(sources, "fmu.c", Path(scratch), "-O2", "-fvisibility=hidden")
            files |= {} if library is None else {f"binaries/{FOLDER}/{name}.so": library.read_bytes()}
    return _zipped(files)


def slug(program: Program) -> str:
    """A ship's name as a name of files and of C."""
    assert program.vessel is not None
    words = re.sub(r"\W+", "_", program.vessel.model.particulars.name, flags=re.ASCII).strip("_").lower()
    return words if words[:1].isalpha() else f"ship_{words}"


def signals_of(program: Program) -> list[Signal]:
    """All variables; a value reference is a place in this list. States come first, then the rudder."""
    vessel = program.vessel
    assert vessel is not None
    p, rpm = vessel.model.particulars, vessel.model.hull.shaft_rpm
    starts = _start(vessel)
    made = [
        Signal(q.name.upper(), _as(q, example=value, low=-SPARE, high=SPARE), "state")
        for q, value in zip(state_of(program), starts, strict=True)
    ]
    spare = -SPARE, SPARE
    made += [
        Signal("DELTA", Quantity("delta", "rad", "rudder angle, positive turns to starboard", *spare), "state"),
        Signal("SHAFT", Quantity("n", "rev/min", "shaft speed", example=rpm), "output"),
        Signal(
            "DELTA_ORDER",
            Quantity("delta_order", "rad", "ordered rudder angle, positive turns to starboard", *spare),
            "input",
        ),
    ]
    own = {q.name for q in (*state_of(program), *parameters_of(program))} | {"delta", "t"}
    for q in program.inputs:
        if q.name == "n":
            order = Quantity("n_order", "rev/min", "shaft speed that is ordered, at once", -SPARE, SPARE, rpm)
            made.append(Signal("N_ORDER", order, "input"))
        elif q.name == "p":
            made.append(Signal("P", _as(q, low=0.01, high=10.0), "fixed"))
        elif q.name not in own:
            made.append(Signal(q.name.upper(), _as(q, low=-SPARE, high=SPARE), "input"))
    gear = (
        Quantity("rudder_rate", "rad/s", "rate at which the rudder turns", 1e-6, SPARE, p.rudder_rate),
        Quantity("rudder_limit", "rad", "largest rudder angle", 0.0, math.pi / 2, p.rudder_limit),
    )
    made += [Signal(q.name.upper(), q, "tunable") for q in gear]
    step = Quantity("step", "s", "largest step of the solver", 1e-4, SPARE, p.time_unit / STEPS_PER_LENGTH)
    made.append(Signal("STEP", step, "fixed"))
    bounds = {f"{e.name}_{d.name}": (d.low, d.high) for e in vessel.effects for d in e.declared}
    for q in parameters_of(program):
        low, high = bounds[q.name]
        made.append(Signal(q.name.upper(), _as(q, low=low, high=high), "tunable"))
    return made


def _as(q: Quantity, *, low: float, high: float, example: float | None = None) -> Quantity:
    """A quantity with other ends and start value."""
    return Quantity(q.name, q.unit, q.meaning, low, high, q.example if example is None else example)


def _start(vessel: Vessel) -> list[float]:
    """The whole state on the approach."""
    state = torch.zeros(6, dtype=torch.float64)
    state[0] = vessel.model.particulars.speed
    with torch.no_grad():
        return vessel.model.start(state, Inputs(torch.zeros((), dtype=torch.float64))).tolist()


def _model_header(program: Program, signals: Sequence[Signal], guid: str) -> str:
    """What the slave's C needs to know of the ship: places of variables, their ranges, and the rate of the state."""
    assert program.vessel is not None
    p, hull = program.vessel.model.particulars, program.vessel.model.hull
    states = state_of(program)
    max_u, max_v, max_r = (a * p.top_speed for a in MAX_PRIME_VELOCITIES)

    def table(name: str, kind: str, values: Sequence[object]) -> str:
        return f"static const {kind} {name}[VARIABLES] = {{{', '.join(map(str, values))}}};"

    quantities = [s.quantity for s in signals]
    names = ", ".join(s.constant for s in signals)
    order = "value[N_ORDER]" if any(s.constant == "N_ORDER" for s in signals) else repr(float(hull.shaft_rpm))
    return "\n".join([
        f'#define GUID "{guid}"', f"#define STATES {len(states)}", f"enum {{ {names}, VARIABLES }};",
        table("START", "double", [repr(float(q.example)) for q in quantities]),
        table("LOW", "double", [repr(float(q.low)) for q in quantities]),
        table("HIGH", "double", [repr(float(q.high)) for q in quantities]),
        table("TUNABLE", "char", [int(s.kind in {"input", "tunable"}) for s in signals]),
        f"#define LEAST_U {-0.5 * p.top_speed!r}", f"#define LARGEST_U {max_u!r}", f"#define LARGEST_V {max_v!r}",
        f"#define LARGEST_R {max_r / p.length!r}", "", '#include "accelerations.c"', "",
        f"static double shaft(const double *value) {{ (void)value; return {order}; }}", "",
        *_rates(program, float(hull.shaft_rpm)), "",
    ])  # fmt: skip


def _rates(program: Program, rpm: float) -> list[str]:
    """The rate of the state in C."""
    states = {q.name for q in state_of(program)}
    arguments = {"delta": "delta", "t": "time", "n": f"value[N_ORDER] / {rpm!r}"}
    given = [
        arguments.get(q.name) or (f"state[{q.name.upper()}]" if q.name in states else f"value[{q.name.upper()}]")
        for q in program.inputs
    ]
    places = {q.name: k for k, q in enumerate(program.outputs)}
    north, east = (f" + out[{places[name]}]" if name in places else "" for name in ("c_N", "c_E"))
    own = [q.name for q in state_of(program)[6:]]
    return [
        "static void rates(const double *value, const double *state, double delta, double time, double *rate)", "{",
        f"    double out[{len(places)}];", "    const double c = cos(state[PSI]), s = sin(state[PSI]);",
        "    (void)value;", "    (void)time;", f"    accelerations({', '.join(given)}, out);",
        *(f"    rate[{q}] = out[{places[f'{q.lower()}dot']}];" for q in "UVR"),
        f"    rate[X] = state[U] * c - state[V] * s{north};", f"    rate[Y] = state[U] * s + state[V] * c{east};",
        "    rate[PSI] = state[R];", *(f"    rate[{name.upper()}] = out[{places[f'{name}dot']}];" for name in own), "}",
    ]  # fmt: skip


def _description(program: Program, signals: Sequence[Signal], name: str, guid: str) -> str:
    """modelDescription.xml."""
    assert program.vessel is not None
    notes = ". ".join([harmless(program.title), *(harmless(note).rstrip(".") for note in program.notes)])
    root = xml.Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": harmless(program.vessel.model.particulars.name), "guid": guid,
        "description": f"{notes}. Runge-Kutta 4 with steps of at most the parameter step.",
        "generationTool": f"manoeuvre-nn {__version__}", "variableNamingConvention": "flat",
    })  # fmt: skip
    slave = xml.SubElement(root, "CoSimulation", {
        "modelIdentifier": name, "canHandleVariableCommunicationStepSize": "true", "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
    })  # fmt: skip
    xml.SubElement(xml.SubElement(slave, "SourceFiles"), "File", {"name": "fmu.c"})
    _add_units(root, sorted({_unit(s.quantity.unit) for s in signals} & set(UNITS)))
    categories = xml.SubElement(root, "LogCategories")
    for category in ("logStatusError", "logAll"):
        xml.SubElement(categories, "Category", {"name": category})
    p = program.vessel.model.particulars
    step = f"{p.sample_interval:g}"
    xml.SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": f"{p.record_length:g}", "stepSize": step})
    variables = xml.SubElement(root, "ModelVariables")
    for place, signal in enumerate(signals):
        _add_variable(variables, place, signal)
    structure = xml.SubElement(root, "ModelStructure")
    outputs = [k + 1 for k, s in enumerate(signals) if s.kind in {"state", "output"}]
    for kind, places in (
        ("Outputs", outputs),
        ("InitialUnknowns", [k for k in outputs if signals[k - 1].kind == "output"]),
    ):
        listed = xml.SubElement(structure, kind)
        for index in places:
            xml.SubElement(listed, "Unknown", {"index": str(index)})
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def _add_units(root: xml.Element, names: Sequence[str]) -> None:
    """Definitions of units; angles can be shown in degrees."""
    units = xml.SubElement(root, "UnitDefinitions")
    for name in names:
        unit = xml.SubElement(units, "Unit", {"name": name})
        xml.SubElement(
            unit,
            "BaseUnit",
            {key: repr(value) if key == "factor" else str(value) for key, value in UNITS[name].items()},
        )
        if name in {"rad", "rad/s"}:
            shown = name.replace("rad", "deg")
            xml.SubElement(unit, "DisplayUnit", {"name": shown, "factor": repr(1 / DEGREE)})


def _unit(unit: str) -> str:
    """What FMI calls a unit; that of numbers is 1."""
    return "1" if unit == "-" else unit


def _add_variable(variables: xml.Element, place: int, signal: Signal) -> None:
    """A variable with its type."""
    q = signal.quantity
    kinds = {
        "state": ("output", "continuous", "exact"), "output": ("output", "continuous", "calculated"),
        "input": ("input", "continuous", ""), "tunable": ("parameter", "tunable", "exact"),
        "fixed": ("parameter", "fixed", "exact"),
    }  # fmt: skip
    causality, variability, initial = kinds[signal.kind]
    unit = _unit(q.unit)
    described = harmless(q.meaning) + ("" if unit in UNITS else f" [{unit}]")
    attributes = {"name": q.name, "valueReference": str(place), "description": described, "causality": causality}
    attributes |= {"variability": variability} | ({"initial": initial} if initial else {})
    real = {"unit": unit} if unit in UNITS else {}
    real |= {"displayUnit": unit.replace("rad", "deg")} if unit in {"rad", "rad/s"} else {}
    if q.low > -SPARE and signal.kind != "output":
        real["min"] = repr(float(q.low))
    if q.high < SPARE and signal.kind != "output":
        real["max"] = repr(float(q.high))
    if signal.kind != "output":
        real["start"] = repr(float(q.example))
    xml.SubElement(xml.SubElement(variables, "ScalarVariable", attributes), "Real", real)


def _zipped(files: dict[str, str | bytes]) -> bytes:
    """An archive of files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, ZIP_DATE), content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
