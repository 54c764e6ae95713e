"""Recordings as all kinds of programs would have written them, right ones and spoilt ones."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from robustness_oracle import (
    PERIODIC,
    SHIPS,
    TURN,
    UNITS,
    Said,
    Tried,
    cells_of,
    difference,
    meaning,
    sailed,
    table_of,
)

import manoeuvre_nn as mnn
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read.reader import read_recording

CHANNELS = ("u", "v", "r", "x", "y", "psi", "delta")
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "blanks": "whitespace"}
HEADINGS = ("{}", "{} [{}]", "{}_{}", "Grösse {}", " {} ", "{}\u202e", 'the "{}"', "{}/{}", "{}'")
CELLS = (
    "", "NaN", "nan", "-", "null", "inf", "-inf", "Infinity", "1e20", "-1e20", "1e400", "9e99", "9999", "1,5", "1.5.2",
    "0x1f", "1_000", "1 000", "１２", "٣", "1+2j", "True", "1e", "--1", "#REF!", "=1+1", "\x1b[31m1", "1\x00", '"1"',
    "'1", "2020-01-01", "−1", "1e-320", "0", "1" * 400, "12:30:00", "1;2", "\ufeff1", "+", ".", "e5", "nan1", "1d3",
    "5%",
)  # fmt: skip


@dataclass(frozen=True)
class Form:
    """A recording and one way to write it.

    Attributes:
        ship: Name in conf/ship.
        particulars: The ship.
        truth: ``time`` and channels in SI.
        table: What is written, in the file's units.
        said: The mapping.
    """

    ship: str
    particulars: Any
    truth: dict[str, np.ndarray]
    table: pd.DataFrame
    said: Said


def form(rng: np.random.Generator, plain: bool = False) -> Form:
    """A run of some ship, its channels in some units, turned and shifted unless it is a plain one."""
    name = SHIPS[rng.integers(len(SHIPS))]
    runs = sailed(name)
    run = runs[int(rng.integers(len(runs)))]
    kept = [CHANNELS, ("x", "y", "psi", "delta"), ("u", "v", "psi", "delta"), ("r", "x", "y", "psi", "delta")]
    names = kept[0 if plain else int(rng.integers(len(kept)))]
    if "n" in run.channels and rng.random() < 0.3:
        names = (*names, "n")
    heading = HEADINGS[0 if plain else int(rng.integers(len(HEADINGS)))]
    said: Said = {"channels": {}, "rudder_positive_to": str(rng.choice(["starboard", "port"]))}
    truth, table = {"time": run.time, **{k: run[k] for k in names}}, {}
    for channel in ("time", *names):
        entry, values = _entry(rng, channel, heading, plain), truth[channel]
        if channel in PERIODIC and rng.random() < 0.5:
            values = np.mod(values, TURN)
        side = -1 if channel == "delta" and said["rudder_positive_to"] == "port" else 1
        factor = entry.get("sign", 1) * side * entry.get("scale", 1.0) * UNITS[channel][entry["unit"]]
        table[entry["column"]] = values / factor + entry.get("offset", 0.0)
        if channel == "time":
            said["time"] = entry
        else:
            said["channels"][channel] = entry
    return Form(name, runs.ship, truth, pd.DataFrame(table), said)


def _entry(rng: np.random.Generator, channel: str, heading: str, plain: bool) -> dict[str, Any]:
    """A channel's entry in the mapping."""
    unit = str(rng.choice(list(UNITS[channel])))
    entry: dict[str, Any] = {"column": heading.format(channel, unit).strip(), "unit": unit}
    if channel != "time" and not plain:
        entry |= {"sign": int(rng.choice([1, -1]))} if rng.random() < 0.5 else {}
        entry |= {"offset": float(rng.normal())} if rng.random() < 0.2 else {}
        entry |= {"scale": float(rng.uniform(0.5, 2))} if rng.random() < 0.2 else {}
    return entry


def reads(path: Path, said: Said, ship: str, expected: dict[str, np.ndarray] | str) -> str:
    """Read a file by its mapping; what is wrong with it."""
    place = path.with_name("mapping.yaml")
    run = mnn.read(path, mapping=str(place), ship=ship)[0]
    return f"accepted, although {expected}" if isinstance(expected, str) else difference(run, expected)


