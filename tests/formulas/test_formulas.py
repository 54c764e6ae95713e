"""Every kind of model in every format: what the text says is what the model does."""

import math
import re
import shutil
import subprocess
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import sympy
import torch
from fleet import coarse, ship_named
from models import MAKERS, PITCH, VARIABLES, ensemble, model, regression, response, scaling
from tiers import only

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.response import Quantities, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.formulas import check, formats
from manoeuvre_nn.formulas.code import LINE, _assigned, c_text, python_text
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.latex import escaped, latex_text
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.motion import CONTROLS
from manoeuvre_nn.formulas.networks import closed_form
from manoeuvre_nn.formulas.ranges import usual_ranges
from manoeuvre_nn.formulas.spreadsheet import cells, csv_text
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.scalings import approach_scaling

SCRIPT = {"python": python_text, "c": c_text, "csv": csv_text, "latex": latex_text}
OF_EVERY_SORT = {
    "hull_rudder_odd", "abkowitz", "linear=own_tanker", "esso_190k", "response", "radial basis", "general regression",
}  # fmt: skip
"""Models whose parts are those of all; of these all kinds of text are made by default, of the others Python."""
BY_DEFAULT = {(n, k) for n, k in product(MAKERS, check.LOADERS) if k == "python" or n in OF_EVERY_SORT}


def compiler() -> bool:
    return any(shutil.which(name) for name in check.COMPILERS)


@pytest.mark.parametrize("name, kind", only(BY_DEFAULT, product(MAKERS, check.LOADERS)))
def test_a_text_says_what_the_model_does(name, kind):
    if kind == "c" and not compiler():
        pytest.skip("no compiler of C")
    difference = write_down(to_program(model(name)), kind).difference
    assert difference is not None and difference < 1e-12


def test_python_gives_the_number_that_is_worked_out_by_hand():
    network = Perceptron((1, 2, 1, 1), "sigmoid", "normal")
    network.input_weights.data[:] = torch.tensor([[[1.0, -2.0, 0.5]]])
    network.output_weights.data[:] = torch.tensor([[[4.0, 1.0]]])
    double = {"dtype": torch.float64}
    of = Scaling(torch.tensor([1.0, 0.0], **double), torch.tensor([2.0, 1.0], **double), torch.tensor([0.5], **double))
    inputs = [
        Variable("V", "kn", 0.5, "speed", low=0.0, high=10.0),
        Variable("beta", "deg", math.pi / 180, "heading", low=0.0, high=math.pi),
    ]
    quantities = Quantities(inputs, Variable("height", "m", 1.0, "height"), ["V", "cos_beta"])
    made = Response(network, of, quantities).double()
    module: dict = {}
    exec(python_text(to_program(made)), module)
    # V = 8 kn is 4 m/s: x_1 = (4 - 1)/2; beta = 60 deg: x_2 = .5; the node is 1/(1 + exp(-(1.5 - 1 + .5))).
    assert module["height"](8.0, 60.0) == pytest.approx(0.5 * (4.0 / (1 + math.exp(-1.0)) + 1.0), rel=1e-14)


@pytest.mark.parametrize("kind", SCRIPT)
def test_a_wrong_digit_is_seen(kind):
    if kind == "c" and not compiler():
        pytest.skip("no compiler of C")
    program = to_program(model("wang"))
    text = SCRIPT[kind](program)
    number = repr(abs(model("wang").network.input_weights[1, 2, 3].item()))
    assert text.count(number) == 1
    assert check.largest_difference(program, kind, text) < 1e-13
    digit = number[6]
    wrong = text.replace(number, f"{number[:6]}{(int(digit) + 5) % 10}{number[7:]}")
    assert check.largest_difference(program, kind, wrong) > check.MAX_DIFFERENCE


def test_a_text_that_differs_is_never_given_away(monkeypatch):
    text = python_text(to_program(model("wang"))).replace("udot = ", "udot = 1e-6 + ")
    monkeypatch.setitem(formats.WRITERS, "python", lambda program: text)
    with pytest.raises(RuntimeError, match="differs from the model"):
        write_down(to_program(model("wang")), "python")


