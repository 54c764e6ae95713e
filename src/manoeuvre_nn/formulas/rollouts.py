"""How far a ship by what was written goes from the model: the same manoeuvres, the same solver."""

import ctypes
import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from tempfile import TemporaryDirectory

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, rate_of_state
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.formulas.check import Run
from manoeuvre_nn.formulas.fmu import signals_of
from manoeuvre_nn.formulas.motion import CONTROLS
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.state import state_of
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

TRIALS = (zigzag(20.0), turning_circle(25.0))
"""What is sailed for the comparison: zz20, tc25."""


@dataclass(frozen=True)
class TrackDeviation:
    """How far a track is from that of the model.

    Attributes:
        manoeuvre: What was sailed.
        largest: Largest distance at the same time, over L [-].
        rms: Root mean square of the distances, over L [-].
    """

    manoeuvre: str
    largest: float
    rms: float


class WrittenModel(Model):
    """A ship that moves by what was written."""

    def __init__(self, program: Program, run: Run) -> None:
        """Take the program that was written, and what the written thing computes."""
        super().__init__()
        assert program.vessel is not None
        self.program, self.run, self.written = program, run, program.vessel.model

    @property
    def hull(self) -> Ship:
        """The ship that was written down."""
        return self.written.hull

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """As the model starts."""
        return self.written.start(state, inputs)

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state by what was written."""
        names = [q.name for q in state_of(self.program)]
        flat = state.reshape(-1, state.shape[-1]).numpy()
        columns = {q.name: np.full(len(flat), q.example) for q in self.program.inputs}
        columns |= dict(zip(names, flat.T, strict=True))
        given = {**inputs.given, "t": inputs.time if inputs.time is not None else torch.zeros(())}
        keys = {"delta": "delta", "time": "t", **{key: q.name for key, q in CONTROLS.items()}}
        columns |= {keys.get(name, name): v.expand(state.shape[:-1]).reshape(-1).numpy() for name, v in given.items()}
        found = {name: torch.as_tensor(values).reshape(state.shape[:-1]) for name, values in self.run(columns).items()}
        nudot = torch.stack([found[name] for name in ("udot", "vdot", "rdot")], dim=-1)
        own = torch.stack([found[f"{name}dot"] for name in names[6:]], dim=-1) if names[6:] else nudot[..., :0]
        rate = rate_of_state(state, nudot, own)
        stream = [found.get(name, torch.zeros_like(nudot[..., 0])) for name in ("c_N", "c_E")]
        return rate + torch.nn.functional.pad(torch.stack(stream, dim=-1), (3, rate.shape[-1] - 5))

    def on_approach(self, speed: float) -> "WrittenModel":
        """The same: what was written holds for the approach speed that it was written at."""
        return self


def sailed(program: Program) -> list[Recording]:
    """The model's own runs of ``TRIALS``; none of a response."""
    return [] if program.vessel is None else roll_out(program.vessel, TRIALS)


def deviations_of(program: Program, model: Model, runs: Sequence[Recording]) -> list[TrackDeviation]:
    """Sail a ship by what was written, with the helmsman and the steps of the model's runs.

    Args:
        program: What was written.
        model: The ship by it.
        runs: The model's runs, by :func:`sailed`.

    Returns:
        A deviation each.
    """
    assert program.vessel is not None
    length = program.vessel.model.particulars.length
    return [_deviation(one, run, length) for one, run in zip(roll_out(model, TRIALS), runs, strict=True)]


def _deviation(found: Recording, expected: Recording, length: float) -> TrackDeviation:
    """Distances at the same times; without end where one run ends before the other."""
    if len(found) != len(expected):
        return TrackDeviation(expected.name, inf, inf)
    apart = np.hypot(found["x"] - expected["x"], found["y"] - expected["y"]) / length
    return TrackDeviation(expected.name, float(apart.max()), float(np.sqrt(np.mean(apart**2))))


def by_the_clock(run: Recording) -> Manoeuvre:
    """What the helmsman did, with orders at the sample times: a unit that is stepped has no helmsman of its own."""
    orders, interval = run["delta_order"], float(run.time[1] - run.time[0])
    changed = [0, *(np.flatnonzero(np.diff(orders)) + 1).tolist(), len(orders) - 1]
    stages = [
        Stage(float(orders[first]), hold=(last - first) * interval)
        for first, last in zip(changed[:-1], changed[1:], strict=True)
        if last > first
    ]
    stages[-1] = replace(stages[-1], hold=None)
    return Manoeuvre(run.name, str(run.meta["kind"]), tuple(stages), duration=float(run.time[-1]))


