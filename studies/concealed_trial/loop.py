"""Design in the loop: the run that an answer advises is sailed under the same truth, and beside it a random one.

A case takes part if it holds an effect, its first name was wrong or less than 90 % sure, and the answer advises a run.
Both new runs have the case's coefficients and effects, with other noise, gusts and coloured force; the tool diagnoses
the case again with each. What is compared is how often the first name is then right.
"""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import draft_of, write_file
from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.channels import published
from studies.concealed_trial.drawing import Trial, case_name
from studies.concealed_trial.effects import kind_of
from studies.concealed_trial.events import draw_intervals
from studies.concealed_trial.helm import Run
from studies.concealed_trial.record import UNITS, manifest, record
from studies.concealed_trial.score import score_case
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.stages import Progress, drawn
from studies.concealed_trial.summaries import Rows, rate

SURE = 0.9
"""A case whose first name is right and this probable is resolved."""
STREAM = 9
"""Of the random numbers of new runs."""
WAYS = ("advised", "random")
COLUMNS = {"speed log": ("u_log",), "rate of turn": ("r",), "shaft speed": ("n",)}
"""What an answer may ask to be written down too -> columns."""


def unresolved(row: Mapping[str, Any]) -> bool:
    """Whether a case takes part as far as its score tells.

    Args:
        row: Its scores.

    Returns:
        True if an effect was there, and was not named or not surely.
    """
    first = row["probabilities"].get(row["first"], (0.0, 0))[0]
    return bool(row["truth"]) and not (row["first_right"] and first >= SURE)


def advised_run(plan: Mapping[str, Any], case: TrialCase, rng: np.random.Generator) -> Run | None:
    """The run that an answer advises.

    Args:
        plan: ``next_run`` of the answer.
        case: The case.
        rng: Source of chance for what the plan leaves open.

    Returns:
        The run, or None if it cannot be sailed here.
    """
    name = f"r{len(case.runs) + 1:02d}"
    if "repeat" in plan:
        same = next((run for run in case.runs if run.name == plan["repeat"]), None)
        return None if same is None else replace(same, name=name, split="fit")
    manoeuvre = str(plan.get("manoeuvre", ""))
    kind, angle = manoeuvre[:2], manoeuvre[2:]
    if not (manoeuvre == "straight" or (kind in {"zz", "tc", "po"} and angle.isdecimal())):
        return None
    heading = plan.get("heading_deg", case.runs[0].heading_deg)
    share, side = float(plan.get("speed_share", 1.0)), str(plan.get("first_turn", rng.choice(["port", "starboard"])))
    return Run(name, "fit", manoeuvre, side, float(heading), _duration(case.ship, manoeuvre, share), share)


def _duration(ship: TrialShip, manoeuvre: str, share: float) -> int:
    """How long a manoeuvre is recorded: as those of its family."""
    known = [
        s for name, s in ship.manoeuvres_s.items() if name[:2] == (manoeuvre[:2] if "o" not in manoeuvre else "tc")
    ]
    return int(ship.manoeuvres_s.get(manoeuvre, max(known or ship.manoeuvres_s.values())) / share)


def random_run(case: TrialCase, rng: np.random.Generator) -> Run:
    """A run as anybody might sail it.

    Args:
        case: The case.
        rng: Source of chance.

    Returns:
        A turn or a zigzag of the ship, to either side, on any heading.
    """
    manoeuvre = str(rng.choice([name for name in case.ship.manoeuvres_s if name != "spiral"]))
    side, heading = str(rng.choice(["port", "starboard"])), float(rng.integers(1, 361))
    return Run(f"r{len(case.runs) + 1:02d}", "fit", manoeuvre, side, heading, case.ship.manoeuvres_s[manoeuvre])


def write_extended(
    case: TrialCase, run: Run, recordings: Path, out: Path, rng: np.random.Generator, more: tuple[str, ...] = ()
) -> None:
    """Recordings of a case and one run more; the manifest last.

    Args:
        case: The case.
        run: The new run.
        recordings: The case's recordings.
        out: The new case's folder.
        rng: Source of chance of all that differs from run to run.
        more: Columns that the new run has beside those of the others.
    """
    effects = []
    for effect in case.effects:
        confined = kind_of(effect.name, effect.detail).confined
        where, ramp = draw_intervals(rng, confined, (run,))
        effects.append(replace(effect, intervals=where, ramp=ramp) if confined else effect)
    later = replace(case, runs=(run,), effects=tuple(effects), hole=None)
    table = record(later, fresh=rng)[run.name]
    shutil.copytree(recordings, out, dirs_exist_ok=True, ignore=shutil.ignore_patterns("manifest.json"))
    with draft_of(out / f"{run.name}.csv") as draft:
        published(later, run, table, more).to_csv(draft, index=False)
    described = json.loads((recordings / "manifest.json").read_text())
    described["runs"] += manifest(later)["runs"]
    described["channels"] |= {column: UNITS[column] for column in more}
    write_file(out / "manifest.json", json.dumps(described, indent=1))