def test_all_digits_of_all_weights_are_printed_in_every_format():
    network = model("rajesh").network
    wanted = {abs(w) for weights in (network.input_weights, network.output_weights) for w in weights.flatten().tolist()}
    for kind, write in SCRIPT.items():
        text = re.sub(r" \\cdot 10\^\{(-?\d+)\}", r"e\1", write(to_program(model("rajesh"))))
        printed = {float(n) for n in re.findall(r"\d+\.\d+(?:[eE]-?\d+)?", text)}
        assert wanted <= printed, kind


@pytest.mark.parametrize("name", ["wang", "modulus", "hull_rudder_shaft", "radial basis", "general regression"])
def test_a_page_compiles(name, tmp_path):
    if shutil.which("pdflatex") is None:
        pytest.skip("no pdflatex")
    fragment = latex_text(to_program(model(name)), document=False)
    inside = (
        "\\documentclass{article}\n\\usepackage{amsmath,amssymb,longtable}\\allowdisplaybreaks\n\\begin{document}\n"
    )
    texts = {"whole": latex_text(to_program(model(name))), "part": f"{inside}{fragment}\\end{{document}}\n"}
    for called, text in texts.items():
        (tmp_path / f"{called}.tex").write_text(text)
        words = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", f"{called}.tex"]
        told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, errors="replace")
        assert told.returncode == 0, told.stdout[-2000:]
        assert called == "part" or "Overfull" not in told.stdout


def test_a_spreadsheet_program_agrees(tmp_path):
    if shutil.which("ssconvert") is None:
        pytest.skip("no gnumeric")
    for name in ("hull_rudder_shaft", "modulus", "response"):
        program = to_program(model(name))
        (tmp_path / "a.csv").write_text(csv_text(program))
        subprocess.run(["ssconvert", "--recalc", "a.csv", "b.csv"], cwd=tmp_path, capture_output=True, check=True)
        rows = cells((tmp_path / "b.csv").read_text())
        value = {row[0]: row[1] for row in rows if len(row) > 1}
        expected = program.reference(np.array([[q.example for q in program.inputs]]))[0]
        found = [float(value[q.name]) for q in program.outputs]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_inputs_are_what_a_network_takes_and_ranges_and_units_stand_in_every_text():
    plain, windy = to_program(model("wang")), to_program(model("modulus"))
    assert [q.name for q in plain.inputs] == ["u", "v", "r", "delta"]
    assert [q.name for q in windy.inputs] == ["u", "v", "r", "delta", "n", "w_N", "w_E", "psi"]
    assert [q.name for q in to_program(model("abkowitz")).inputs][4] == "p"
    pitch = to_program(model("response"))
    assert [q.name for q in pitch.inputs] == ["d", "V_kn", "beta_deg", "Hs", "T"] and pitch.name == "pitch_deg"
    for write in SCRIPT.values():
        text = write(pitch)
        assert "0 to 20" in text and "kn" in text and "significant wave height" in text
    assert r"$\beta$ &" in latex_text(pitch) and r"\psi_{1/3}" in latex_text(pitch)


def test_still_air_at_the_nominal_shaft_speed_is_what_a_model_without_a_record_does():
    made = IdentifiedShip(clarke_part(mariner()), model("modulus").network, approach_scaling(mariner()))
    program = to_program(made)
    point = np.array([[6.0, -0.4, 0.01, 0.2, 1.0, 0.0, 0.0, 1.3]])
    state = torch.tensor([[6.0, -0.4, 0.01, 0.0, 0.0, 0.7]], dtype=torch.float64)
    without = made(state, Inputs(torch.tensor([0.2], dtype=torch.float64)))[:, :3].detach().numpy()
    np.testing.assert_allclose(program.reference(point), without, rtol=1e-12)


def test_only_members_that_are_trained_are_written():
    network = ensemble()
    network.trained.fill_(2)
    program = to_program(IdentifiedShip(clarke_part(mariner()), network, scaling()))
    for kind in SCRIPT:
        assert (kind == "c" and not compiler()) or write_down(program, kind).difference < 1e-12
    assert "y_2_X" in python_text(program) and "y_3_X" not in python_text(program)