def written(folder: Path, name: str, content: bytes, said: Said) -> Path:
    """A file and its mapping beside it."""
    path = folder / name
    path.write_bytes(content)
    (folder / "mapping.yaml").write_text(yaml.safe_dump(said, allow_unicode=True))
    return path


def rewritten(rng: np.random.Generator, folder: Path) -> Tried:
    """A right file in a form that must not change anything."""
    made = form(rng)
    table, said = made.table, dict(made.said)
    if rng.random() < 0.5:
        table = table[list(rng.permutation(table.columns))]
    if rng.random() < 0.4:
        table = table.assign(**{"not\x1b[2J needed": np.nan, "remarks": "steady, so far"})
    if rng.random() < 0.2:
        table, made = _with_gaps(rng, table, made)
        said["fill_gaps"] = True
    content, suffix, told = _text(rng, table, said)
    path = written(folder, f"run{suffix}", content, said)
    work = partial(reads, path, said, made.ship, made.truth)
    return Tried(f"{made.ship} {told} {list(table.columns)}", work, "read", (path.name,))


def _with_gaps(rng: np.random.Generator, table: pd.DataFrame, made: Form) -> tuple[pd.DataFrame, Form]:
    """Up to three cells in a row of a channel are empty, and filled by a straight line."""
    channel = str(rng.choice(list(made.said["channels"])))
    first, count = int(rng.integers(5, len(table) - 9)), int(rng.integers(1, 4))
    lost = np.isin(np.arange(len(table)), np.arange(first, first + count))
    column = made.said["channels"][channel]["column"]
    time, values = made.truth["time"], made.truth[channel]
    filled = np.where(lost, np.interp(time, time[~lost], values[~lost]), values)
    return table.assign(**{column: table[column].mask(lost)}), with_truth(made, **{channel: filled})


def _text(rng: np.random.Generator, table: pd.DataFrame, said: Said) -> tuple[bytes, str, str]:
    """A table as a text, the mapping told of its form: bytes, suffix, what was done."""
    kinds = [k for k in SEPARATORS if k != "blanks" or not any(c.isspace() for name in table for c in str(name))]
    kind = str(rng.choice([k for k in kinds if k != "blanks" or "remarks" not in table]))
    separator = SEPARATORS[kind]
    comma = bool(rng.random() < 0.3 and kind != "comma")
    said |= {"delimiter": separator} if separator != "," else {}
    said |= {"decimal": "comma"} if comma else {}
    digits = str(rng.choice(["%.12g", "%.15g", "%.17e"]))
    rows = [[_cell(v, digits, comma, kind == "comma") for v in row] for row in table.itertuples(index=False)]
    headings = [f'"{h.replace(chr(34), chr(34) * 2)}"' if '"' in h else h for h in table]
    quoted = bool(rng.random() < 0.2 and kind != "blanks")
    if quoted:
        rows = [[f'"{cell}"' if not cell.startswith('"') else cell for cell in row] for row in rows]
    between = {"whitespace": "  "}.get(separator, f" {separator}" if rng.random() < 0.2 and not quoted else separator)
    lines = [separator.join(headings) if kind != "blanks" else " ".join(headings)]
    if rng.random() < 0.2:
        said["header"], lines = False, []
        place = {heading: str(k + 1) for k, heading in enumerate(table.columns)}
        said["time"] = {**said["time"], "column": place[said["time"]["column"]]}
        said["channels"] = {k: {**e, "column": place[e["column"]]} for k, e in said["channels"].items()}
    if rng.random() < 0.2:
        said["skip_rows"], lines = 2, ["of the ship's recorder", "1;2,3 | 4", *lines]
    rows = [[cell or "NaN" for cell in row] for row in rows] if kind == "blanks" else rows
    lines += [
        part for row in rows for part in ([between.join(row), ""] if rng.random() < 0.02 else [between.join(row)])
    ]
    end = str(rng.choice(["\n", "\r\n", "\r"]))
    coding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16"], p=[0.6, 0.2, 0.2]))
    text = end.join(lines) + (end if rng.random() < 0.7 else "")
    suffix = str(rng.choice([".csv", ".txt", ".dat", ".CSV", ".log"]))
    return (
        text.encode(coding),
        suffix,
        f"{kind} {coding} {digits}{' comma' if comma else ''}{' quoted' if quoted else ''}",
    )


