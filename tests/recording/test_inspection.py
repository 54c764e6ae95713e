"""Each check on a file that is made to trip it: it trips, no other does, and the remedy that it prints cures it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked
from tiers import mainly, only

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.check.finding import Change, Finding, settings, worst
from manoeuvre_nn.recording.check.inspection import inspect_file, summary_lines
from manoeuvre_nn.recording.check.samples import stuck
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.mariner import mariner_corrected

NOISE = {"u": 0.05, "v": 0.05, "r": 0.02 * DEGREE, "x": 0.7, "y": 0.7, "psi": 0.1 * DEGREE, "delta": 0.05 * DEGREE}
UNITS = {"u": "m/s", "v": "m/s", "r": "deg/s", "x": "m", "y": "m", "psi": "deg", "delta": "deg"}
CLOSE = {"u": 0.08, "v": 0.08, "r": 0.05 * DEGREE, "psi": 0.3 * DEGREE, "delta": 1.0 * DEGREE}
"""How far off the truth a cured channel may be, RMS: noise and little more."""
MAPPING = mapping(
    time={"column": "t", "unit": "s"}, channels={k: {"column": k, "unit": unit} for k, unit in UNITS.items()}
)
SHIP = mariner_corrected()


@pytest.fixture(scope="module")
def truth():
    """A 20/20 zigzag of five minutes after 40 s of straight approach, as it really was."""
    with unchecked():
        (run,) = roll_out(CalmWater(SHIP), [zigzag(20.0, duration=300.0)], step=0.5)
    run = run.resampled(np.arange(0.0, 300.1, 1.0))
    ahead = np.arange(-40.0, 0.0)
    before = {k: np.full(len(ahead), run[k][0]) for k in UNITS}
    before["x"] = run["x"][0] + run["u"][0] * ahead
    channels = {k: np.concatenate([before[k], run[k]]) for k in UNITS}
    return replace(run, time=np.arange(len(channels["u"]), dtype=float), channels=channels)


def written(run, seed=1, noise=1.0, **late):
    """The table that sensors would write, each channel later by so much."""
    stream, table = np.random.default_rng(seed), {"t": run.time}
    for k in UNITS:
        values = np.interp(run.time - late.get(k, 0.0), run.time, run[k]) + noise * NOISE[k] * stream.standard_normal(
            len(run)
        )
        table[k] = values / DEGREE if "deg" in UNITS[k] else values
    return pd.DataFrame(table)


def changed(**new):
    """A table with some columns recomputed from the others."""
    return lambda run: written(run).assign(**new)


def moved(ahead=0.0, abeam=0.0):
    """Positions of another point."""

    def spoil(run):
        north, east = body_to_earth(np.full(len(run), ahead), np.full(len(run), abeam), run["psi"])
        table = written(run)
        return table.assign(x=table.x + north, y=table.y + east)

    return spoil


def standing(name, first=70, last=95):
    """A channel that stands still for a while."""

    def spoil(run):
        table = written(run)
        table.loc[first:last, name] = table.loc[first, name]
        return table

    return spoil


def spikes(run):
    table = written(run)
    table.loc[[50, 120, 200], "r"] += 5.0
    table.loc[[80, 150], "x"] += 60.0
    return table


def earth_fixed(run):
    table = written(run)
    u, v = body_to_earth(table.u.to_numpy(), table.v.to_numpy(), table.psi.to_numpy() * DEGREE)
    return table.assign(u=u, v=v)


def blank(name, *rows):
    return lambda run: written(run).assign(**{name: lambda t: t[name].mask(t.index.isin(rows))})


def ordered(run):
    """The order in place of the angle."""
    order = np.zeros(len(run))
    moving = np.sign(np.diff(run["delta"], prepend=0.0))
    for k in range(1, len(run)):
        order[k] = 20.0 * moving[k] if abs(moving[k]) > 0 and abs(np.diff(run["delta"])[k - 1]) > 1e-3 else order[k - 1]
    return written(run).assign(delta=order)


def slowing(run):
    """The ship still slows down at the beginning of its approach: log and track both show it."""
    more = 0.8 * np.clip(1 - run.time / 18.0, 0.0, None)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (more[1:] + more[:-1]))])
    return written(replace(run, channels={**run.channels, "u": run["u"] + more, "x": run["x"] + way}))


SPOILT = {
    "delay of r": lambda run: written(run, r=1.0),
    "delay of psi": lambda run: written(run, psi=1.0),
    "delay of u, v": lambda run: written(run, u=2.0, v=2.0),
    "delay of x, y": lambda run: written(run, x=1.5, y=1.5),
    "offset of r": changed(r=lambda t: t.r + 0.05),
    "scale of r": changed(r=lambda t: t.r / 1.08),
    "offset of psi": changed(psi=lambda t: t.psi + 3.0),
    "scale of u": changed(u=lambda t: t.u / 1.06),
    "offset of u": changed(u=lambda t: t.u + 0.3),
    "scale of v": changed(v=lambda t: t.v / 1.3),
    "offset of v": changed(v=lambda t: t.v + 0.15),
    "point of x, y": moved(ahead=15.0),
    "point of x, y abeam": moved(abeam=15.0),
    "current": changed(x=lambda t: t.x + 0.3 * t.t, y=lambda t: t.y - 0.2 * t.t),
    "outliers": spikes,
    "stuck": standing("r"),
    "quantized": changed(r=lambda t: (t.r / 0.2).round() * 0.2),
    "gaps": lambda run: written(run).drop(index=range(285, 302)),
    "empty cells": blank("v", 60, 61, 130),
    "rudder jumps": ordered,
    "approach": slowing,
    "rudder unit": changed(delta=lambda t: t.delta * DEGREE),
    "rudder sign": changed(delta=lambda t: -t.delta),
    "r against psi": changed(r=lambda t: -t.r),
    "frame": earth_fixed,
    "speed unit": changed(u=lambda t: t.u * 3.6, v=lambda t: t.v * 3.6),
}
"""Check -> the file that trips it."""
LIKE_OTHERS = {
    "delay of r", "delay of psi", "delay of x, y", "offset of r", "scale of r", "offset of u", "scale of v",
    "point of x, y", "point of x, y abeam", "r against psi",
}  # fmt: skip
"""Checks of which another does the same to another channel; a point far off is carried to midship by a test below."""


@pytest.fixture
def inspected(tmp_path):
    def look(table, columns=MAPPING):
        path = tmp_path / "run.csv"
        table.to_csv(path, index=False, float_format="%.6g")
        with unchecked():
            return inspect_file(path, columns, SHIP.particulars), path

    return look


def remedied(read, findings):
    """The mapping that a file is to be read with after what was found with this one."""
    channels, plain = dict(read.channels), {}
    for path, value in settings(findings, read).items():
        first, *rest = path.split(".")
        if first == "time":
            read = replace(read, time=replace(read.time, **{rest[0]: value}))
        elif first != "channels":
            plain[first] = value
        elif len(rest) > 1 and rest[0] in channels:
            channels[rest[0]] = replace(channels[rest[0]], **{rest[1]: value})
        elif value is None and len(rest) == 1:
            channels.pop(rest[0], None)
    return replace(read, channels=channels, **plain)


def tripped(inspection):
    return {f.check for f in inspection.findings if f.trips}


def off(record, truth):
    """RMS distance from the truth of each channel, at the record's own times."""
    at = truth.time[0] + record.meta["started"] + record.time
    return {k: float(np.sqrt(np.mean((record[k] - np.interp(at, truth.time, truth[k])) ** 2))) for k in CLOSE}


