"""Whatever a file holds: what was written is read, and all else is a recording or one line that says what is wrong."""

import csv
import io
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.read.mapping import Mapping, mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars
NAMES = ("u", "v", "r", "x", "y", "psi", "delta")
UNITS = {
    "u": {"m/s": 1.0, "kn": 1852 / 3600, "km/h": 1 / 3.6}, "r": {"rad/s": 1.0, "deg/s": DEGREE, "deg/min": DEGREE / 60},
    "x": {"m": 1.0, "ft": 0.3048, "km": 1000.0}, "psi": {"rad": 1.0, "deg": DEGREE},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
}  # fmt: skip
UNITS |= {"v": UNITS["u"], "y": UNITS["x"], "delta": UNITS["psi"]}
PLAIN = mapping(
    time={"column": "time", "unit": "s"}, channels={k: {"column": k, "unit": next(iter(UNITS[k]))} for k in NAMES}
)
numbers = st.floats(-1e3, 1e3, allow_subnormal=False)


@st.composite
def entries(draw, name: str) -> dict:
    entry = {"column": name, "unit": draw(st.sampled_from(sorted(UNITS[name])))}
    if name != "time":
        entry |= {"sign": draw(st.sampled_from([1, -1])), "offset": draw(st.floats(-100, 100))}
        entry |= {"scale": draw(st.floats(0.1, 10))}
    return entry


@st.composite
def runs(draw) -> Recording:
    """Channels of no ship: whatever numbers."""
    time = np.cumsum(draw(st.lists(st.floats(1.5, 3.0), min_size=30, max_size=40)))
    seed = draw(st.integers(0, 2**32 - 1))
    walks = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.4, (len(NAMES), len(time))), axis=1)
    return Recording("run", time - time[0], dict(zip(NAMES, walks, strict=True)))


@st.composite
def settings(draw) -> dict:
    separator = draw(st.sampled_from([",", ";", "\t", "|", "whitespace"]))
    return {
        "time": draw(entries("time")),
        "channels": {k: draw(entries(k)) for k in NAMES},
        "rudder_positive_to": draw(st.sampled_from(["starboard", "port"])),
        "delimiter": separator,
        "decimal": "point" if separator == "," else draw(st.sampled_from(["point", "comma"])),
    }


def factor(said: Mapping, name: str) -> float:
    """Written down again: the package's own table of units is what is tested."""
    entry = said.time if name == "time" else said.channels[name]
    side = -1 if name == "delta" and said.rudder_positive_to == "port" else 1
    return entry.sign * side * entry.scale * UNITS[name][entry.unit]


def text_of(run: Recording, said: Mapping, order: list[str]) -> str:
    """The run as that mapping has it."""
    cells = {"time": [f"{t / factor(said, 'time'):.17g}" for t in run.time]}
    cells |= {k: [f"{v / factor(said, k) + said.channels[k].offset:.17g}" for v in run[k]] for k in NAMES}
    rows = [order, *zip(*(cells[k] for k in order), strict=True)]
    between = " " if said.delimiter == "whitespace" else said.delimiter
    point = "," if said.decimal == "comma" else "."
    return "\n".join([between.join(rows[0]), *(between.join(row).replace(".", point) for row in rows[1:])])


@given(runs(), settings(), st.permutations(["time", *NAMES]), st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))
def test_what_was_written_is_read_in_whatever_units_signs_order_and_coding(
    tmp_path_factory, run, given_as, order, coding
):
    said = mapping(**given_as)
    path = tmp_path_factory.mktemp("a") / "run.csv"
    path.write_bytes(text_of(run, said, order).encode(coding))
    read = read_recording(path, said, SHIP)
    assert read.time == pytest.approx(run.time, abs=1e-9)
    for name in NAMES:
        turns = 2 * np.pi * np.round((read[name][0] - run[name][0]) / (2 * np.pi)) if name == "psi" else 0.0
        assert read[name] == pytest.approx(run[name] + turns, abs=1e-9), name


@given(settings(), st.sampled_from([{}, {"fill_gaps": 2.5}, {"start": 1.0, "end": 9.0}, {"frame": "earth"}]))
def test_a_mapping_says_the_same_when_it_is_written_down_and_read(given_as, more):
    said = mapping(**given_as, **more)
    written = asdict(said)
    written["time"] = {k: v for k, v in written["time"].items() if k in {"column", "unit", "scale"}}
    assert mapping(**written) == said


def read_or_refused(path) -> Recording | None:
    """What comes of a file, checked for what every recording must be and every refusal must say."""
    try:
        run = read_recording(path, PLAIN, SHIP)
    except InputError as error:
        line = str(error)
        assert "\n" not in line and len(line) < 700 and path.stem in line
        return None
    assert (np.diff(run.time) > 0).all() and len(run) >= 20
    assert all(np.isfinite(values).all() and np.abs(values).max() < 1e9 for values in run.channels.values())
    return run


@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda text: text.encode("utf-8", "replace"))))
def test_any_bytes_are_refused_in_one_line(tmp_path_factory, content):
    for suffix in (".csv", ".mat", ".parquet"):
        path = tmp_path_factory.mktemp("a") / f"run{suffix}"
        path.write_bytes(content)
        assert read_or_refused(path) is None


CELL = st.one_of(
    numbers.map(repr),
    st.sampled_from(["", "nan", "inf", "-inf", "1e20", "1e400", "9" * 400, "1,5", "0x1", "\x1b[2J", "٣", "True"]),
    st.text(alphabet=st.characters(blacklist_categories=["Cs"], blacklist_characters="\r\n\0"), max_size=8),
)  # fmt: skip


@given(runs(), st.lists(st.tuples(st.integers(0, 29), st.sampled_from(["time", *NAMES]), CELL), min_size=1, max_size=3))
def test_a_cell_is_the_number_that_stands_there_or_the_file_is_refused(tmp_path_factory, run, cells):
    columns = {"time": run.time, **{k: run[k] for k in NAMES}}
    rows = [[repr(float(values[k])) for values in columns.values()] for k in range(len(run))]
    for row, name, cell in cells:
        rows[row][list(columns).index(name)] = cell
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([list(columns), *rows])
    path = tmp_path_factory.mktemp("a") / "run.csv"
    path.write_text(out.getvalue(), encoding="utf-8", newline="")
    read = read_or_refused(path)
    if read is not None:
        for row, name, _ in cells:
            got = read.time[row] if name == "time" else read[name][row]
            wanted = float(rows[row][list(columns).index(name)])
            wanted -= float(rows[0][0]) if name == "time" else 0.0
            assert abs(np.angle(np.exp(1j * (got - wanted)))) < 1e-6 if name == "psi" else got == pytest.approx(wanted)


@given(runs(), st.data())
def test_lines_that_are_lost_doubled_or_exchanged_are_seen_in_the_times(tmp_path_factory, run, data):
    lines = text_of(run, PLAIN, ["time", *NAMES]).split("\n")
    at = data.draw(st.integers(2, len(lines) - 2))
    spoilt = data.draw(st.sampled_from([
        [*lines[:at], lines[at], *lines[at:]], [*lines[:at], lines[at + 1], lines[at], *lines[at + 2 :]],
        [*lines[: at + 1], lines[at][: len(lines[at]) // 4], *lines[at + 1 :]], [lines[0], *lines[:0:-1]],
    ]))  # fmt: skip
    path = tmp_path_factory.mktemp("a") / "run.csv"
    path.write_text("\n".join(spoilt))
    assert read_or_refused(path) is None
