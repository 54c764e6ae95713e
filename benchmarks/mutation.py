"""Break the code as a physicist or a statistician would by a slip, and count which slips no test tells.

    python benchmarks/mutation.py rooms=diagnosis,effect,recording/check,manoeuvre/criteria.py,studies/concealed_trial
        [per_room=30] [seed=0] [out=FILE.json] [only=ID,... | only=FILE.json] [tests=PLACE,...] [slowest=4]
        [seconds=20] [durations=FILE] [cache=FOLDER]

A slip is another number, sign, operation or comparison, a term left out, a condition that is never or always met,
max for min, the wrong argument or place: :mod:`mutation_source`. Nothing is written into the package: a process of its
own imports the one module with the slip in it and runs the tests that execute the line, cheapest first.

    rooms      folders of the package, or files in them, or folders of the studies
    per_room   how many slips of a room are tried; two thirds are thresholds, bounds, priors and vetoes, while there are
               so many, the others come from all files and kinds
    only       slips by their names, or those that survived in a FILE.json of before
    tests      folders or files below tests/ that may tell a slip; without it, those of the room and its neighbours
    slowest    tests that take longer [s] are not asked
    seconds    most time [s] of the tests that are asked about one slip
    durations  output of pytest --durations=0 --durations-min=1: tests that are known to be slow are not begun
    cache      where it is kept which test executes which line (some minutes a room; made again when the code changes)

A slip is *killed* by a test that fails, or by tests that take four times as long. Those in mutation_equivalent.yaml
change nothing that can be observed, and stand in their own column. The exit code is 1 if a room has 10 % survivors.
Needs ``pip install -e ".[test,mutation]"``. ``MUTATION_LOG=FILE`` keeps what the last run of tests has printed.
"""

import json
import os
import random
import re
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import yaml
from mutation_source import ROOT, Mutant, mutants
from mutation_tests import TestMap, judged, load_libraries, test_map
from mutation_users import lines_of

PACKAGE = Path("src/manoeuvre_nn")
EQUIVALENT = Path(__file__).with_name("mutation_equivalent.yaml")
NEIGHBOURS = {
    "core": ["manoeuvre", "effect", "network"],
    "diagnosis": ["report/test_first_sentence.py", "report/test_diagnosis_report.py", "report/test_answers.py"],
    "estimation": [
        "diagnosis",
        "effect/test_changed_hulls.py",
        "training/test_closed_loop_fit.py",
        "training/test_defaults.py",
        "dynamics/test_driven_ships.py",
        "ship/test_own_ship.py",
        "commands/test_coefficients_command.py",
        "studies/wang1996/test_stepwise.py",
    ],
    "recording": ["diagnosis/test_findings_weighed.py", "diagnosis/test_holes_bridged.py"],
    "network": ["training/test_fits.py"],
    "numerics": ["estimation", "training"],
    "scoring": ["diagnosis", "training"],
    "effect": ["physics", "dynamics"],
    "ship": ["physics", "dynamics", "studies/wang1996/test_wang1996_simulations.py"],
    "dynamics": ["physics"],
}
"""Rooms, and files of tests, that are asked as well: CI asks all."""
OF_ALL_ROOMS = ("test_table_of_numbers.py",)
DECISIONS = 2 / 3
"""Share of a sample that are thresholds, bounds, priors and vetoes."""
MOST_SURVIVORS = 0.10
SETTINGS = {
    "per_room": "30", "seed": "0", "out": "", "only": "", "tests": "", "slowest": "4", "seconds": "20", "durations": "",
    "cache": str(Path.home() / ".cache" / "manoeuvre_nn" / "mutation"),
}  # fmt: skip


def main(words: list[str]) -> int:
    """Break, ask the tests, and print the table; the exit code."""
    given = dict(word.partition("=")[::2] for word in words)
    if "rooms" not in given or (unknown := set(given) - {"rooms", *SETTINGS}):
        asked = sorted(unknown) if "rooms" in given else "no rooms"
        print(f"error: {asked}: write rooms=ROOM,... and, as needed, {'= '.join(SETTINGS)}=")
        return 2
    settings = SETTINGS | given
    rooms = settings["rooms"].split(",")
    load_libraries()
    found = test_map(_test_files(rooms, settings["tests"]), Path(settings["cache"]), float(settings["slowest"]),
                     _slow(settings["durations"], float(settings["slowest"])))  # fmt: skip
    rows: list[dict] = []
    for room in rooms:
        rows += _room(room, _sample(room, settings), found, float(settings["seconds"]))
        if settings["out"]:
            Path(settings["out"]).write_text(json.dumps({"settings": settings, "mutants": rows}, indent=1))
    return _told(rows)


