"""Files from outside, spoilt in every way: each is read right or refused in one line.

What is tried, by the part of the number that is drawn:

- *rewritten*: a recording in any form that a mapping can say (units, signs, offsets, order of columns, separators,
  decimal commas, UTF-16, blank lines, quotes, columns that nobody needs, MAT, parquet). It **must be read**, and give
  what was sailed.
- *spoilt*: cells, lines and bytes of a file are changed. What it still says by a second, plain reader
  (robustness_oracle.py) is the only right answer; where that finds no number, an empty cell, a time that does not rise,
  a hole or a number beyond all ships, it **must be refused**. A change that leaves another well-formed number cannot be
  told from a measurement: then either is right, a refusal or exactly that number.
- *proposed*: a file whose headings name its channels and units; what ``import`` proposes and does not doubt is right.
- *log*: a workbook, a log of NMEA 0183, a bag, an MCAP or a MAT 7.3 file, whole or damaged: ``import`` **must read** a
  whole one, and refuse a damaged one in one line or read what is left of it.
- *faults*: a recording whose channels contradict each other or the ship (robustness_faults.py says which): it **must be
  reported** by the checks or refused; the same without a fault must not be.
- *mapping, effects, manifest, manoeuvre, ship, records*: one value of a file of settings is changed
  (robustness_settings.py). What makes no sense **must be refused**; else what it says must be what is used.
- *trap*: a file that would run something or never end (robustness_traps.py). It **must be refused**.

No fault is planted that no data can tell: a mirror of the whole motion, a current against a log that is off, one
plausible unit for another in a channel that nothing else measures.
"""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import robustness_faults
import robustness_logs
import robustness_recordings
import robustness_settings
import robustness_traps
from robustness_attack import Ended, Outcome, in_child
from robustness_oracle import Tried

from manoeuvre_nn.commands import guard

LIMIT_S = 10.0
"""Nothing takes longer [s]."""
MAX_LETTERS = 700
"""Longest message."""
SAID = "answer: "
KINDS: dict[str, tuple[float, Callable[[np.random.Generator, Path], Tried]]] = {
    "rewritten": (0.2, robustness_recordings.rewritten),
    "spoilt": (0.3, robustness_recordings.spoilt),
    "container": (0.05, robustness_recordings.container),
    "log": (0.03, robustness_logs.damaged),
    "proposed": (0.03, robustness_recordings.proposed),
    "faults": (0.15, robustness_faults.attack),
    **robustness_settings.KINDS,
}
"""What is tried -> how often, and how it is made ready."""
OBEYED = [*map(chr, range(0x20)), *map(chr, range(0x7F, 0xA0))]
"""What a terminal would obey."""


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Write one file, read it in a process of its own, and name what came of it."""
    rng = np.random.default_rng([seed, number])
    names, shares = list(KINDS), np.array([share for share, _ in KINDS.values()])
    kind = names[rng.choice(len(names), p=shares / shares.sum())]
    tried = KINDS[kind][1](rng, folder)
    ended = in_child(partial(_answer, tried, folder), folder, LIMIT_S)
    return _named(tried, f"{kind}: {tried.what}", ended, (folder / robustness_traps.CANARY).exists())


def _answer(tried: Tried, folder: Path) -> None:
    """Read what was written and say what is wrong with it, as a command would end."""
    tempfile.tempdir = str(folder)
    with guard.one_line():
        wrong = tried.work()
    print(f"{SAID}{wrong}")


def _named(tried: Tried, what: str, ended: Ended, executed: bool) -> Outcome:
    """What came of it."""
    if executed:
        return Outcome("executed", what)
    if ended.code is None:
        return Outcome("hang", what)
    told = [letter for letter in OBEYED if letter in (ended.out + ended.err).replace("\n", "").replace("\t", "")]
    if told:
        return Outcome("wrong", f"{what}: printed {told[0]!r}")
    if ended.code == guard.ending.WRONG_INPUT:
        unclear = _unclear(ended.err, tried.names)
        wrong = f"refused: {ended.err.strip()[:300]}" if tried.must == "read" else unclear
        return Outcome("wrong", f"{what}: {wrong}") if wrong else Outcome("clear error", what)
    if ended.code != 0:
        return Outcome("traceback", f"{what}: code {ended.code}: {' | '.join(ended.err.splitlines()[-3:])[:600]}")
    answer = ended.out.rpartition(SAID)[2].strip()
    if answer or ended.err or tried.must == "refuse":
        return Outcome("wrong", f"{what}: {answer or ended.err.strip()[:300] or 'accepted'}")
    return Outcome("right answer", what)


def _unclear(err: str, names: tuple[str, ...]) -> str:
    """What is wrong with a message: it is one line that says what is wrong with which file or setting."""
    lines = err.splitlines()
    if len(lines) != 1 or not lines[0].startswith("error: ") or len(lines[0]) > MAX_LETTERS:
        return f"no clear line: {err.strip()[:400]!r}"
    if names and not any(name in lines[0] for name in names):
        return f"the line names none of {', '.join(names)}: {lines[0][:300]}"
    return ""