@pytest.mark.parametrize("seed", mainly(1, range(3)))
def test_a_clean_file_trips_nothing(truth, inspected, seed):
    one, _ = inspected(written(truth, seed))
    assert tripped(one) == set() and one.verdict in {"ok", "note"}
    assert tripped(inspected(written(truth, noise=0.0))[0]) == set()


@pytest.mark.parametrize("check", only(set(SPOILT) - LIKE_OTHERS, SPOILT))
def test_each_check_trips_on_a_file_made_for_it_and_its_remedy_cures_the_file(check, truth, inspected):
    table = SPOILT[check](truth)
    one, path = inspected(table)
    assert tripped(one) == {check}
    changes = settings([f for f in one.findings if f.trips], MAPPING)
    assert changes, "a remedy that a mapping cannot say"
    cured = remedied(MAPPING, [f for f in one.findings if f.trips])
    assert cured != MAPPING
    again, _ = inspected(table, cured)
    assert tripped(again) == set()
    with unchecked():
        record = read_recording(path, cured, SHIP.particulars)
    for channel, error in off(record, truth).items():
        assert error < CLOSE[channel], channel


def test_a_heading_that_stands_still_is_cut_out(truth, inspected):
    one, _ = inspected(standing("psi")(truth))
    assert "stuck" in tripped(one)
    changes = settings([f for f in one.findings if f.check == "stuck"], MAPPING)
    assert set(changes) == {"start"} and changes["start"] == pytest.approx(95.0)