class _Callbacks(ctypes.Structure):
    """``fmi2CallbackFunctions``, without any."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")]


class Unit:
    """A unit of co-simulation whose binary is called as a master calls it.

    Attributes:
        library: The binary; None where the archive holds none.
    """

    def __init__(self, program: Program, content: bytes) -> None:
        """Load the binary.

        Args:
            program: What was written.
            content: The archive.
        """
        self._places = {s.quantity.name: k for k, s in enumerate(signals_of(program))}
        self._callbacks, self.library = _Callbacks(), None
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            self._guid = archive.read("modelDescription.xml").decode().partition('guid="')[2].partition('"')[0].encode()
            binary = next((name for name in archive.namelist() if name.startswith("binaries/")), None)
            if binary is not None:
                with TemporaryDirectory() as folder:
                    self.library = ctypes.CDLL(archive.extract(binary, folder))
                self.library.fmi2Instantiate.restype = ctypes.c_void_p

    def started(self) -> ctypes.c_void_p:
        """A ship on her approach."""
        assert self.library is not None
        callbacks, zero = ctypes.byref(self._callbacks), ctypes.c_double(0.0)
        made = self.library.fmi2Instantiate(b"ship", 1, self._guid, ctypes.c_char_p(), callbacks, 0, 0)
        assert made is not None, "the unit refuses to be instantiated"
        ship = ctypes.c_void_p(made)
        self._call("fmi2SetupExperiment", ship, 0, zero, zero, 0, zero)
        self._call("fmi2EnterInitializationMode", ship)
        self._call("fmi2ExitInitializationMode", ship)
        return ship

    def _call(self, function: str, *arguments: object) -> None:
        """Call a function that must succeed."""
        status = getattr(self.library, function)(*arguments)
        if status != 0:
            raise RuntimeError(f"{function} of the unit returned status {status}")

    def step(self, ship: ctypes.c_void_p, time: float, length: float) -> bool:
        """Go on from a time by a length [s]; whether it could."""
        assert self.library is not None
        return self.library.fmi2DoStep(ship, ctypes.c_double(time), ctypes.c_double(length), 1) == 0

    def order(self, ship: ctypes.c_void_p, angle: float) -> None:
        """Order a rudder angle [rad]."""
        place = (ctypes.c_uint * 1)(self._places["delta_order"])
        self._call("fmi2SetReal", ship, place, 1, (ctypes.c_double * 1)(angle))

    def position(self, ship: ctypes.c_void_p) -> list[float]:
        """X and y [m]."""
        places, at = (ctypes.c_uint * 2)(self._places["x"], self._places["y"]), (ctypes.c_double * 2)()
        self._call("fmi2GetReal", ship, places, 2, at)
        return list(at)

    def free(self, ship: ctypes.c_void_p) -> None:
        """End a run."""
        assert self.library is not None
        self.library.fmi2FreeInstance(ship)


def of_unit(program: Program, content: bytes) -> list[TrackDeviation]:
    """Deviations of a unit of co-simulation.

    Args:
        program: What was written.
        content: The archive.

    Returns:
        A deviation for each of ``TRIALS``, from the model with the same orders at the same times; none where the
        archive holds no binary.
    """
    assert program.vessel is not None
    unit = Unit(program, content)
    if unit.library is None:
        return []
    runs = roll_out(program.vessel, [by_the_clock(run) for run in roll_out(program.vessel, TRIALS)])
    length = program.vessel.model.particulars.length
    return [_deviation(_steered(unit, run), run, length) for run in runs]


def _steered(unit: Unit, run: Recording) -> Recording:
    """X and y of a unit that is given the orders of a recording at its sample times, as far as it went."""
    ship, rows = unit.started(), []
    for k, now in enumerate(run.time.tolist()):
        rows.append(unit.position(ship))
        unit.order(ship, float(run["delta_order"][k]))
        if k + 1 < len(run) and not unit.step(ship, now, run.time[k + 1] - now):
            break
    unit.free(ship)
    x, y = np.array(rows).T
    return Recording(run.name, run.time[: len(x)], {"x": x, "y": y}, run.status, run.meta)
