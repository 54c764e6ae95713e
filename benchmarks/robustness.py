"""Attack readers and commands as a stranger would, and count what comes of it.

    python benchmarks/robustness.py [inputs=10000] [commands=300] [disks=20] [checkpoints=100] [signals=60] [kills=50]
        [seed=0] [first=0] [out=FILE.json]

Only what is named is done, so many attacks each; ``first=4711 inputs=1`` repeats a single one. Each attack is made in
a process of its own. The exit code is 1 if a file's content was run (*executed*), a command hung, ended in a traceback,
or gave a wrong answer in silence.

    inputs       recordings, mappings, manifests, effects, configs and manoeuvres, mutated
    commands     command lines
    disks        disks that are full or read-only, under every command
    checkpoints  damaged checkpoints
    signals      ctrl-C and SIGTERM at a random moment of every command
    kills        kill -9 at a random moment, then the same command again: the same results, bit for bit
"""

import importlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from robustness_attack import BAD, RESULTS, Attack, Outcome

SECTIONS = ("inputs", "commands", "disks", "checkpoints", "signals", "kills")
"""What can be attacked: the module robustness_NAME has a function ``attack``."""
SHOWN = 20
"""Most bad outcomes that are printed for a section."""


def main(words: list[str]) -> int:
    """Make the attacks that were asked for; the exit code."""
    settings = dict(word.partition("=")[::2] for word in words)
    unknown = set(settings) - {*SECTIONS, "seed", "first", "out"}
    if unknown or not set(settings) & set(SECTIONS):
        asked = sorted(unknown) or "nothing was asked for"
        print(f"error: {asked}: write {'=N '.join(SECTIONS)}=N seed=0 first=0 out=FILE")
        return 2
    seed, first = int(settings.get("seed", 0)), int(settings.get("first", 0))
    found = {}
    for section in (name for name in SECTIONS if name in settings):
        attack: Attack = importlib.import_module(f"robustness_{section}").attack
        found[section] = _made(section, attack, range(first, first + int(settings[section])), seed)
    _print_table(found)
    if "out" in settings:
        rows = {name: [[o.result, o.what] for o in outcomes] for name, outcomes in found.items()}
        Path(settings["out"]).write_text(json.dumps({"seed": seed, "first": first, "outcomes": rows}, indent=1))
    return int(any(o.result in BAD for outcomes in found.values() for o in outcomes))


def _made(section: str, attack: Attack, numbers: range, seed: int) -> list[Outcome]:
    """Outcomes of a section's attacks."""
    outcomes, shown = [], time.monotonic()
    for number in numbers:
        with tempfile.TemporaryDirectory(prefix="attack_") as folder:
            outcomes.append(attack(number, seed, Path(folder)))
        last = outcomes[-1]
        if last.result in BAD and sum(o.result in BAD for o in outcomes) <= SHOWN:
            print(f"{section} {number}: {last.result}: {last.what}", flush=True)
        if time.monotonic() - shown > 15:
            shown = time.monotonic()
            print(f"{section}: {len(outcomes)} of {len(numbers)}", flush=True)
    return outcomes


def _print_table(found: dict[str, list[Outcome]]) -> None:
    """A row a section, a column an outcome."""
    print("".join(f"{name:>13}" for name in ("", "tried", *RESULTS)))
    for section, outcomes in found.items():
        counts = Counter(o.result for o in outcomes)
        print("".join(f"{cell:>13}" for cell in (section, len(outcomes), *(counts[r] for r in RESULTS))))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
