"""NMEA 0183: sentences of many instruments in one text, with or without a logger's time stamps, as columns."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.recording.read.containers import NOTES, QUESTIONS, reads
from manoeuvre_nn.recording.read.logger_stamps import StampForm, form_of, without_midnights
from manoeuvre_nn.recording.read.nmea_sentences import DATE, LEADING, SENTENCES, UTC, Columns, Fields
from manoeuvre_nn.recording.read.streams import Stream, on_one_axis

BLOCK = 1 << 23
"""Bytes that are looked at together."""
MEMORY = 3.0
"""Bytes of memory that a byte of a log takes."""
LOOKED_AT = 200
"""Lines at the begin of a text that tell whether it is a log of sentences."""
SENTENCE = re.compile(
    rb"^([^$!\n]*)\$([A-Z][A-Z0-9])(" + "|".join(SENTENCES).encode() + rb"),([^*$!\n]*)(?:\*([0-9A-Fa-f]{2}))?", re.M
)
"""What stands before it, talker, name, fields, checksum."""
ANY_SENTENCE = re.compile(rb"[$!](?:[A-Z][A-Z0-9][A-Z]{3}|P[A-Z0-9]{3,}),")
CIRCLE = 360.0
Series = Float[np.ndarray, " n"]


def is_log(begin: bytes) -> bool:
    """Whether a text's begin has sentences in most of its lines."""
    lines = [line for line in begin.replace(b"\r", b"\n").split(b"\n")[:LOOKED_AT] if line.strip()]
    return sum(bool(ANY_SENTENCE.search(line)) for line in lines) > len(lines) / 2


@dataclass
class _Log:
    """What has been read of a file.

    Attributes:
        form: How the logger writes times; None if it does not.
        checked: Whether sentences have checksums.
        stamps: Times that the logger wrote, of all sentences in the order of the file.
        parts: Talker and sentence -> which sentences they are, and their columns, block by block.
        wrong: Sentences whose checksum is wrong or cut off.
        count: Sentences that were kept.
    """

    form: StampForm | None = None
    checked: bool = True
    stamps: list[Series] = field(default_factory=list)
    parts: dict[tuple[str, str], list[tuple[np.ndarray, Columns]]] = field(default_factory=lambda: defaultdict(list))
    wrong: int = 0
    count: int = 0


@reads(".nmea", known_by=is_log)
def nmea_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Columns of a log of NMEA 0183 sentences: ``GPRMC.latitude [deg]``, ``HEHDT.heading [deg]``.

    Sentences whose checksum is wrong are dropped and counted; in a log with checksums those without one are dropped
    too, for they are cut off. Times are the logger's, where it wrote any. Otherwise a sentence has the time of the
    position (RMC, GGA, GNS, GLL, ZDA) before it; several of one kind between two positions are spread evenly.

    Args:
        path: The file.
        columns: Columns that are wanted; None is all.

    Returns:
        The columns on one axis of time, see :func:`~manoeuvre_nn.recording.read.streams.on_one_axis`.

    Raises:
        InputError: If there is no such sentence in it, or no time.
    """
    size = path.stat().st_size
    check_memory(f"{path.name}: {size / 1e9:.2g} GB of sentences", MEMORY * size, "cut the log into parts")
    log = _Log()
    for block in _blocks(path):
        _add(log, block)
    if not log.count:
        raise InputError(
            f"{path.name}: no sentence such as $GPRMC or $HEHDT{' with a right checksum' * bool(log.wrong)}; expected "
            "NMEA 0183, a sentence a line"
        )
    whole = {key: _joined(parts) for key, parts in log.parts.items()}
    times, dated = _times(path, log, whole)
    frame = on_one_axis(_streams(whole, times), columns, dated)
    if not len(frame):
        raise InputError(f"{path.name}: no sentence has both a value and a time; expected positions, heading or rudder")
    frame.attrs[NOTES] = _notes(log)
    frame.attrs[QUESTIONS] = {
        name: "magnetic: add the variation (offset: minus the variation) or name a true heading"
        for name in frame.columns if "magnetic" in name
    }  # fmt: skip
    return frame


def _blocks(path: Path) -> Iterator[bytes]:
    """Whole lines of a file, ended as on Linux."""
    left = b""
    with path.open("rb") as file:
        while read := file.read(BLOCK):
            whole, end, left = (left + read.replace(b"\r", b"\n")).rpartition(b"\n")
            yield whole + end
            left = left[-BLOCK:]
    yield left


def _add(log: _Log, block: bytes) -> None:
    """Read the sentences of a block into what has been read."""
    found = SENTENCE.findall(block)
    if found and not log.count:
        log.checked = sum(bool(f[4]) for f in found) > len(found) / 2
    if found and log.checked:
        good = _checksums_hold(found)
        log.wrong += int((~good).sum())
        found = [one for one, kept in zip(found, good, strict=True) if kept]
    if not found:
        return
    before = [one[0] for one in found]
    if not log.count:
        log.form = form_of(before)
    log.stamps.append(log.form.read(before) if log.form else np.full(len(found), np.nan))
    rows: dict[tuple[bytes, bytes], list[list[bytes]]] = defaultdict(list)
    places: dict[tuple[bytes, bytes], list[int]] = defaultdict(list)
    for k, (_, talker, name, text, _) in enumerate(found, log.count):
        rows[talker, name].append(text.split(b","))
        places[talker, name].append(k)
    log.count += len(found)
    for (talker, name), fields in rows.items():
        columns = SENTENCES[name.decode()](Fields(fields))
        log.parts[talker.decode(), name.decode()].append((np.array(places[talker, name]), columns))


def _checksums_hold(found: Sequence[tuple[bytes, ...]]) -> Bool[np.ndarray, " n"]:
    """Which sentences' letters between ``$`` and ``*``, joined by exclusive or, are what stands behind the ``*``."""
    letters = b"".join(b"%b%b,%b" % one[1:4] for one in found)
    lengths = np.array([len(one[3]) for one in found]) + 6
    begins = np.append(0, np.cumsum(lengths)[:-1])
    made = np.bitwise_xor.reduceat(np.frombuffer(letters, dtype=np.uint8), begins)
    said = np.array([int(one[4], 16) if one[4] else -1 for one in found])
    return made == said