def _cell(value: Any, digits: str, comma: bool, quote: bool) -> str:
    """A cell."""
    if isinstance(value, str):
        return f'"{value}"' if quote else value
    text = "" if np.isnan(value) else digits % value
    return text.replace(".", ",") if comma else text


def spoilt(rng: np.random.Generator, folder: Path) -> Tried:
    """A text whose cells, lines or bytes are changed."""
    made = form(rng, plain=True)
    said = dict(made.said)
    raw = made.table.to_csv(index=False).encode()
    told = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        name = str(rng.choice(list(CHANGES)))
        told.append(name)
        raw = CHANGES[name](rng, raw)
    expected = meaning(cells_of(raw, said), said, made.particulars)
    path = written(folder, "run.csv", raw, said)
    must = "refuse" if isinstance(expected, str) else "read" if set(told) <= HARMLESS else "either"
    return Tried(f"{made.ship} {told}", partial(reads, path, said, made.ship, expected), must, ("run.csv",))


def _lines(raw: bytes) -> list[bytes]:
    return raw.split(b"\n")


def _with_cell(rng: np.random.Generator, raw: bytes) -> bytes:
    """A cell becomes something else."""
    lines = _lines(raw)
    row = int(rng.integers(1, max(len(lines) - 1, 2))) % len(lines)
    cells = lines[row].split(b",")
    cells[rng.integers(len(cells))] = str(rng.choice(CELLS)).encode()
    lines[row] = b",".join(cells)
    return b"\n".join(lines)


def _with_lines(rng: np.random.Generator, raw: bytes, change: Callable[[list[bytes], int], None]) -> bytes:
    """Lines below the headings are changed in place, from one on."""
    lines = _lines(raw)
    if len(lines) > 4:
        change(lines, int(rng.integers(1, len(lines) - 3)))
    return b"\n".join(lines)


def _swap(lines: list[bytes], row: int) -> None:
    lines[row], lines[row + 1] = lines[row + 1], lines[row]


def _merge(lines: list[bytes], row: int) -> None:
    lines[row : row + 2] = [lines[row] + lines[row + 1]]


def _with_bytes(rng: np.random.Generator, raw: bytes) -> bytes:
    """Some bytes become others."""
    changed = bytearray(raw)
    for at in rng.integers(len(raw), size=int(rng.integers(1, 6))) if raw else ():
        changed[at] = int(rng.integers(256))
    return bytes(changed)


def _with_column(rng: np.random.Generator, raw: bytes, change: Callable[[list[list[bytes]], int], None]) -> bytes:
    """A column is changed in place."""
    rows = [line.split(b",") for line in _lines(raw)]
    change(rows, int(rng.integers(len(rows[0]))))
    return b"\n".join(b",".join(row) for row in rows)


def _drop(rows: list[list[bytes]], k: int) -> None:
    for row in rows:
        del row[k : k + 1]


def _twice(rows: list[list[bytes]], k: int) -> None:
    for row in rows:
        row += row[k : k + 1]


def _emptied(rows: list[list[bytes]], k: int) -> None:
    for row in rows[1:]:
        row[k : k + 1] = [b""] * len(row[k : k + 1])