@pytest.fixture(scope="module")
def turn():
    """Ten minutes of a turn, which is steady at its end."""
    with unchecked():
        (run,) = roll_out(CalmWater(SHIP), [turning_circle(25.0, duration=600.0)], step=1.0)
    return run


def test_nothing_that_stands_still_in_a_steady_turn_is_stuck(turn):
    run = turn
    rounded = run.with_channels(v=np.round(run["v"], 3), u=np.round(run["u"], 3))
    assert np.ptp(rounded["v"][-60:]) == 0
    assert [f.verdict for f in stuck(rounded, SHIP.particulars)] == ["ok"]
    turning_in = (run.time > 30.0) & (run.time < 60.0)
    frozen = rounded.with_channels(v=np.where(turning_in, rounded["v"][np.argmax(turning_in)], rounded["v"]))
    found = stuck(frozen.between(0.0, 75.0), SHIP.particulars)
    assert [(f.verdict, f.channels) for f in found] == [("mend", ("v",))]


def test_what_stands_still_on_the_straight_course_after_a_turn_is_not_stuck(turn):
    """Only what the heading does meanwhile belies it. Of two channels that stand still in a turn each has a remedy."""
    run = turn.between(0.0, 300.0)
    ended = run.time > 200.0
    held = {k: np.where(ended, run[k][np.argmax(ended)], run[k]) for k in ("psi", "u", "v")}
    straight = run.with_channels(**held, r=np.where(ended, 0.0, run["r"]))
    assert [f.verdict for f in stuck(straight, SHIP.particulars)] == ["ok"]
    turning_in = (run.time > 30.0) & (run.time < 60.0)
    frozen = {k: np.where(turning_in, run[k][np.argmax(turning_in)], run[k]) for k in ("u", "v")}
    found = stuck(run.with_channels(**frozen), SHIP.particulars)
    assert [(f.verdict, f.channels) for f in found] == [("mend", ("u",)), ("mend", ("v",))]


def test_positions_of_a_point_far_off_are_carried_to_midship(truth, inspected):
    table = moved(ahead=40.0)(truth)
    one, _ = inspected(table)
    assert one.verdict == "refuse" and "x and y look to be of a point 39.8 m ahead" in str(one.findings[-1])
    nearly = remedied(MAPPING, one.findings)
    again = inspected(table, nearly)[0]
    assert tripped(again) <= {"point of x, y"}
    assert remedied(nearly, again.findings).position_point == pytest.approx(40.0, abs=1.5)