def test_numbers_of_mirrored_nodes_are_printed_once_on_a_page():
    number = repr(abs(float(model("hull_rudder").network.input_weights[0, 0, 0])))
    program = to_program(model("hull_rudder"))
    assert latex_text(program).count(number) == 1 and python_text(program).count(number) == 2


def many(terms: int) -> Response:
    """A network whose output is too long for a cell."""
    network = Perceptron((1, 1, terms, 1), "tanh", "normal")
    inputs = [Variable("V", "m/s", 1.0, "speed", low=0.0, high=10.0)]
    return Response(network, scaling(1, 1), Quantities(inputs, PITCH, ["V"])).double().requires_grad_(False)


def test_a_sum_that_is_too_long_for_a_cell_is_added_up_in_parts():
    program = to_program(many(450))
    rows = cells(csv_text(program))
    assert max(len(cell) for row in rows for cell in row) < 8192
    assert [row[0] for row in rows if row and "part" in row[0]] == [f"y_1, part {k}" for k in range(1, 6)]
    assert write_down(program, "csv").difference < 1e-12


def test_ships_that_are_not_written_down_are_refused():
    with pytest.raises(InputError, match="rolls: her equations have no closed form"):
        to_program(CalmWater(container()))
    with pytest.raises(InputError, match="has no closed form here: train with linear=clarke or linear=none"):
        to_program(CalmWater(esso_osaka_mmg()))


def test_a_regression_by_too_many_records_is_refused():
    with pytest.raises(InputError, match="1001 stored records has as many terms, more than 1000: .* network=mlp"):
        to_program(response(regression(1001)))


def test_a_response_over_unknown_ranges_is_refused():
    inputs = [Variable("V", "m/s", 1.0, "speed")]
    made = Response(Perceptron((1, 1, 2, 1)), scaling(1, 1), Quantities(inputs, PITCH, ["V"]))
    with pytest.raises(InputError, match=r"the range of V is not known: give inputs\.V\.low and inputs\.V\.high"):
        to_program(made.double())


@pytest.mark.parametrize("name", MAKERS)
def test_no_two_values_are_written_alike_on_a_page(name):
    program = to_program(model(name))
    names = [str(target) for _, values in program.assignments() for target, _ in values]
    names += [q.name for q in program.inputs]
    written = [program.symbols.get(one) or sympy.latex(sympy.Symbol(one)) for one in names]
    assert len(set(names)) == len(names) and len(set(written)) == len(written)


def test_an_input_that_did_not_vary_is_varied_for_the_comparison():
    program = to_program(model("wang"))
    still = replace(program, inputs=[replace(q, low=0.2, high=0.2) if q.name == "v" else q for q in program.inputs])
    points = check.sample(still)
    assert 0.1 <= points[:, 1].min() < 0.15 < 0.25 < points[:, 1].max() <= 0.3
    assert points[:, 0].min() >= program.inputs[0].low and points[:, 0].max() <= program.inputs[0].high
    assert "0.2 to 0.2" in python_text(still)


def test_words_from_outside_cannot_run_or_break_a_text(tmp_path):
    bad = '"""\nimport os\n*/ \\input{x} % & _ $'
    program = to_program(response(), notes=[bad])
    inputs = [replace(q, unit="=1+1", meaning=f"=2{bad}") for q in program.inputs]
    named = replace(program, title=f"=3{bad}", inputs=inputs)
    module: dict = {}
    exec(python_text(named), module)
    assert "os" not in module
    words = [cell for row in cells(csv_text(named)) for k, cell in enumerate(row) if k != 1]
    assert not any(word.startswith("=") for word in words)
    assert escaped(bad).count("\\input") == 0
    for kind in SCRIPT:
        if kind != "c" or compiler():
            assert check.largest_difference(named, kind, SCRIPT[kind](named)) < 1e-12


@pytest.mark.parametrize("stroke", ["\\", "??/"])
def test_a_title_from_outside_does_not_end_a_comment_of_c(stroke, tmp_path):
    trace = tmp_path / "was_here"
    code = f'#include <stdio.h>\n__attribute__((constructor)) static void f(void) {{ fopen("{trace}", "w"); }}\n'
    title = f"a ship *{stroke}\n/\n{code}/{stroke}\n*"
    named = replace(to_program(response()), title=title, notes=[title])
    if compiler():
        assert check.largest_difference(named, "c", c_text(named)) < 1e-12
    assert not trace.exists()
    assert c_text(named).count("*/") == c_text(replace(named, title="a ship", notes=[])).count("*/")