CHANGES: dict[str, Callable[[np.random.Generator, bytes], bytes]] = {
    "cell": _with_cell,
    "cells": lambda rng, raw: _with_cell(rng, _with_cell(rng, raw)),
    "bytes": _with_bytes,
    "cut": lambda rng, raw: raw[: int(rng.integers(len(raw) + 1))],
    "headings alone": lambda rng, raw: _lines(raw)[0],
    "empty": lambda rng, raw: b"" if rng.random() < 0.5 else b" \r\n\t\n",
    "garbage": lambda rng, raw: rng.bytes(int(rng.integers(1, 3000))),
    "garbage inside": lambda rng, raw: raw[: len(raw) // 2] + rng.bytes(40) + raw[len(raw) // 2 :],
    "NUL": lambda rng, raw: raw[: len(raw) // 2] + b"\0" + raw[len(raw) // 2 :],
    "line lost": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.__delitem__(k)),
    "lines lost": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.__delitem__(slice(k, k + 60))),
    "line twice": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.insert(k, lines[k])),
    "lines exchanged": lambda rng, raw: _with_lines(rng, raw, _swap),
    "lines joined": lambda rng, raw: _with_lines(rng, raw, _merge),
    "line shortened": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.__setitem__(k, lines[k][:-30])),
    "comment inside": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.insert(k, b"# at anchor")),
    "huge cell": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.__setitem__(k, b"7" * 2_000_000)),
    "column lost": lambda rng, raw: _with_column(rng, raw, _drop),
    "column twice": lambda rng, raw: _with_column(rng, raw, _twice),
    "column empty": lambda rng, raw: _with_column(rng, raw, _emptied),
    "blank line": lambda rng, raw: _with_lines(rng, raw, lambda lines, k: lines.insert(k, b" ,,\t;")),
    "two files": lambda rng, raw: raw + raw,
    "BOM": lambda rng, raw: b"\xef\xbb\xbf" + raw,
    "UTF-16": lambda rng, raw: raw.decode("latin-1").encode("utf-16"),
    "CRLF": lambda rng, raw: raw.replace(b"\n", b"\r\n"),
    "one quote": lambda rng, raw: raw.replace(b",", b',"', 1),
}
HARMLESS = {"blank line", "BOM", "UTF-16", "CRLF"}


def container(rng: np.random.Generator, folder: Path) -> Tried:
    """A MAT or parquet file, right or damaged."""
    from scipy.io import savemat

    made = form(rng, plain=True)
    table = made.table
    path = folder / str(rng.choice(["run.mat", "run.parquet"]))
    if path.suffix == ".mat":
        savemat(path, {k: v.to_numpy() for k, v in table.items()}, do_compression=bool(rng.random() < 0.5))
    else:
        table.to_parquet(path)
    raw, told = path.read_bytes(), str(rng.choice(["as it is", "bytes", "cut", "garbage", "other suffix"]))
    if told == "other suffix":
        path = path.with_suffix({".mat": ".parquet", ".parquet": ".mat"}[path.suffix])
    changed = raw if told in {"as it is", "other suffix"} else CHANGES[told](rng, raw)
    written(folder, path.name, changed, made.said)
    work = partial(_reads_container, path, made)
    must = {"as it is": "read", "other suffix": "refuse"}.get(told, "either")
    return Tried(f"{made.ship} {path.name} {told}", work, must, (path.name,))  # type: ignore[arg-type]


def _reads_container(path: Path, made: Form) -> str:
    """Read it; its own library says what is in it."""
    run = mnn.read(path, mapping=str(path.with_name("mapping.yaml")), ship=made.ship)[0]
    expected = meaning(table_of(path), made.said, made.particulars)
    return f"accepted, although {expected}" if isinstance(expected, str) else difference(run, expected)


def with_truth(made: Form, **truth: np.ndarray) -> Form:
    """The same with other right answers."""
    return replace(made, truth={**made.truth, **truth})


def proposed(rng: np.random.Generator, folder: Path) -> Tried:
    """A file without a mapping, whose headings name channels and units: what is proposed and not doubted is right."""
    made = form(rng, plain=True)
    named = {e["column"]: f"{e['column']} [{e['unit']}]" for e in made.said["channels"].values()}
    table = made.table.rename(columns={**named, "time": f"time [{made.said['time']['unit']}]"})
    path = folder / "run.csv"
    table[list(rng.permutation(table.columns))].to_csv(path, index=False)
    return Tried(f"{made.ship} {list(table.columns)}", partial(_proposes, path, made), "either", (path.name,))


def _proposes(path: Path, made: Form) -> str:
    """Read it by the mapping that is proposed for it."""
    proposal = propose(path, made.particulars)
    doubted = [c for c in (proposal.time, *proposal.choices) if not c.decided]
    if doubted or proposal.undecided or proposal.finding:
        return ""
    return difference(read_recording(path, proposal.mapping, made.particulars), made.truth)