def _joined(parts: list[tuple[np.ndarray, Columns]]) -> tuple[np.ndarray, Columns]:
    """Blocks of one kind of sentence as one; a column that a block lacks is empty there."""
    names = dict.fromkeys(name for _, columns in parts for name in columns)
    places = np.concatenate([where for where, _ in parts])
    columns = {
        name: np.concatenate([some.get(name, np.full(len(where), np.nan)) for where, some in parts]) for name in names
    }
    return places, columns


def _times(path: Path, log: _Log, whole: dict[tuple[str, str], tuple[np.ndarray, Columns]]) -> tuple[Series, bool]:
    """Time of every sentence [s], and whether it counts from 1970."""
    if log.form is not None:
        stamps = np.concatenate(log.stamps)
        return without_midnights(stamps) if log.form.clock else stamps, log.form.dated
    given = np.full(log.count, np.nan)
    midnight = np.full(log.count, np.nan)
    for places, columns in whole.values():
        if UTC in columns:
            given[places] = columns[UTC]
            midnight[places] = columns.get(DATE, np.nan)
    known = np.flatnonzero(np.isfinite(given))
    if not len(known):
        raise InputError(
            f"{path.name}: neither time stamps of a logger nor sentences with a time (RMC, GGA, GLL, ZDA); record one"
        )
    risen = without_midnights(given)
    dated = np.flatnonzero(np.isfinite(midnight) & np.isfinite(given))
    start = float(midnight[dated[0]] - (risen[dated[0]] - given[dated[0]])) if len(dated) else 0.0
    times = np.full(log.count, np.nan)
    for places, _ in whole.values():
        times[places] = _after_positions(places, known, risen[known] + start)
    return times, bool(len(dated))


def _after_positions(
    places: Int[np.ndarray, " m"], known: Int[np.ndarray, " n"], times: Series
) -> Float[np.ndarray, " m"]:
    """Times of sentences of one kind: of the position before, spread evenly if there are several before the next.

    Args:
        places: Which sentences of the log they are.
        known: Which sentences have a time.
        times: These times [s].

    Returns:
        Times [s]; NaN before the first position.
    """
    new = np.append(True, np.diff(times) != 0)
    begins, starts = known[new], times[new]
    if len(starts) < 2:
        return np.where(places >= begins[0], starts[0], np.nan)
    usual = float(np.median(np.diff(starts)))
    steps = np.append(np.diff(starts), usual)
    steps = np.where((steps > 0) & (steps < 2 * usual), steps, usual)
    epoch = np.searchsorted(begins, places, side="right") - 1
    _, first, count = np.unique(epoch, return_index=True, return_counts=True)
    rank = np.arange(len(places)) - np.repeat(first, count)
    return np.where(epoch < 0, np.nan, starts[epoch] + steps[epoch] * rank / np.repeat(count, count))


def _streams(whole: dict[tuple[str, str], tuple[np.ndarray, Columns]], times: Series) -> list[Stream]:
    """Sensors of a log, the more trusted sentences first."""
    order = list(SENTENCES)
    made = []
    for talker, name in sorted(whole, key=lambda key: order.index(key[1])):
        places, columns = whole[talker, name]
        kept = {f"{talker}{name}.{c}": v for c, v in columns.items() if c not in {UTC, DATE} and np.isfinite(v).any()}
        angles = {c: CIRCLE for c in kept if c.endswith("[deg]") and "latitude" not in c}
        made.append(Stream(times[places], kept, name in LEADING, angles))
    return made


def _notes(log: _Log) -> list[str]:
    """What a person should know of how the log was read."""
    notes = []
    if log.wrong:
        notes.append(f"Dropped: {log.wrong} of {log.wrong + log.count} sentences, whose checksum is wrong or cut off.")
    if not log.checked:
        notes.append("Sentences have no checksums: a damaged one cannot be told from a good one.")
    if log.form is None:
        notes.append("No time stamps of the logger: sentences have the time of the position before them.")
    return notes
