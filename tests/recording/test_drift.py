"""Drift of turning circles: exact circles, ships in a known current, and what wind does."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.recording.check.inspection import inspect_recording
from manoeuvre_nn.recording.drift import drift_by_arcs, known_drift, track_less_velocities, without_drift
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.report.check_tables import drift_rows
from manoeuvre_nn.report.views import Runs
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_chislett1965, mariner_corrected

SHIPS = {
    "container": container,
    "mariner": mariner_corrected,
    "chislett": mariner_chislett1965,
    "esso": esso_190k,
    "bulker": great_lakes_bulker,
}
BIG = mariner_corrected().particulars
AGREES = 0.02
"""Largest distance of two corrected tracks over the diameter."""


@cache
def sailed(ship: str) -> dict[tuple[float, str], Recording]:
    """Circles in calm water: rudder angle and side -> the run."""
    made = SHIPS[ship]()
    asked = [(d, s) for d in (10.0, 20.0, 35.0) for s in ("starboard", "port")]
    turns = [turning_circle(d, side=s, duration=75 * made.particulars.time_unit) for d, s in asked]
    step = made.particulars.time_unit / 8
    with unchecked():
        runs = roll_out(CalmWater(made), turns, step=step, interval=step)
    return dict(zip(asked, runs, strict=True))


def circle(ship: str, angle: float, side: str = "starboard", turned: float = 540.0) -> Recording:
    """A circle in calm water, cut where the heading has turned by so many degrees."""
    run = sailed(ship)[angle, side]
    end = int(np.searchsorted(np.abs(run["psi"] - run["psi"][0]), turned * DEGREE))
    assert end < len(run), (ship, angle, side)
    return run.rows(slice(0, end))


def moved(run: Recording, north: float, east: float, length: float, seed: int | None = 0) -> Recording:
    """The run in a current; positions noisy by .005 L and heading by .2 deg, unless no seed is given."""
    stream = np.random.default_rng(seed)
    sd = 0.0 if seed is None else 1.0
    off = {"x": north * run.time, "y": east * run.time, "psi": 0.0 * run.time}
    noise = {"x": 0.005 * length, "y": 0.005 * length, "psi": 0.2 * DEGREE}
    return run.with_channels(**{k: run[k] + off[k] + sd * noise[k] * stream.standard_normal(len(run)) for k in off})


def perfect(turned: float, side: int = 1, north: float = 0.0, east: float = 0.0) -> Recording:
    """40 s straight on, then a steady turn of 400 m diameter at 5 m/s in a current, 1 sample a second."""
    rate = side * 5.0 / 200.0
    time = np.arange(-40.0, turned * DEGREE / abs(rate))
    psi = np.where(time > 0, rate * time, 0.0)
    x = np.where(time > 0, 200 * np.sin(np.abs(psi)), 5 * time)
    y = side * 200 * (1 - np.cos(psi))
    since = time - time[0]
    delta = np.where(time > 0, side * 20 * DEGREE, 0.0)
    channels = {"x": x + north * since, "y": y + east * since, "psi": psi, "delta": delta}
    flow = {"u": np.full_like(time, 5.0), "v": 0.0 * time, "r": np.where(time > 0, rate, 0.0)}
    return Recording("perfect", since, {**channels, **flow}, meta={"kind": "turning_circle"})


@pytest.mark.parametrize("side", [1, -1])
def test_the_current_of_a_perfect_circle_is_found_exactly(side):
    found = drift_by_arcs(perfect(560.0, side, north=-0.3, east=0.4))
    assert (found.north, found.east) == pytest.approx((-0.3, 0.4), abs=1e-3)
    assert found.speed == pytest.approx(0.5, abs=1e-3) and found.toward_deg == pytest.approx(126.87, abs=0.2)
    assert found.diameter == pytest.approx(400.0, rel=0.01) and found.period == pytest.approx(251.3, rel=0.01)
    assert found.speed_error < 3e-3 and found.error < 3e-3


@pytest.mark.parametrize("angle", mainly(1, [35.0, 10.0, 20.0]))
@pytest.mark.parametrize(
    "ship, side",
    [
        *(("mariner", side) for side in ("starboard", "port")),
        *(pytest.param(ship, "starboard", marks=pytest.mark.slow) for ship in ("container", "chislett", "esso")),
        *(pytest.param(ship, "port", marks=pytest.mark.slow) for ship in ("chislett", "esso", "container")),
    ],
)
def test_correction_by_arcs_agrees_with_that_by_the_known_current(ship, angle, side):
    run, own = circle(ship, angle, side), SHIPS[ship]().particulars
    for seed, speed in enumerate((0.2, 1.0, 2.0)):
        current = known_drift(speed, 100.0 * seed + angle)
        seen = moved(run, current.north, current.east, own.length, seed)
        found = drift_by_arcs(seen)
        ours, right = without_drift(seen, found), without_drift(seen, current)
        apart = np.hypot(ours["x"] - right["x"], ours["y"] - right["y"]).max()
        assert apart < AGREES * found.diameter
        assert found.error < AGREES


def test_the_plain_mean_of_the_arcs_takes_a_turn_that_is_not_steady_for_a_drift():
    run = circle("mariner", 35.0, "starboard")
    turned = np.abs(run["psi"])
    first = turned < turned[-1] - 2 * np.pi
    first &= turned > 120 * DEGREE
    later = np.interp(turned[first] + 2 * np.pi, turned, run.time)
    mean = [np.mean((np.interp(later, run.time, run[k]) - run[k][first]) / (later - run.time[first])) for k in "xy"]
    found = drift_by_arcs(run)
    assert np.hypot(*mean) * run.duration > 0.2 * found.diameter
    assert found.speed * run.duration < 0.01 * found.diameter


def test_errors_are_as_large_as_they_are_said_to_be():
    run, length = circle("mariner", 20.0, "starboard"), mariner_corrected().particulars.length
    squares = []
    for seed in range(60):
        found = drift_by_arcs(moved(run, 0.6, -0.3, length, seed))
        off = np.array([found.north - 0.6, found.east + 0.3])
        squares.append(off @ np.linalg.solve(found.covariance, off) / 2)
    assert 0.3 < np.mean(squares) < 1.5


def test_a_second_turn_makes_the_drift_ten_times_surer():
    length = BIG.length
    runs = [circle("mariner", 35.0, "port", turned) for turned in (540.0, 900.0)]
    short, long = (drift_by_arcs(moved(run, 0.5, 0.5, length)) for run in runs)
    assert long.speed_error < 0.2 * short.speed_error
    assert (long.north, long.east) == pytest.approx((0.5, 0.5), abs=3 * long.speed_error + 1e-3)


def test_the_drift_turns_with_the_course_and_changes_sides_with_the_ship():
    run = moved(circle("mariner", 20.0, "starboard"), 0.4, 0.1, 150.0)
    own = drift_by_arcs(run)
    x, y = body_to_earth(run["x"], run["y"], np.full(len(run), 0.8))
    turned = drift_by_arcs(run.with_channels(x=x, y=y, psi=run["psi"] + 0.8))
    assert turned.toward_deg - own.toward_deg == pytest.approx(0.8 / DEGREE)
    assert (turned.speed, turned.speed_error) == pytest.approx((own.speed, own.speed_error))
    mirrored = drift_by_arcs(run.with_channels(y=-run["y"], psi=-run["psi"], delta=-run["delta"]))
    assert (mirrored.north, mirrored.east) == pytest.approx((own.north, -own.east))
    assert mirrored.covariance == pytest.approx(own.covariance * np.array([[1, -1], [-1, 1]]))


def test_in_wind_the_drift_is_the_mean_velocity_of_a_turn():
    ship = mariner_corrected()
    vessel = Vessel(CalmWater(ship), [SteadyWind(ship, speed=12.0, from_deg=40.0)])
    with unchecked():
        (run,) = roll_out(
            vessel, [turning_circle(35.0, duration=60 * ship.particulars.time_unit)], step=5.0, interval=5.0
        )
    found = drift_by_arcs(run)
    turned = np.abs(run["psi"])
    before = np.interp(turned[-1] - 2 * np.pi, turned, run.time)
    gone = [(run[k][-1] - np.interp(before, run.time, run[k])) / (run.time[-1] - before) for k in "xy"]
    assert np.hypot(*gone) > 0.05
    assert (found.north, found.east) == pytest.approx(gone, abs=0.03 * np.hypot(*gone))


def test_a_current_that_is_simulated_is_found_and_velocities_through_the_water_stay():
    ship = mariner_corrected()
    vessel = Vessel(CalmWater(ship), [Current(ship, speed=0.8, toward_deg=300.0)])
    with unchecked():
        (run,) = roll_out(vessel, [turning_circle(20.0, duration=45 * ship.particulars.time_unit)])
    found = drift_by_arcs(run)
    assert found.speed == pytest.approx(0.8, abs=0.01) and found.toward_deg == pytest.approx(300.0, abs=1.0)
    assert track_less_velocities(run) == pytest.approx((0.4, -0.693), abs=2e-3)
    clean = without_drift(run, found)
    assert np.array_equal(clean["u"], run["u"]) and np.array_equal(clean["v"], run["v"])
    over_ground = body_to_earth(clean["u"], clean["v"], clean["psi"])
    assert np.stack([clean["vn"], clean["ve"]]) == pytest.approx(np.stack(over_ground), abs=0.02)
    assert clean.meta["drift"]["north"] == found.north
    left = drift_by_arcs(clean)
    assert left.speed < max(2 * found.speed_error, 1e-6)


def test_velocities_over_ground_lose_the_drift():
    run = circle("mariner", 10.0, "port")
    seen = moved(run, 0.5, -0.2, 150.0, seed=None)
    north, east = body_to_earth(run["u"], run["v"], run["psi"])
    ahead, abeam = (north + 0.5, east - 0.2)
    cos, sin = np.cos(run["psi"]), np.sin(run["psi"])
    seen = seen.with_channels(u=ahead * cos + abeam * sin, v=-ahead * sin + abeam * cos)
    clean = without_drift(seen, known_drift(np.hypot(0.5, 0.2), np.degrees(np.arctan2(-0.2, 0.5))))
    for name in ("x", "y", "u", "v"):
        assert clean[name] == pytest.approx(run[name], abs=1e-6 * max(1.0, np.abs(run[name]).max()))


def test_short_circles_and_straight_runs_are_refused_in_a_line():
    with pytest.raises(
        InputError, match="too short a circle for its drift: the heading turns through 380 deg"
    ) as error:
        drift_by_arcs(perfect(380.0))
    assert "\n" not in str(error.value)
    straight = perfect(560.0)
    straight = straight.with_channels(psi=0.0 * straight.time, delta=0.0 * straight.time)
    with pytest.raises(InputError, match="turns through 0 deg"):
        drift_by_arcs(straight)


@pytest.mark.slow
def test_a_turn_in_which_the_ship_still_slows_down_is_too_uncertain_to_correct():
    run = moved(circle("bulker", 35.0, "starboard"), 0.5, 0.0, 217.0)
    with pytest.raises(InputError, match="too uncertain to take away: .*% of the diameter in a turn; .* not steady"):
        without_drift(run, drift_by_arcs(run))


def test_gaps_and_what_comes_after_the_turn_do_not_matter():
    run = perfect(700.0, north=0.3)
    holes = {k: np.where((run.time > 200) & (run.time < 206), np.nan, run[k]) for k in ("x", "y", "psi")}
    end = run.time > 480
    found = drift_by_arcs(run.with_channels(**holes, delta=np.where(end, -0.2, run["delta"])))
    assert (found.north, found.east) == pytest.approx((0.3, 0.0), abs=5e-3)
    assert found.headings[1] < 330 * DEGREE


SI = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}


def table(run: Recording) -> pd.DataFrame:
    return pd.DataFrame({"t": run.time, **{k: run[k] for k in SI}})


def test_a_mapping_takes_the_drift_out_of_circles_or_a_known_current_out_of_all(write, columns, zz20):
    seen = moved(circle("mariner", 20.0, "starboard"), 0.4, 0.3, BIG.length)
    run = read_recording(write(table(seen)), columns(drift="arcs"), BIG)
    assert run.meta["drift"]["north"] == pytest.approx(0.4, abs=0.03)
    assert run["y"] == pytest.approx(seen["y"] - 0.3 * seen.time, abs=0.02 * 500)
    known = columns(drift={"speed": 0.5, "toward_deg": 90.0})
    run = read_recording(write(table(zz20)), known, BIG)
    assert run["y"] == pytest.approx(zz20["y"] - 0.5 * zz20.time, abs=1e-4)
    run = read_recording(write(table(zz20)), columns(drift="arcs"), BIG)
    assert run["y"] == pytest.approx(zz20["y"], abs=1e-4) and "drift" not in run.meta


@pytest.mark.parametrize("wrong", ["yes", {"speed": 1.0}, {"speed": "fast", "toward_deg": 3.0}, True])
def test_a_drift_that_is_none_is_refused(columns, wrong):
    with pytest.raises(InputError, match="mapping: drift=.*; write keep, arcs, or a known one"):
        columns(drift=wrong)


def test_the_check_of_a_circle_says_what_current_it_implies():
    ship: Particulars = BIG
    sd = {"u": 0.02, "v": 0.02, "r": 0.02 * DEGREE, "delta": 0.1 * DEGREE}
    turn = add_noise(circle("mariner", 20.0, "starboard"), sd)
    seen = moved(turn, 0.4, 0.3, ship.length)
    one = inspect_recording(seen, ship)
    (finding,) = [f for f in one.findings if f.check == "drift in the turn"]
    assert finding.verdict == "note" and finding.measured == pytest.approx(0.5, abs=0.03)
    assert "towards 3" in finding.text and finding.remedy == "to take it away write drift: arcs"
    (row,) = drift_rows([one])
    assert row["track less u, v"].startswith(("0.49", "0.50", "0.5 ", "0.51")) and row["wind, mean"] == "–"
    calm = inspect_recording(moved(turn, 0.0, 0.0, ship.length), ship)
    assert [f.verdict for f in calm.findings if f.check == "drift in the turn"] == ["ok"]


def test_runs_tell_and_lose_their_drift(zz20):
    seen = moved(circle("mariner", 20.0, "starboard"), 0.4, 0.3, BIG.length)
    runs = Runs([seen, zz20], BIG)
    drifts = runs.drifts()
    assert list(drifts.index) == [seen.name] and drifts.loc[seen.name, "speed"] == pytest.approx(0.5, abs=0.03)
    clean = runs.without_drift()
    assert clean[1] is zz20 and clean.drifts().loc[seen.name, "speed"] < 0.02
    assert runs.without_drift(0.5, 90.0)[1]["y"] == pytest.approx(zz20["y"] - 0.5 * zz20.time)