def _room(room: str, sample: list[Mutant], found: TestMap, most: float) -> Iterator[dict]:
    """What the tests say of every slip of a room."""
    equivalent = yaml.safe_load(EQUIVALENT.read_text()) or {}
    begun, control = time.monotonic(), False
    for k, mutant in enumerate(sample, 1):
        tests, seconds = found.chosen(lines_of(mutant), most)
        if mutant.id in equivalent:
            result, by = "equivalent", equivalent[mutant.id]
        elif not tests:
            result, by = "survived", "no test executes it"
        else:
            if not control and (said := judged(None, tests, seconds))[0] != "survived":
                raise SystemExit(f"error: without a slip {said[1]} fails: mend the tests first")
            control = True
            result, by = judged(mutant, tests, seconds)
        if result in {"survived", "late"}:
            print(f"{result} {_words(mutant)}", flush=True)
        if k % 10 == 0:
            print(f"{room}: {k} of {len(sample)}, {time.monotonic() - begun:.0f} s", flush=True)
        shown = {n: getattr(mutant, n) for n in ("id", "file", "line", "kind", "decision", "before", "after")}
        yield {"room": room, **shown, "result": result, "by": by, "tests": len(tests), "seconds": round(seconds, 1)}


def _words(mutant: Mutant) -> str:
    """A slip in a line."""
    place = f"{mutant.file.removeprefix(f'{PACKAGE}/')}:{mutant.line}"
    return f"{mutant.id} {place} {mutant.kind}: {mutant.before}  ->  {mutant.after}"


def _told(rows: list[dict]) -> int:
    """The table by room; 1 if a room has too many survivors."""
    print("".join(f"{name:>16}" for name in ("", "mutants", "killed", "survived", "equivalent", "survivors")))
    worst = 0.0
    for room in dict.fromkeys(row["room"] for row in rows):
        for name, here in _parts(room, [row for row in rows if row["room"] == room]):
            counts = Counter(row["result"] for row in here)
            share = counts["survived"] / max(len(here) - counts["equivalent"], 1)
            worst = max(worst, share if name == room else 0.0)
            cells = (len(here), counts["killed"] + counts["late"], counts["survived"], counts["equivalent"])
            print(f"{name[-16:]:>16}" + "".join(f"{cell:>16}" for cell in (*cells, f"{100 * share:.0f} %")))
    return int(worst >= MOST_SURVIVORS)


def _parts(room: str, rows: list[dict]) -> Iterator[tuple[str, list[dict]]]:
    """The whole of a room, and its decisions."""
    yield room, rows
    if decisions := [row for row in rows if row["decision"]]:
        yield "- decisions", decisions


def _sources(room: str) -> list[str]:
    """Files of a room."""
    path = ROOT / room if (ROOT / room).exists() else ROOT / PACKAGE / room
    files = [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))
    if not files or not path.exists():
        raise SystemExit(f"error: rooms={room}: neither {PACKAGE / room} nor {room} has Python files")
    return [str(file.relative_to(ROOT)) for file in files]


def _test_files(rooms: list[str], tests: str) -> list[Path]:
    """Files of tests that may tell a slip in the rooms."""
    own = [room if room.startswith("studies/") else room.split("/")[0] for room in rooms]
    of_rooms = [*OF_ALL_ROOMS, *(f for room in own for f in (room, *NEIGHBOURS.get(room, ())))]
    folders = tests.split(",") if tests else of_rooms
    paths = [ROOT / "tests" / folder for folder in folders]
    return sorted({file for path in paths for file in ([path] if path.suffix else path.rglob("test_*.py"))})


def _slow(durations: str, slowest: float) -> frozenset[str]:
    """Tests that took longer, by what pytest has printed."""
    if not durations:
        return frozenset()
    taken: defaultdict[str, float] = defaultdict(float)
    for seconds, test in re.findall(r"^([\d.]+)s call +(\S+::.*)$", Path(durations).read_text(), re.MULTILINE):
        taken[test] += float(seconds)
    return frozenset(test for test, seconds in taken.items() if seconds > slowest)


def _sample(room: str, settings: dict[str, str]) -> list[Mutant]:
    """Slips of a room that are tried."""
    every = [m for file in _sources(room) for m in mutants(file)]
    if settings["only"]:
        wanted = settings["only"]
        names = set(wanted.split(","))
        if wanted.endswith(".json"):
            rows = json.loads(Path(wanted).read_text())["mutants"]
            names = {row["id"] for row in rows if row["result"] == "survived"}
        return [m for m in every if m.id in names]
    rng, count = random.Random(f"{settings['seed']} {room}"), int(settings["per_room"])
    rng.shuffle(every)
    first = _spread([m for m in every if m.decision], round(DECISIONS * count))
    return first + _spread([m for m in every if not m.decision], count - len(first))


def _spread(mutants: list[Mutant], count: int) -> list[Mutant]:
    """So many of the slips, in their order, one a line, from files and kinds of which there are the fewest so far."""
    taken: list[Mutant] = []
    kinds: Counter[str] = Counter()
    files: Counter[str] = Counter()
    left = list({(m.file, m.line): m for m in mutants}.values())
    sizes = Counter(m.file for m in left)
    while left and len(taken) < count:
        best = min(left, key=lambda m: (kinds[m.kind] / count + files[m.file] / sizes[m.file], files[m.file]))
        left.remove(best)
        kinds[best.kind] += 1
        files[best.file] += 1
        taken.append(best)
    return taken


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
