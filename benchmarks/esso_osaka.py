"""Esso Osaka, free-running, wind recorded: methods on the same held-out runs, in closed loop with the recorded rudder.

    RECORDINGS=FOLDER python benchmarks/esso_osaka.py [methods=closed_loop,mmg,regression,lstm,narx] [wind=on,off]
        [out=FOLDER] [groups=zigzag,turning] [quick=true]

Turning circles are predicted by a model trained on all 7 zigzags and 8 random runs, each zigzag by one trained on the
other 6 zigzags and the 8 random runs. Of the run that is predicted a model is given the smoothed state at the first
sample (at rest, mostly: the runs gather way before the rudder is put over), the rudder, the shaft speed and, with the
wind on, the true wind. Scores are against the channels as recorded: RMSE over their standard deviation for u, v, r;
dev/L is the largest distance between the two tracks over L = 3 m; over the whole run, and over its first 120 s.
``quick=true`` takes two runs of each group and short trainings. Writes runs.csv and table.md into ``out``.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pandas as pd
import torch
from esso_osaka_closed_loop import ClosedLoopSeries
from esso_osaka_data import Method, Predictor, read_group
from esso_osaka_mmg import PublishedMMG
from esso_osaka_networks import LONG, LONGER, SHORT, PlainNetwork
from esso_osaka_regression import TaylorRegression

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_model

FIRST = 120.0
"""Length of the first part that is scored beside the whole [s]."""
METHODS: dict[str, Callable[[bool], Method]] = {
    "closed_loop": lambda quick: ClosedLoopSeries(),
    "mmg": lambda quick: PublishedMMG(),
    "regression": lambda quick: TaylorRegression(),
    "lstm": lambda quick: PlainNetwork("lstm", stages=SHORT if quick else LONG),
    "narx": lambda quick: PlainNetwork("narx", stages=SHORT if quick else LONGER),
}
"""Name -> the method; told whether the run is a quick one."""
COLUMNS = ("u", "v", "r", "dev_L", "u_120", "v_120", "r_120", "dev_L_120")
"""What a run is scored by."""


def folds(groups: Sequence[str], quick: bool) -> Iterator[tuple[list[Recording], list[Recording]]]:
    """Runs to train on and runs to predict.

    Args:
        groups: Which runs are predicted.
        quick: Two runs of each group only.

    Yields:
        Training runs, held-out runs.
    """
    zigzags, random, turns = (read_group(g) for g in ("zigzag", "random", "turning"))
    last = 2 if quick else None
    if "turning" in groups:
        yield zigzags + random, turns[:last]
    if "zigzag" in groups:
        for held in zigzags[:last]:
            yield [z for z in zigzags if z is not held] + random, [held]


def judged(predictor: Predictor, run: Recording) -> dict[str, float | str]:
    """Scores of one prediction.

    Args:
        predictor: A fitted method.
        run: The run.

    Returns:
        Column -> score; ``status`` says whether the prediction broke down.
    """
    length = esso_osaka_model().length
    made = predictor.predict(run)
    whole = score(made, run, length)
    early = run.between(run.time[0], run.time[0] + FIRST)
    ahead = made.between(made.time[0], made.time[0] + FIRST)
    first = score(ahead, early, length)
    values = {k: whole.nrmse[k] for k in ("u", "v", "r")} | {"dev_L": whole.dev_L}
    values |= {f"{k}_120": first.nrmse[k] for k in ("u", "v", "r")} | {"dev_L_120": first.dev_L}
    return {**values, "status": made.status}


def contest(name: str, wind: bool, groups: Sequence[str], quick: bool) -> list[dict[str, object]]:
    """All folds of one method.

    Args:
        name: The method's.
        wind: Whether it may use the wind.
        groups: Which runs are predicted.
        quick: Two runs of each group and short trainings.

    Returns:
        One row a run.
    """
    rows: list[dict[str, object]] = []
    for training, held in folds(groups, quick):
        began = time.process_time()
        predictor = METHODS[name](quick).fit(training, esso_osaka_model(), wind)
        seconds = time.process_time() - began
        for run in held:
            row = {"method": name, "wind": "on" if wind else "off", "group": run.meta["group"], "run": run.name}
            rows.append({**row, **judged(predictor, run), "fit_s": round(seconds, 1)})
            shown = "  ".join(f"{k} {rows[-1][k]:.2f}" for k in COLUMNS)
            print(f"{name:10s} wind {row['wind']:3s} {run.name:32s} {shown}  {rows[-1]['status']}", flush=True)
    return rows


def medians(table: pd.DataFrame) -> pd.DataFrame:
    """Medians by method, wind and group.

    Args:
        table: One row a run.

    Returns:
        The medians, how many runs broke down, and the largest time of a fit [s].
    """
    keys = ["group", "method", "wind"]
    found = table.groupby(keys, sort=False)[list(COLUMNS)].median()
    found["broke down"] = table.groupby(keys, sort=False)["status"].apply(lambda s: int((s != "ok").sum()))
    found["fit_s"] = table.groupby(keys, sort=False)["fit_s"].max()
    return found.sort_index(level="group", sort_remaining=False).reset_index()


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown.

    Args:
        table: Any.

    Returns:
        Its lines.
    """
    lines = [f"| {' | '.join(table.columns)} |", "|---" * len(table.columns) + "|"]
    for row in table.itertuples(index=False):
        cells = [f"{c:.3f}" if isinstance(c, float) else str(c) for c in row]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def chosen(arguments: Sequence[str]) -> dict[str, str]:
    """Settings from the command line.

    Args:
        arguments: ``key=value``.

    Returns:
        Key -> value.

    Raises:
        InputError: If a word is no setting.
    """
    settings = {"methods": ",".join(METHODS), "wind": "on,off", "groups": "zigzag,turning", "quick": "false", "out": ""}
    for word in arguments:
        key, sep, value = word.partition("=")
        if not sep or key not in settings:
            raise InputError(f"{word!r} is no setting; write one of: {', '.join(f'{k}=...' for k in settings)}")
        settings[key] = value
    for key, known in {"methods": list(METHODS), "wind": ["on", "off"], "groups": ["zigzag", "turning"]}.items():
        for value in settings[key].split(","):
            check_choice(key, value, known)
    check_choice("quick", settings["quick"], ["true", "false"])
    return settings


def main(arguments: Sequence[str]) -> None:
    """Run the contest and write its tables.

    Args:
        arguments: See the module.
    """
    torch.set_num_threads(1)
    settings = chosen(arguments)
    groups, quick = settings["groups"].split(","), settings["quick"] == "true"
    rows = []
    for name in settings["methods"].split(","):
        for wind in settings["wind"].split(","):
            rows += contest(name, wind == "on", groups, quick)
    table = pd.DataFrame(rows)
    summary = medians(table)
    print("\n" + markdown(summary))
    if settings["out"]:
        out = Path(settings["out"])
        out.mkdir(parents=True, exist_ok=True)
        table.to_csv(out / "runs.csv", index=False, float_format="%.4f")
        (out / "table.md").write_text(markdown(summary) + "\n" + markdown(table))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(f"esso_osaka.py: {error}")