def sail_next(trial: Trial, out: Path, answers: Path) -> None:
    """Sail both new runs of every case that takes part.

    Args:
        trial: The trial.
        out: Its folder, with a scoreboard; takes ``loop/WAY/recordings``.
        answers: The tool's answers.
    """
    rows = _scored(out)
    progress = Progress("cases looked at for another run", trial.cases)
    for way in WAYS:
        (out / "loop" / way / "recordings").mkdir(parents=True, exist_ok=True)
    for index in range(trial.cases):
        name = case_name(trial.seed, index)
        path = answers / name / "answer.json"
        if unresolved(rows[name]) and path.is_file():
            prepare(drawn(trial, index), json.loads(path.read_text()), out, [trial.seed, index])
        progress.step()


def compare(trial: Trial, out: Path) -> str:
    """Score the answers with one run more beside those without.

    Args:
        trial: The trial.
        out: Its folder, with ``loop/WAY/answers``; takes loop.md and loop.json.

    Returns:
        The comparison as Markdown.
    """
    rows, after = _scored(out), {way: list[Mapping[str, Any]]() for way in WAYS}
    before = []
    for index in range(trial.cases):
        name = case_name(trial.seed, index)
        folders = {way: out / "loop" / way for way in WAYS}
        if not all((folder / "answers" / name / "answer.json").is_file() for folder in folders.values()):
            continue
        before.append(rows[name])
        truth = drawn(trial, index).answers()
        for way, folder in folders.items():
            after[way].append(score_case(folder / "recordings" / name, folder / "answers" / name, truth))
    text = loop_table(before, after)
    write_file(out / "loop.md", text)
    write_file(out / "loop.json", json.dumps({"before": before, **after}, indent=1))
    return text


def _scored(out: Path) -> dict[str, Any]:
    """Scores of the package's own answers, by case."""
    path = out / "scoreboard.json"
    if not path.is_file():
        raise InputError(f"{path} does not exist: score the trial first")
    tools = json.loads(path.read_text())["tools"]
    return {row["case"]: row for row in next(iter(tools.values()))["cases"]}


def prepare(case: TrialCase, answer: Mapping[str, Any], folder: Path, seed: list[int]) -> bool:
    """Write both new cases if the answer advises a run.

    Args:
        case: The case.
        answer: The tool's answer.
        folder: Folder of the trial; takes ``loop/WAY/recordings``.
        seed: Seed of the new runs.

    Returns:
        Whether it does.
    """
    plan, rng = answer.get("next_run"), np.random.default_rng([*seed, STREAM])
    run = advised_run(plan, case, rng) if plan else None
    if run is None:
        return False
    more = {"advised": COLUMNS.get(str((plan or {}).get("channel")), ())}
    for way, sailed in zip(WAYS, (run, random_run(case, rng)), strict=True):
        out = folder / "loop" / way / "recordings" / case.name
        if not (out / "manifest.json").is_file():
            write_extended(case, sailed, folder / "recordings" / case.name, out, rng, more.get(way, ()))
    return True


def loop_table(before: Rows, after: Mapping[str, Rows]) -> str:
    """What the new runs resolved, as Markdown.

    Args:
        before: Scores of the cases that took part.
        after: Scores with each new run.

    Returns:
        A table: first name right, and right and sure, with Wilson intervals.
    """
    lines = ["# Design in the loop", "", "| runs | first name right | resolved |", "| --- | --- | --- |"]
    for name, rows in {"as recorded": before, **{f"with one {way} run more": after[way] for way in after}}.items():
        cells = [_share(rate(row["first_right"] for row in rows)), _share(rate(not unresolved(row) for row in rows))]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _share(share: Mapping[str, Any] | None) -> str:
    """A share with its interval."""
    if share is None:
        return "-"
    return f"{share['share']:.0%} [{share['low']:.0%}, {share['high']:.0%}] {share['right']}/{share['count']}"
