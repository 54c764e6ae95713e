"""Cepowski 2007, the formula: Eq. 3 where it is known, Figs 8-10, and the recommended network as one formula."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.response import Records, Response
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.responses import response
from studies.cepowski2007.computed import NAMES, UNITS, at
from studies.cepowski2007.perceptrons import Structure, train_perceptrons
from studies.cepowski2007.published import GRID, grid_conditions, published_pitch
from studies.cepowski2007.records import INPUTS, PHYSICAL, RecordSets, record_sets, rms_deg, usual_method
from studies.cepowski2007.scores import halves
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

GOLDEN = (1.65, 1.72, 1.78, 1.84, 1.83, 0.52, 2.48, 2.98, 3.01, 3.02, 2.99)
"""Eq. 3 at d 7 m, V 20 kn, H_s 5 m, T 10.5 s and the headings of the grid [deg], computed independently."""
FIXED = {"d": 11.0, "V": 20.0, "beta": 0.0, "Hs": 5.0, "T": 12.5}
"""What does not vary in Figs 8-10, as printed."""
FIGURES = {"8": "beta", "9": "V", "10": "d"}
KINDS = ("latex", "python", "c", "csv")
PRINTED_NUMBERS = 35 + 7 + 7 + 5 + 3 + 3
"""Numbers in Eq. 3 other than 0: A, B, C, S, P, alpha."""
Row = dict[str, Any]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The formula.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Golden values, Figs 8-10, and ours as text in four languages, each compared with the network.
    """
    sets = record_sets(usual_method(effort), say, seed=effort.seed)
    say("the recommended network as a formula")
    learnt, tested = halves(sets.grid, effort.seed)
    model = recommended_response(learnt, effort.seed)
    written = {kind: write_down(response(model), kind) for kind in KINDS}
    grid = published_pitch(grid_conditions()) / DEGREE
    rows = np.array([[7.0, 20 * KNOT, beta, 5.0, 10.5] for beta in GRID["beta"]])
    golden = published_pitch(rows) / DEGREE
    differences = [w.difference for w in written.values() if w.difference is not None]
    quantities = {
        "golden": [
            {"beta": f"{round(beta / DEGREE)} deg", "known": known, "ours": float(value)}
            for beta, known, value in zip(GRID["beta"], GOLDEN, golden, strict=True)
        ],
        "least": float(grid.min()),
        "largest": float(grid.max()),
        "difference": max(differences),
        "testing": rms_deg(model.at(tested.conditions) - tested.values),
        "between": rms_deg(model.at(sets.between.conditions) - sets.between.values),
        "numbers": _count(model),
    }
    return ChapterResult(
        "The formula (Eq. 3, Figs 7-10)",
        f"Eq. 3 meets its golden values within {max(abs(golden - GOLDEN)):.3f} deg. The recommended network as one "
        f"formula has {quantities['numbers']} numbers (Eq. 3: {PRINTED_NUMBERS}) and tests with "
        f"{quantities['testing']:.3f} deg, between the points of the grid {quantities['between']:.3f} deg.",
        read_claims("cepowski2007", "formula").beside(quantities),
        {
            "The recommended network as text": [
                {
                    "as": kind,
                    "lines": len(w.bytes.splitlines()),
                    "largest difference over the largest pitch": w.difference,
                }
                for kind, w in written.items()
            ],
            "Its nodes: psi = H_s (b + sum_h B_h tanh(w_h + W_h x)), x scaled": node_table(model),
            "Scaling: x = (z - shift) / scale [SI]": scaling_table(model),
        },
        [figure(number, sets, model) for number in FIGURES],
    )


def recommended_response(records: Records, seed: int = 0) -> Response:
    """Train the recommended network.

    Args:
        records: What to learn from.
        seed: Seed of the first weights.

    Returns:
        The response, in double precision.
    """
    conditions = torch.tensor(records.conditions)
    seen = PHYSICAL.features(conditions)
    values = torch.tensor(records.values) / PHYSICAL.factor(conditions)
    scaling = Scaling(seen.mean(0), seen.std(0, correction=0), values.std(0, correction=0)[None], values.mean(0)[None])
    x, y = scaling.inputs(seen), scaling.outputs(values[:, None])
    network, _ = train_perceptrons(x.numpy(), y[:, 0].numpy(), Structure(bayesian=True), seed)
    return Response(network.requires_grad_(False), scaling, PHYSICAL)


def figure(number: str, sets: RecordSets, model: Response) -> Plot:
    """One of Figs 8-10.

    Args:
        number: Of the figure.
        sets: Records.
        model: Our formula.

    Returns:
        Pitch over what varies: points are records.
    """
    varying = FIGURES[number]
    column, v = NAMES.index(varying), INPUTS[NAMES.index(varying)]
    fixed = {name: value for name, value in FIXED.items() if name != varying}
    points = at(sets.grid, fixed)
    dense: Float[np.ndarray, "n 5"] = np.repeat(points.conditions[:1], 181, 0)
    dense[:, column] = np.linspace(v.low, v.high, 181)
    along = dense[:, column] / v.size
    lines = [
        Line("Eq. 3", along, published_pitch(dense) / DEGREE, "paper"),
        Line("our formula", along, model.at(dense) / DEGREE, "ours"),
        Line("our records", points.conditions[:, column] / v.size, points.values / DEGREE, "reference", points=True),
    ]
    said = ", ".join(f"{name} {value:g} {UNITS[name]}" for name, value in fixed.items())
    panel = Panel(f"{v.meaning} {v.heading}", "pitch amplitude [deg]", lines)
    return Plot(f"figure_{number}", f"Fig. {number}: {said}; beta as in Eq. 3, 0 following sea", [panel])


def node_table(model: Response) -> list[Row]:
    """Weights of the network.

    Args:
        model: The response.

    Returns:
        A row a node, the output's bias last.
    """
    first, last = (p[0].detach().numpy() for p in model.network.parameters())
    rows: list[Row] = []
    for k, weights in enumerate(first):
        named = dict(zip([*PHYSICAL.sees, "w"], map(float, weights), strict=True))
        rows.append({"node": k + 1, "B": float(last[0, k]), **named})
    return [*rows, {"node": "b", "B": float(last[0, -1]), **dict.fromkeys([*PHYSICAL.sees, "w"], "")}]


def scaling_table(model: Response) -> list[Row]:
    """Shift and scale.

    Args:
        model: The response.

    Returns:
        A row an input, the output last.
    """
    s = model.scaling
    assert s.output_shift is not None
    rows = zip([*PHYSICAL.sees], s.shift.tolist(), s.scale.tolist(), strict=True)
    found: list[Row] = [{"of": name, "shift": shift, "scale": scale} for name, shift, scale in rows]
    return [*found, {"of": "psi/H_s [rad/m]", "shift": float(s.output_shift[0]), "scale": float(s.output_scale[0])}]


def _count(model: Response) -> int:
    """Numbers in the formula."""
    weights = sum(p.numel() for p in model.network.parameters())
    return weights + 2 * (len(model.scaling.shift) + 1)
