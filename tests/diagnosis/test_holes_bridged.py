"""Minutes without a record are bridged by the model; where the rudder is not known either, a run is cut in two."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from pytest import approx
from sailed import sailed, write_runs

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis.case import Case, Question, RunSettings, read_runs
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.repair import recorded
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.rudder import RudderDelay, RudderOffset
from manoeuvre_nn.estimation.rudder_blades import indicated
from manoeuvre_nn.recording.holes import heading_across, told
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
NAMES = ("zz1", "tc1", "zz2", "tc2")
FROM, TO = 100.0, 160.0
RUDDER = ["delta", "delta_order"]


def case_of(folder, change) -> Case:
    tables = {name: change(table.copy()) for name, table in zip(NAMES, sailed(0.4), strict=True)}
    return read_runs(write_runs(folder, tables), SHIP, RunSettings(rudder_positive_to="port"))


def cut_out(table):
    return table[(table.t < FROM) | (table.t > TO)]


def emptied(table, kept=("t",)):
    table.loc[(table.t >= FROM) & (table.t <= TO), [c for c in table if c not in kept]] = np.nan
    return table


@pytest.mark.parametrize("change", [cut_out, emptied])
def test_a_rudder_that_was_held_is_bridged_and_one_that_went_over_is_not_known(tmp_path, change):
    runs = {run.name: run for run in case_of(tmp_path, change).runs}
    hole = ((99.0, 161.0),)
    assert all(runs[k].meta["breaks"] == hole and runs[k].meta["held"] == () for k in ("zz1", "zz2"))
    assert all(runs[k].meta["held"] == hole and runs[k].meta["breaks"] == () for k in ("tc1", "tc2"))
    assert all(np.isnan(run["x"][101:160]).all() and np.isfinite(run["delta"]).all() for run in runs.values())
    assert "nothing is known of the rudder from 99 to 161 s" in told(runs["zz1"])[0]
    assert "it counts as held, and the model bridges the hole" in told(runs["tc1"])[0]


def test_a_rudder_that_is_not_known_counts_as_held_at_both_ends_for_what_a_late_record_tells(tmp_path):
    """A line through a minute would lay a late record's rudder where it never was, seconds before the hole."""
    run = next(r for r in case_of(tmp_path, cut_out).runs if r.meta["breaks"])
    before, after = (np.median(run["delta"][part]) for part in (slice(97, 100), slice(161, 164)))
    assert abs(after - before) > np.radians(10.0)
    for part, angle in ((slice(100, 129), before), (slice(131, 160), after)):
        assert np.abs(run["delta"][part] - angle).max() < np.radians(1.0)


@pytest.mark.parametrize("orders", [True, False])
def test_what_a_late_record_would_tell_in_a_hole_is_known_from_the_orders_before_it(tmp_path, orders):
    """A zigzag's rudder that is on its way when the hole begins; of a record that is 20 s late."""
    run = next(r for r in case_of(tmp_path, cut_out).runs if r.meta["breaks"])
    late, time = RudderDelay(SHIP, delay_s=20.0), run.time
    over = np.where(time < 85.0, 0.2, -0.2)
    channels = {k: c for k, c in run.channels.items() if k != "delta_order"} | ({"delta_order": over} if orders else {})
    ordered = replace(run, channels=channels)
    shown = indicated(late, ordered, torch.tensor(run["delta"])[None])[0].numpy()
    told, asked = run["delta"][np.minimum(np.arange(len(time)) + 20, len(time) - 1)], time + 20.0
    known = ((asked <= 99.0) | (asked >= 161.0)) & (asked <= time[-1])
    assert shown[known] == approx(told[known], abs=1e-6)
    before = (time > 81.0) & (time < 99.0)
    followed = ordered.ordered_rudder(SHIP.particulars.rudder_rate) if orders else told
    assert shown[before] == approx(followed[before], abs=1e-6) and np.ptp(shown[before]) > (0.3 if orders else -1.0)


def test_an_order_that_was_written_down_tells_the_rudder(tmp_path):
    plain = case_of(tmp_path / "plain", lambda t: t)
    case = case_of(tmp_path / "holed", lambda t: emptied(t, ("t", "delta_order")))
    assert all(run.meta["breaks"] == run.meta["held"] == () for run in case.runs) and case.undecided == ()
    for run, whole in zip(case.runs, plain.runs, strict=True):
        assert np.degrees(np.abs(run["delta"] - whole["delta"])).max() < 3.0  # half a second of the steering gear


@pytest.mark.parametrize("gyro", [True, False])
@pytest.mark.parametrize("rate", [2.0, -1.3])
def test_a_heading_goes_on_through_a_hole_by_whole_turns(gyro, rate):
    time = np.r_[0.0:60.0, 215.0:300.0]
    psi = np.radians(rate) * time + np.radians(0.3) * np.sin(time)
    channels = {"psi": np.unwrap(np.angle(np.exp(1j * psi)))} | (
        {"r": np.full_like(time, np.radians(rate))} if gyro else {}
    )
    assert abs(channels["psi"][-1] - psi[-1]) > 6.0
    np.testing.assert_allclose(heading_across(Recording("turn", time, channels))["psi"], psi, atol=1e-9)


@pytest.mark.slow
def test_a_diagnosis_bridges_holes_and_free_runs_end_where_the_rudder_is_lost(tmp_path, unchecked_types):
    case = case_of(tmp_path, cut_out)
    d = diagnose(Question(case, CalmWater(case.hull), [Current(SHIP), RudderOffset(SHIP)]))
    speed, toward = d.causes[0].parameters
    assert d.model == ["current"] and d.rmse("after")["pos"] < 2.0
    assert abs(speed.value - 0.4) < 3 * speed.error and abs(toward.value - 60.0) < 3 * toward.error
    assert speed.error < 0.01 and sum("from 99 to 161 s" in line for line in d.undecided) == 4
    zigzag = next(run for run in case.held_out if run.name == "zz2")
    assert recorded(zigzag, case.warmup).dropna().t.max() == 99.0


def test_a_record_that_is_mostly_holes_is_refused(tmp_path):
    with pytest.raises(InputError, match="only 69 s of 240 s were recorded, the rest are holes"):
        case_of(tmp_path, lambda t: t[(t.t < 36) | (t.t > 205)])