@pytest.mark.parametrize(
    "symbol", [r"\input{/etc/passwd}", "^^5cinput{x}", "$a$", "a%", r"\write18{ls}", r"\catcode1=2"]
)
def test_a_symbol_from_outside_is_letters_and_no_command(symbol):
    with pytest.raises(InputError, match="write letters, Greek ones"):
        Variable("V", "kn", 0.5, "speed", symbol)
    assert Variable("V", "kn", 0.5, "speed", r"\bar{\psi}_{1/3}").symbol == r"\bar{\psi}_{1/3}"


def named(name: str) -> Response:
    inputs = [Variable(name, "m", 1.0, "a length", low=1.0, high=2.0), *VARIABLES[1:]]
    quantities = Quantities(inputs, PITCH, [name, "V", "cos_beta", "Hs", "T"], per=name)
    return Response(response().network, scaling(5, 1), quantities).requires_grad_(False)


def test_a_name_longer_than_a_line_stays_whole_in_c():
    longer = "a" * (LINE + 20)
    body = c_text(to_program(named(longer))).rpartition(")\n{")[2]
    assert body.count(longer) == 2


def test_names_that_no_language_takes_are_refused_and_those_of_the_house_make_way():
    for name in ("lambda", "double", "exp", "median"):
        with pytest.raises(InputError, match=f"{name}' cannot be a name"):
            to_program(named(name))
    for name in ("h_1", "x_1", "y_1", "math_"):
        for kind in SCRIPT:
            assert (kind == "c" and not compiler()) or write_down(to_program(named(name)), kind).difference < 1e-12


def test_lines_of_python_are_as_long_as_they_may_be_and_no_longer():
    assert _assigned("1.0 + 2.0", "x") == ["    x = 1.0 + 2.0"]
    sums = [" + ".join(["1.0"] * count) for count in range(15, 25)]
    made = [_assigned(value, "x") for value in sums]
    assert {len(lines) for lines in made} == {1, 4} and max(len(line) for lines in made for line in lines) <= LINE
    for value, lines in zip(sums, made, strict=True):
        assert (len(lines) == 1) == (len(f"    x = {value}") <= LINE)
        assert eval(" ".join(lines).split("=", 1)[1]) == float(value.count("1.0"))


def test_examples_are_the_approach_at_the_nominal_shaft_speed_in_still_air():
    examples = {key: q.example for key, q in CONTROLS.items()}
    assert examples == {"shaft": 1.0, "approach": 1.0, "wind_north": 0.0, "wind_east": 0.0}


@pytest.mark.parametrize("name, angle", [("mariner_chislett1965", 35.0), ("esso_190k", 35.0)])
def test_hard_turns_stay_within_the_usual_ranges_and_need_most_of_the_speeds(name, angle):
    ship = ship_named(name)
    (run,) = coarse(ship, [turning_circle(angle)], 1200.0, 5.0)
    for channel in ("u", "v", "r", "delta"):
        low, high = usual_ranges(ship)[channel]
        assert low <= run[channel].min() and run[channel].max() <= high
    assert run["u"].max() > 0.9 * usual_ranges(ship)["u"][1]
    assert name != "esso_190k" or run["u"].min() < 1.7 * usual_ranges(ship)["u"][0]


class _Odd(Network):
    """A network that nobody has written down."""

    def forward(self, x):
        """Nothing.

        Args:
            x: Not used.
        """
        return x[..., :3]


def test_a_network_that_nobody_has_written_down_is_refused_and_one_function_adds_it():
    odd = IdentifiedShip(clarke_part(mariner()), _Odd(), scaling())
    with pytest.raises(InputError, match="a _Odd has no closed form here: train another network"):
        to_program(odd)
    closed_form.register(_Odd)(lambda network, x, build: list(x[:3]))
    assert write_down(to_program(odd), "python").difference < 1e-12
    with pytest.raises(InputError, match="a dict has no closed form"):
        to_program({})