def test_a_long_hole_is_refused_and_the_longest_piece_kept(truth, inspected):
    table = written(truth).drop(index=range(260, 310))
    one, _ = inspected(table)
    assert one.verdict == "refuse" and one.recording is None and tripped(one) == {"gaps"}
    cured = remedied(MAPPING, one.findings)
    assert cured.end == pytest.approx(259.0) and tripped(inspected(table, cured)[0]) == set()


def test_a_column_that_is_mostly_empty_is_left_out(truth, inspected):
    one, _ = inspected(blank("r", *range(100, 330))(truth))
    cured = remedied(MAPPING, one.findings)
    assert one.verdict == "refuse" and set(MAPPING.channels) - set(cured.channels) == {"r"}


def test_a_slow_record_trips_and_a_faster_one_passes(truth, inspected):
    slow, _ = inspected(written(truth).iloc[::4])
    (finding,) = [f for f in slow.findings if f.check == "sampling"]
    assert finding.verdict == "mend" and "a sample every 3 s or more often" in finding.remedy
    faster, _ = inspected(written(truth).iloc[::3])
    assert "sampling" not in tripped(faster)


def test_a_file_that_cannot_be_read_is_a_finding(truth, inspected):
    one, _ = inspected(written(truth).assign(u="fast"))
    assert one.verdict == "refuse" and "'fast'" in str(one.findings[-1])


def test_a_record_of_other_channels_is_refused_and_not_compared(truth, inspected):
    record = replace(MAPPING, channels={"r": MAPPING.channels["r"]}, kind="record")
    one, _ = inspected(written(truth), record)
    assert one.verdict == "refuse" and "no u, v, x, y, psi, delta in the file" in str(one.findings[-1])


def test_a_delay_is_measured_with_its_error(truth, inspected):
    one, _ = inspected(SPOILT["delay of r"](truth))
    (finding,) = [f for f in one.findings if f.check == "delay of r"]
    assert abs(finding.measured - 1.0) < 4 * finding.error < 0.25
    assert "r: written down 0.9" in finding.text and "s too late" in finding.text


def test_changes_are_laid_over_what_a_mapping_has_already():
    late = replace(MAPPING.channels["r"], delay=0.5, scale=2.0, offset=1.0, sign=-1)
    given = replace(MAPPING, channels={**MAPPING.channels, "r": late}, reference_point=3.0)
    found = Finding(
        "all", "mend", "", changes=(
            Change("channels.r.delay", "delay", 0.25), Change("channels.r.scale", "scale", 1.1),
            Change("channels.r.offset", "offset", 0.02 * DEGREE), Change("channels.r", "turn"),
            Change("position_point", "add", 4.0), Change("rudder_positive_to", "turn"),
        ),
    )  # fmt: skip
    said = settings([found], given)
    assert said["channels.r.delay"] == pytest.approx(0.75) and said["channels.r.scale"] == pytest.approx(2.2)
    assert said["channels.r.offset"] == pytest.approx(1.0 - 0.01) and said["channels.r.sign"] == 1
    assert said["position_point"] == 7.0 and said["rudder_positive_to"] == "port"
    assert remedied(given, [found]).channels["r"].delay == pytest.approx(0.75)


def test_what_is_left_out_needs_no_other_setting():
    gone = (Change("channels.r.delay", "delay", 1.0), Change("channels.r"), Change("channels.n"))
    both = Finding("both", "mend", "", changes=gone)
    assert settings([both], MAPPING) == {"channels.r": None}
    assert "r" not in remedied(MAPPING, [both]).channels


def test_the_lines_before_training_are_few(truth, inspected):
    one, _ = inspected(SPOILT["outliers"](truth))
    assert summary_lines([one]) == [f"run: {f}" for f in one.findings if f.trips]
    lines = summary_lines([one] * 9)
    assert len(lines) == 6 and lines[-1].startswith("4 more: manoeuvre check")


def test_the_gravest_verdict_counts():
    assert worst([Finding("a", "ok", ""), Finding("b", "mend", ""), Finding("c", "note", "")]) == "mend"
    assert worst([]) == "ok"
