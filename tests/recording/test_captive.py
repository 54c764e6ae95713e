import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.read.captive import captive_mapping, read_captive

COLUMNS = {
    "beta": {"column": "b", "unit": "deg"},
    "delta": {"column": "d", "unit": "deg"},
    "X": {"column": "X"},
    "Y": {"column": "Y"},
    "N": {"column": "N"},
    "run": {"column": "no"},
}
ROWS = ["1,0,10,-.1,.2,-.1", "2,0,20,-.1,.4,-.2", "3,0,-10,-.1,-.2,.1", "4,0,-20,-.1,-.4,.2", "5,10,0,-.1,1,.5",
        "6,-10,0,-.1,-1,-.5", "5,10,0,-.1,1,.5"]  # fmt: skip


def table(tmp_path, rows=ROWS, head="no,b,d,X,Y,N"):
    (tmp_path / "tests.csv").write_text("\n".join([head, *rows]))
    return tmp_path / "tests.csv"


def mapped(**changes):
    return captive_mapping(**{"columns": COLUMNS, "rudder_positive_to": "port", **changes})


def test_a_table_of_captive_tests_comes_out_in_the_ships_signs_each_run_once(tmp_path):
    tests = read_captive(table(tmp_path), mapped())
    assert len(tests) == 6 and tests.name == "tests" and tests.area == "LL"
    assert tests.delta[:2] == approx([-10 * DEGREE, -20 * DEGREE])
    assert tests.v[4] == approx(-0.17365, abs=1e-5) and tests.u[4] == approx(0.98481, abs=1e-5)
    assert tests.N.tolist() == [-0.1, -0.2, 0.1, 0.2, 0.5, -0.5] and tests.r.tolist() == [0.0] * 6


def test_moments_about_another_point_are_carried_to_midship(tmp_path):
    tests = read_captive(table(tmp_path), mapped(moment_point=0.1))
    assert tests.N[4] == approx(0.5 + 0.1 * 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rudder_positive_to": "starboard"}, "N turns the ship against the rudder"),
        ({"columns": COLUMNS | {"Y": {"column": "Y", "sign": -1}}}, "Y pulls the hull along"),
        ({"columns": COLUMNS | {"beta": {"column": "b", "unit": "rad"}}}, "beta reaches 10 rad: it looks like degrees"),
        ({"columns": COLUMNS | {"N": {"column": "moment"}}}, "no column 'moment'; it has: no, b, d, X, Y, N"),
        ({"columns": {k: v for k, v in COLUMNS.items() if k != "N"}}, "columns has no N"),
        ({"columns": None}, "write columns: "),
        ({"area": "LB"}, "choose one of: LL, LT"),
        ({"moment_point": "midship"}, "moment_point='midship'; write ship lengths"),
        ({"rudder_positive_to": ["port"]}, "write starboard or port"),
        ({"columns": COLUMNS | {"N": {"column": "N", "sign": [1]}}}, "sign of N is .1.; write 1 or -1"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(tmp_path, changes, message):
    with pytest.raises(InputError, match=message) as error:
        read_captive(table(tmp_path), mapped(**changes))
    assert "\n" not in str(error.value)


def test_an_empty_cell_is_refused_with_its_line(tmp_path):
    with pytest.raises(InputError, match="tests.csv, line 3: column 'Y' is empty"):
        read_captive(table(tmp_path, [ROWS[0], "2,0,20,-.1,,-.2", *ROWS[2:]]), mapped())
