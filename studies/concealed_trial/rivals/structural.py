"""Structural residuals: minimal overdetermined sets of equations, what they are deaf to, and who may be at fault.

The structural model says which variable and which fault stands in which equation. Each residual generator computes with
one minimal structurally overdetermined (MSO) set, so that it is deaf to the faults outside that set; the toolbox checks
the sets and gives their signatures (Frisk, Krysander & Jung 2017). A fault mode is consistent if every residual that
fired can hear one of its faults. Among those a fault mode is a class with a region of its own, what it can make of the
residuals at any size, and the class nearest by Mahalanobis distance is named; where all are further than clean cases
are from nothing, the class is ``unknown`` (open set, after Jung 2020 and Lundgren & Jung 2022).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial.rivals.package import FIRST_NOISE, CalmWater, Case, typical_rates
from studies.concealed_trial.rivals.result import Limits, RivalResult
from studies.concealed_trial.rivals.search import PAIR, added, none_of, settled
from studies.concealed_trial.rivals.track import SmoothedTrack
from studies.concealed_trial.rivals.whitened import ROUGH, WhitenedRuns, jacobian, kernels, noise_covariance

UNKNOWNS = ("u", "v", "r", "psi", "du", "dv", "dr", "dpsi", "ahead", "across", "delta", "shaft")
WATER = ("wu", "wv")
"""Velocity of the water along and across the ship: unknown, and 0 unless there is a current."""
DERIVATIVES = {"du": "u", "dv": "v", "dr": "r", "dpsi": "psi"}
RELATIONS: dict[str, tuple[str, ...]] = {
    **{e: (d, "u", "v", "r", "delta", "shaft", f"f{e}") for e, d in (("X", "du"), ("Y", "dv"), ("N", "dr"))},
    "turning": ("dpsi", "r"),
    **{f"d/dt {d[1:]}": (d, of) for d, of in DERIVATIVES.items()},
    "water ahead": ("ahead", "u", "wu"),
    "water across": ("across", "v", "wv"),
    "still ahead": ("wu", "fwu"),
    "still across": ("wv", "fwv"),
    "velocity ahead": ("ahead", "psi", "fahead", "yvn", "yve"),
    "velocity across": ("across", "psi", "facross", "yvn", "yve"),
    "compass": ("psi", "fpsi", "ypsi"),
    "gyro": ("r", "fr", "yr"),
    "log": ("u", "flog", "ylog"),
    "rudder": ("delta", "fdelta", "ydelta"),
    "shaft speed": ("shaft", "fyshaft", "yshaft"),
    "engine": ("shaft", "fengine"),
}
"""Equations and sensors of a ship: unknowns, faults (f...) and what is known (y...)."""
FAULTS = {
    "X": ("fX",), "Y": ("fY",), "N": ("fN",), "kinematics": ("fwu", "fwv"),
    "actuator:rudder": ("fdelta",), "actuator:propeller": ("fengine", "fX"),
    "sensor:psi": ("fpsi",), "sensor:r": ("fr",), "sensor:u_log": ("flog",), "sensor:delta": ("fdelta",),
    "sensor:x": (), "sensor:y": (), "sensor:vn": ("fahead", "facross"), "sensor:ve": ("fahead", "facross"),
}  # fmt: skip
"""Where an effect sits -> faults of the structural model."""
SPEED = {"log": ("log",), "gps": ("water ahead", "still ahead", "velocity ahead")}
RATE = {"gyro": ("gyro",), "compass": ("turning", "d/dt psi")}
"""Where a residual takes its speed and its yaw rate from, and the equations that it needs for that."""
BASE = ("water across", "still across", "velocity across", "compass", "rudder", "engine")
"""Equations of every residual of X, Y, N but its own."""
FIRED, FAINT = 5.0, 0.2
"""Least test quantity of a residual that speaks against fault modes that it is deaf to, and over the largest one."""


@dataclass(frozen=True)
class Generator:
    """A residual generator.

    Attributes:
        name: What it compares.
        equations: Names of its MSO set.
        row: X, Y or N by number, or 3 and more for what compares sensors.
        speed: Where its speed comes from.
        rate: Where its yaw rate comes from.
    """

    name: str
    equations: tuple[str, ...]
    row: int
    speed: str = "log"
    rate: str = "gyro"


def generators() -> list[Generator]:
    """All residual generators.

    Returns:
        Twelve of the equations of motion, by two sources each of speed and yaw rate, and three of sensors alone.
    """
    found = []
    for row, (equation, slope) in enumerate((("X", "d/dt u"), ("Y", "d/dt v"), ("N", "d/dt r"))):
        for speed, ahead in SPEED.items():
            for rate, turning in RATE.items():
                equations = (equation, slope, *ahead, *turning, *BASE)
                found.append(Generator(f"{equation} by {speed} and {rate}", equations, row, speed, rate))
    found.append(Generator("log", ("log", "water ahead", "still ahead", "velocity ahead", "compass"), 3))
    found.append(Generator("gyro", ("gyro", "turning", "d/dt psi", "compass"), 4))
    found.append(Generator("shaft", ("shaft speed", "engine"), 5))
    return found


@cache
def signatures() -> tuple[tuple[frozenset[str], ...], tuple[str, ...]]:
    """Faults that every residual can hear, by the toolbox.

    Returns:
        Faults of each generator, and names of those whose equations are no MSO set (none, unless the model is changed).

    Raises:
        InputError: If the toolbox is not installed.
    """
    try:
        from faultdiagnosistoolbox import DiagnosisModel, DiffConstraint
    except ImportError:
        raise InputError('method=structural needs faultdiagnosistoolbox: write pip install -e ".[rivals]"') from None
    listed = list(RELATIONS)
    parts = [name for relation in RELATIONS.values() for name in relation]
    faults, known = (sorted({n for n in parts if n[0] == letter and len(n) > 1}) for letter in "fy")
    rels = [DiffConstraint(*r) if name.startswith("d/dt") else list(r) for name, r in RELATIONS.items()]
    model = DiagnosisModel(
        {"type": "VarStruc", "x": [*UNKNOWNS, *WATER], "f": faults, "z": known, "rels": rels}, name="ship"
    )
    sets = [np.array(sorted(listed.index(e) for e in g.equations)) for g in generators()]
    wrong = [
        g.name for g, eqs in zip(generators(), sets, strict=True) if model.Redundancy(eqs) != 1 or not model.IsPSO(eqs)
    ]
    heard = model.FSM(sets)
    return tuple(frozenset(f for f, hears in zip(faults, row, strict=True) if hears) for row in heard), tuple(wrong)


def faults_of(effect: Effect) -> frozenset[str]:
    """Faults of the structural model that an effect is.

    Args:
        effect: The effect.

    Returns:
        Names of faults.
    """
    return frozenset(f for place in effect.equations for f in FAULTS[place])


def residuals(t: SmoothedTrack) -> Float[np.ndarray, "b g"]:
    """All residuals of a run, averaged as the errors are.

    Args:
        t: The run.

    Returns:
        One column a generator.
    """
    vn, ve, psi, r, log = t.channels[:, 2:7].T
    added = np.zeros((len(t.run), len(MEASURED), 4))
    ground = vn * np.cos(psi) + ve * np.sin(psi)
    added[:, 6, 2:] = (log - ground)[:, None]  # columns in the order of SPEED and RATE
    added[:, 5, 1::2] = (r - t.slopes[:, 4])[:, None]
    moving, still = t.errors(added), t.errors()[..., 0]
    return np.concatenate([moving[:, :3].reshape(len(still), -1), still[:, 3:]], axis=1)


def quantities_of(data: WhitenedRuns) -> Float[np.ndarray, " g"]:
    """How far each residual is from what clean runs give, in standard deviations.

    Args:
        data: The runs.

    Returns:
        The larger of its energy and of its largest sum over time, each with mean 0 and variance about 1 without fault.
    """
    series: list[list[np.ndarray]] = [[] for _ in generators()]
    for t, part in zip(data.tracks, data.parts, strict=True):
        found = residuals(t)  # smoothed slopes are poor at both ends, which are left out
        for k, covariance in enumerate(_covariances(data, t, part, len(found) - 2)):
            root = np.linalg.cholesky(covariance + 1e-15 * np.trace(covariance) * np.eye(len(covariance)))
            series[k].append(np.linalg.solve(root, found[1:-1, k]))
    quantities = []
    for white in series:
        every, count = np.concatenate(white), sum(map(len, white))
        energy = (float(every @ every) - count) / np.sqrt(2 * count)
        sums = max(float(np.abs(np.cumsum(w)).max() / np.sqrt(len(w))) for w in white)
        quantities.append(max(energy, sums))
    return np.array(quantities)


def _covariances(data: WhitenedRuns, t: SmoothedTrack, part: slice, count: int) -> Iterator[Float[np.ndarray, "b b"]]:
    """Covariance of every residual of a run: instruments through its sources, rough water, coefficients, delay."""
    speed, dynamics = data.dynamics.particulars.speed, data.dynamics
    value, slope, bend = kernels(dynamics, t, 3)
    _, _, north, _, psi, r, log, shaft = FIRST_NOISE
    by = np.abs(jacobian(t, speed))
    rough = ROUGH * typical_rates(dynamics)
    common = data.nuisances.reshape(*data.errors.shape, -1)[part][1:-1]
    drift = float(np.hypot(north, speed * psi))
    for g in generators():
        if g.row < 3:
            ahead = log if g.speed == "log" else north
            own = {0: [ahead], 1: [north, speed * psi], 2: []}[g.row]
            parts = [(value, [by[g.row, 0] * ahead, by[g.row, 1] * drift]), (slope, own)]
            turn = [(value, by[g.row, 2]), (slope, float(g.row == 2))]
            if g.rate == "compass":
                turn = [(slope, by[g.row, 2]), (bend, float(g.row == 2))]
            parts += [(kernel, [size * (r if g.rate == "gyro" else psi)]) for kernel, size in turn]
            own_rough, unit = float(rough[g.row]), t.unit[g.row]
        else:
            sensors = {3: [(value, [log, north])], 4: [(slope, [psi]), (value, [r])], 5: [(value, [shaft])]}
            parts, own_rough, unit = sensors[g.row], 0.0, t.unit[g.row]
        total = noise_covariance(dynamics, t, parts, own_rough, count) / unit**2
        yield total + common[:, g.row] @ common[:, g.row].T


def judge_by_structure(case: Case, effects: Sequence[Effect]) -> RivalResult:
    """Which fault modes are consistent with the residuals that fired, and which of these is nearest.

    Args:
        case: The case.
        effects: Prototypes of the candidates.

    Returns:
        What is found.
    """
    data = WhitenedRuns(CalmWater(case.hull), case.fitted)
    quantities, (heard, _) = quantities_of(data), signatures()
    plain = [e for e in effects if not e.random]
    none, largest = none_of(data), float(quantities.max())
    # Formulas and coefficients are not exact: what is faint beside the loudest residual speaks against no mode.
    fired = [h for h, q in zip(heard, quantities, strict=True) if q > max(FIRED, FAINT * largest)]
    alone = [e for e in plain if all(h & faults_of(e) for h in fired)]
    fits = settled(data, [added(data, none, e) for e in alone or plain])
    first = fits[0].hypothesis.effects[0]
    both = [e for e in plain if e.family != first.family and all(h & (faults_of(first) | faults_of(e)) for h in fired)]
    if fits[0].criterion < none.criterion and both:
        pairs = settled(data, [added(data, fits[0], e) for e in both])
        fits += [replace(f, criterion=f.criterion + PAIR) for f in pairs]
    fits.sort(key=lambda f: f.criterion)
    return RivalResult(data, none, fits, fits[0], Limits(largest, none.misfit), fits[0].misfit)
