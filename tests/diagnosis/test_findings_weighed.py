"""What an effect could explain is weighed by the diagnosis; a wrong unit is refused as before."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fleet import unchecked
from sailed import sailed, table_of, write_runs
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.manoeuvre import Stage
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.diagnosis.case import Case, Question, RunSettings, read_runs
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderDelay, RudderOffset
from manoeuvre_nn.effect.sensors import LeverArm
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.check import weighed as check_weighed
from manoeuvre_nn.recording.check.axes import HELD_TURN
from manoeuvre_nn.recording.check.checks import check_over_ground
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.check.weighed import Bounds, weighed
from manoeuvre_nn.recording.preparation import over_ground
from manoeuvre_nn.recording.read.mapping_file import CONCEALED, read_mapping
from manoeuvre_nn.recording.read.reader import read_measured
from manoeuvre_nn.ship.mariner import mariner_corrected

pytestmark = pytest.mark.usefixtures("unchecked_types")
SHIP = mariner_corrected()
SHELF = Bounds(current=10.0, rudder_offset=np.radians(5.0), antenna=(91.4, 13.1), rudder_delay=60.0)
WRONG_FRAMES = {
    "swapped": lambda t: t.rename(columns={"x_north": "y_east", "y_east": "x_north"}),
    "mirrored": lambda t: t.assign(psi=-t.psi % 360.0, r=-t.r),
    "other side": lambda t: t.assign(v=-t.v),
    "exchanged": lambda t: t.assign(u=t.v, v=t.u),
    "earth-fixed": lambda t: t.assign(
        **dict(zip("uv", body_to_earth(*t[["u", "v"]].to_numpy().T, np.radians(t.psi.to_numpy())), strict=True))
    ),
    "knots": lambda t: t.assign(u=t.u / KNOT, v=t.v / KNOT),
}
"""What no antenna explains."""


def case_of(folder, speed, toward, change=lambda t: t) -> Case:
    tables = {f"r{k}": change(t.copy()) for k, t in enumerate(sailed(speed, toward))}
    return read_runs(write_runs(folder, tables), SHIP, RunSettings(rudder_positive_to="port"))


@cache
def with_antenna(ahead: float, abeam: float = 0.0, noise: float = 0.0):
    """A circle of the Mariner with a receiver off midship whose positions have so much more noise [m]."""
    with unchecked():
        antenna = LeverArm(SHIP, dx_m=ahead, dy_m=abeam)
        (run,) = roll_out(Vessel(CalmWater(SHIP), [antenna]), [turning_circle(15.0, duration=240.0)], step=1.0)
    table, more = table_of(run, 7).drop(columns=["sog", "cog"]), np.random.default_rng(3).standard_normal((2, 241))
    return table.assign(x_north=table.x_north + noise * more[0], y_east=table.y_east + noise * more[1])


def checked(folder, table, bounds=SHELF) -> tuple[str, ...]:
    return all_checked(folder, [table], bounds)[0]


def all_checked(folder, tables, bounds=SHELF) -> list[tuple[str, ...]]:
    write_runs(folder, {f"r{k}": table for k, table in enumerate(tables)})
    runs = []
    for k in range(len(tables)):
        measured = read_measured(folder / f"r{k}.csv", read_mapping(CONCEALED), SHIP.particulars, leave_gaps=True)
        runs.append(over_ground(measured, SHIP.particulars))
    return check_over_ground(runs, SHIP.particulars, bounds=bounds)


@pytest.mark.slow
def test_a_strong_current_is_told_and_diagnosed(tmp_path):
    case = case_of(tmp_path, 2.95, 180.0)
    assert any("less than the speed over ground" in s or "more than the speed over ground" in s for s in case.undecided)
    d = diagnose(Question(case, CalmWater(case.hull), [Current(SHIP), RudderOffset(SHIP)]))
    speed, toward = d.causes[0].parameters
    assert d.model == ["current"] and abs(speed.value - 2.95) < 0.03 and abs(toward.value - 180.0) < 1.0


@pytest.mark.parametrize("which", mainly(1, range(4)))
@pytest.mark.parametrize(
    "speed, toward", mainly(1, [(3.7, 180.0), (8.5, 150.0), (4.8, 180.0), (5.5, 0.0), (6.5, 90.0)])
)
def test_no_current_within_its_bounds_is_a_wrong_unit(tmp_path, speed, toward, which):
    said = checked(tmp_path, sailed(speed, toward)[which])
    found = [
        float(m[1]) for m in (re.search("a current of ([0-9.]+) m/s would explain it", text) for text in said) if m
    ]
    assert found == pytest.approx([speed] * len(said), rel=0.02), said
    assert all("\n" not in text and len(text) < 300 for text in said)


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("current", [0.0, 0.4])
@pytest.mark.parametrize(
    "change, told",
    [
        (lambda t: t.assign(u_log=t.u_log / KNOT), "u_log looks like knots"),
        (lambda t: t.assign(u_log=t.u_log * 3.6), "u_log looks like km/h"),
        (lambda t: t.assign(sog=t.sog / KNOT), "u and v look like knots"),
        (lambda t: t.assign(sog=t.sog / KNOT).drop(columns=["x_north", "y_east"]), "the Mariner approaches at 7.614"),
        (
            lambda t: t.assign(sog=t.sog / KNOT).drop(columns=["x_north", "y_east", "u_log"]),
            "the Mariner approaches at 7.614",
        ),
    ],
)
def test_a_wrong_unit_is_refused_although_a_current_could_be_as_strong(tmp_path, change, told, current, which):
    with pytest.raises(InputError, match=told):
        checked(tmp_path, change(sailed(current)[which]))


def test_an_indicator_that_is_off_may_show_more_than_the_stop(tmp_path):
    table = sailed(0.0)[1]
    hard = table.assign(delta=table.delta * 1.4 - 3.0, delta_order=table.delta_order * 1.4)
    assert "the indicator may be off by" in checked(tmp_path, hard)[0]
    with pytest.raises(InputError, match="stops at 35 deg"):
        checked(tmp_path, hard, Bounds(10.0, 0.0))
    with pytest.raises(InputError, match="stops at 35 deg"):
        checked(tmp_path, table.assign(delta=table.delta * 1.8))


def test_a_finding_that_no_effect_explains_stays_as_it_is(tmp_path):
    with pytest.raises(InputError, match="r looks like rad/s"):
        checked(tmp_path, sailed(0.4)[0].assign(r=lambda t: np.radians(t.r)))
    assert checked(tmp_path, sailed(0.4)[0]) == ()


@pytest.mark.parametrize("ahead", mainly(1, [60.0, 55.0, 65.0]))
def test_noise_beside_the_small_sway_of_an_antenna_near_the_pivot_point_is_no_wrong_frame(tmp_path, ahead):
    (said,) = checked(tmp_path, with_antenna(ahead, noise=1.5))
    assert "an antenna off the reference point would explain it" in said


def test_velocities_of_the_reference_point_and_positions_of_an_antenna_are_told(tmp_path):
    at = [with_antenna(*where).assign(**with_antenna(0.0)[["u", "v"]]) for where in [(35, 5), (-40, -4)]]
    ahead, aft = (" ".join(checked(tmp_path, table)) for table in at)
    assert re.search("x and y are of a point 3[3-7] m ahead and [4-6].* m to starboard of that of u and v", ahead)
    assert re.search("x and y are of a point (3[89]|4[0-2]) m aft and [3-5].* m to port of that of u and v", aft)
    with pytest.raises(InputError, match="u, v do not follow from x, y and psi"):
        checked(tmp_path, at[0], replace(SHELF, antenna=(15.0, 13.1)))


@pytest.mark.parametrize("ahead", mainly(2, [0.0, 35.0, 60.0]))
@pytest.mark.parametrize("wrong", WRONG_FRAMES)
def test_what_no_antenna_explains_is_refused_wherever_it_is(tmp_path, wrong, ahead):
    if wrong == "other side" and ahead == 60.0:  # there is no sway there
        return
    with pytest.raises(InputError):
        checked(tmp_path, WRONG_FRAMES[wrong](with_antenna(ahead)))


@pytest.mark.parametrize(
    "late, side, explained", mainly(2, [(37.0, 1, True), (2.0, -1, False), (52.0, 1, True), (0.0, -1, False)])
)
def test_a_rudder_written_down_late_is_told_from_one_of_the_other_sign(tmp_path, late, side, explained):
    weave = zigzag(15.0, duration=300.0)
    weave = replace(weave, stages=(Stage(0.0, hold=70.0), *weave.stages))
    with unchecked():
        (run,) = roll_out(Vessel(CalmWater(SHIP), [RudderDelay(SHIP, delay_s=late)]), [weave], step=1.0)
    table = table_of(run, 3)
    table = table.assign(delta=side * table.delta, delta_order=side * table.delta_order)
    if not explained:
        with pytest.raises(InputError, match="rudder sign opposite to the turn"):
            checked(tmp_path, table)
        return
    with pytest.raises(InputError, match="rudder sign opposite to the turn"):
        checked(tmp_path, table, replace(SHELF, rudder_delay=0.0))
    (said,) = checked(tmp_path, table)
    found = re.search("written down some ([0-9]+) s late would explain it", said)
    assert found and float(found[1]) == pytest.approx(late, abs=5.0)


CIRCLES = tuple(turning_circle(angle, duration=560.0) for angle in (25.0, 35.0, 10.0, 20.0))
SHORT = (
    *(zigzag(angle, duration=420.0) for angle in (10.0, 20.0)),
    turning_circle(35.0, duration=200.0),
)


@cache
def late(seconds: float, manoeuvres=CIRCLES):
    """Runs of the Mariner whose rudder was written down so late."""
    after_approach = [replace(m, stages=(Stage(0.0, hold=60.0), *m.stages)) for m in manoeuvres]
    with unchecked():
        runs = roll_out(Vessel(CalmWater(SHIP), [RudderDelay(SHIP, delay_s=seconds)]), after_approach, step=2.0)
    return [table_of(run, 20 + k) for k, run in enumerate(runs)]


@pytest.mark.parametrize("seconds", mainly(1, [12.0, 10.0, 15.0]))
def test_a_ship_that_comes_round_to_the_side_of_a_late_rudder_is_no_other_sign(tmp_path, seconds):
    for k, table in enumerate(late(seconds)):
        assert checked(tmp_path / f"{k}", table, replace(SHELF, rudder_delay=0.0)) == ()


@pytest.mark.parametrize("seconds", mainly(1, [15.0, 12.0]))
def test_one_circle_that_fits_the_other_sign_best_is_decided_by_the_delay_of_the_other_runs(tmp_path, seconds):
    runs = late(seconds, SHORT)
    with pytest.raises(InputError, match="rudder sign opposite to the turn"):
        checked(tmp_path / "alone", runs[-1])
    (said,) = all_checked(tmp_path / "all", runs)[-1]
    found = re.search("written down some ([0-9]+) s late would explain it", said)
    assert found and float(found[1]) == pytest.approx(seconds, abs=2.0)


def turned_round(table):
    return table.assign(delta=-table.delta, delta_order=-table.delta_order)


@pytest.mark.parametrize(
    "manoeuvres, which", mainly(2, [(CIRCLES, (0,)), (SHORT, (0, 1, 2)), (CIRCLES, (2,)), (SHORT, (0,))])
)
def test_a_rudder_of_the_other_sign_in_some_runs_is_refused(tmp_path, manoeuvres, which):
    right = late(0.0, manoeuvres)
    assert all_checked(tmp_path / "right", right) == [()] * len(right)
    with pytest.raises(InputError, match="rudder sign opposite to the turn"):
        all_checked(tmp_path / "wrong", [turned_round(t) if k in which else t for k, t in enumerate(right)])


def test_a_ship_that_comes_round_against_her_rudder_in_a_zigzag_is_no_other_sign(tmp_path):
    """By a heel that turns her: of the other sign the rudder would have been put over at 10 deg of heading."""
    approached = replace(zigzag(10.0, duration=520.0), stages=(Stage(0.0, hold=60.0), *zigzag(10.0).stages))
    with unchecked():
        (run,) = roll_out(Vessel(CalmWater(SHIP), [RollCoupling(SHIP, N_phi=-0.26)]), [approached], step=2.0)
    write_runs(tmp_path, {"r0": table_of(run, 20)})
    measured = read_measured(tmp_path / "r0.csv", read_mapping(CONCEALED), SHIP.particulars, leave_gaps=True)
    measured, bounds = over_ground(measured, SHIP.particulars), replace(SHELF, rudder_delay=0.0)
    for kind in (None, "tc10"):
        told = replace(measured, meta={**measured.meta, **({"kind": kind} if kind else {})})
        with pytest.raises(InputError, match="rudder sign opposite to the turn"):
            check_over_ground([told], SHIP.particulars, bounds=bounds)
    zigzagged = replace(measured, meta={**measured.meta, "kind": "zz10"})
    ((said,),) = check_over_ground([zigzagged], SHIP.particulars, bounds=bounds)
    assert "in a zigzag of the other sign it would have been put over long before" in said


@pytest.mark.parametrize("others, refused", [("right", False), ("turned round", True)])
def test_all_runs_of_a_recorder_tell_the_sign_of_a_zigzag_that_leaves_it_nearly_open(monkeypatch, others, refused):
    """Its own rudder moved too seldom: by three standard errors it acts the wrong way, as by chance in few runs."""
    with unchecked():
        approached = replace(zigzag(10.0, duration=520.0), stages=(Stage(0.0, hold=60.0), *zigzag(10.0).stages))
        (run,) = roll_out(Vessel(CalmWater(SHIP), [RollCoupling(SHIP, N_phi=-0.26)]), [approached], step=2.0)
        more = roll_out(Vessel(CalmWater(SHIP)), [zigzag(20.0, duration=400.0)] * 2, step=2.0)
    if others == "turned round":
        more = [one.with_channels(delta=-one["delta"]) for one in more]
    found = Finding("rudder sign", "refuse", "rudder sign opposite to the turn")
    monkeypatch.setattr(check_weighed, "rudder_effect", lambda run, ship: (-3.0, 1.0))
    monkeypatch.setattr(check_weighed, "turned_by_held_rudder", lambda run, ship: -2 * HELD_TURN)
    zigzagged = replace(run, meta={**run.meta, "kind": "zz10"})
    said = weighed(found, zigzagged, SHIP.particulars, replace(SHELF, rudder_delay=0.0), [zigzagged, *more])
    assert said.trips == refused


WEAVES = (0, 2)
"""Of the runs that were sailed, those that turn through less than 90 deg."""


def without_log(current: float, which, factor: float = 1.0):
    """Runs without a log, all that was measured over ground in a unit of 1 / ``factor``."""
    columns = ["x_north", "y_east", "u", "v", "sog"]
    tables = [sailed(current, 30.0)[k].drop(columns=["u_log"]) for k in which]
    return [t.assign(**{c: factor * t[c] for c in columns}) for t in tables]


def test_a_strong_current_on_weaves_without_a_log_is_told_by_the_circles_of_the_same_day(tmp_path):
    with pytest.raises(InputError, match="the speed reaches"):
        all_checked(tmp_path / "weaves", without_log(6.0, WEAVES))
    said = all_checked(tmp_path / "all", without_log(6.0, range(4)))
    notes = " ".join(text for texts in said for text in texts)
    told = [float(m) for m in re.findall("a current of ([0-9.]+) m/s would explain", notes)]
    assert len(told) >= 2 and told == pytest.approx([6.0] * len(told), rel=0.15)


@pytest.mark.parametrize("current", mainly(1, [0.4, 0.0]))
def test_another_unit_of_all_columns_is_no_current_in_any_number_of_runs(tmp_path, current):
    right, wrong = without_log(current, range(4)), without_log(current, range(4), 1 / KNOT)
    for name, tables in {"all": wrong, "circle": [*right[:3], wrong[3]], "weave": [*right[1:], wrong[0]]}.items():
        with pytest.raises(InputError, match="the speed reaches"):
            all_checked(tmp_path / name, tables)
