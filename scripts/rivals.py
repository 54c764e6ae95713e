"""Other ways to name what a calm-water model lacks, for comparison: they answer cases as diagnose.py does.

    python scripts/rivals.py method=regression cases=DIR out=DIR
    python scripts/rivals.py method=structural calibrate=SEED [clean=24]
    python scripts/rivals.py method=neural train=10000 seed=SEED [model=FILE]

Methods are ``regression``, ``pysindy``, ``sample_split``, ``structural`` and ``neural``, which learns from cases of our
own shelf, or as ``neural_referee`` from those of the referee (studies/concealed_trial/README.md says what each does).
``calibrate`` draws clean cases and writes the least limits at which none of them alarms; the commands that answer read
these (limits=FILE). ``train`` makes examples beside the model's file as far as they are missing, says how accuracy
grows with their number, and writes the model.
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # studies stand beside the package, not in it

from manoeuvre_nn.core.ending import listen  # noqa: E402

if __name__ == "__main__":
    listen()  # imports take seconds

from manoeuvre_nn.commands.diagnose import ANSWER, case_folders  # noqa: E402
from manoeuvre_nn.commands.guard import one_line  # noqa: E402
from manoeuvre_nn.core.errors import InputError, check_choice  # noqa: E402
from manoeuvre_nn.core.threads import use_threads  # noqa: E402
from manoeuvre_nn.core.writing import write_file  # noqa: E402
from manoeuvre_nn.diagnosis.answers import write_answer  # noqa: E402
from manoeuvre_nn.diagnosis.case import Case, read_case  # noqa: E402
from studies.concealed_trial.drawing import CasePlan, draw_case  # noqa: E402
from studies.concealed_trial.record import write_case  # noqa: E402
from studies.concealed_trial.rivals.examples import Examples, examples  # noqa: E402
from studies.concealed_trial.rivals.methods import LEARNT, METHODS, judge  # noqa: E402
from studies.concealed_trial.rivals.neural import accuracy, learn, save  # noqa: E402
from studies.concealed_trial.rivals.result import Limits, diagnosis  # noqa: E402
from studies.concealed_trial.ships import trial_ships  # noqa: E402

DEFAULTS = {"method": "regression", "cases": "", "out": "", "calibrate": "", "clean": "24"}
DEFAULTS |= {"train": "", "seed": "", "model": ""}
DEFAULTS |= {"limits": str(ROOT / "studies" / "concealed_trial" / "rivals" / "limits.yaml")}
MODELS = ROOT / "outputs" / "rivals"
"""Where what was learnt lies."""
TESTED = 0.15
"""Share of the examples that accuracy is told on."""


def settings(arguments: list[str]) -> dict[str, str]:
    """Settings from the command line.

    Args:
        arguments: ``key=value``.

    Returns:
        All settings as text.

    Raises:
        InputError: If an argument is not understood, or one is missing.
    """
    given = dict(DEFAULTS)
    for argument in arguments:
        key, sign, value = argument.partition("=")
        if not sign or key not in DEFAULTS:
            raise InputError(f"{argument!r} is not understood; write {' '.join(f'{k}=...' for k in DEFAULTS)}")
        given[key] = value
    check_choice("method", given["method"], METHODS)
    if given["calibrate"] and not (given["calibrate"].isdecimal() and given["clean"].isdecimal()):
        raise InputError(f"calibrate={given['calibrate']} clean={given['clean']}: write whole numbers")
    if given["train"] and not (given["train"].isdecimal() and given["seed"].isdecimal() and given["method"] in LEARNT):
        raise InputError(f"train={given['train']}: write whole numbers train= and seed=, and method={LEARNT[0]}")
    if not (given["calibrate"] or given["train"]) and not (given["cases"] and given["out"]):
        raise InputError("cases= or out= is missing; write cases=DIR out=DIR, or calibrate=SEED")
    given["model"] = given["model"] or str(MODELS / f"{given['method']}.pt")
    return given


def train(given: dict[str, str]) -> None:
    """Make examples, say how accuracy grows with their number on some that are held out, and learn from all others.

    Args:
        given: The settings.
    """
    path, count, world = (
        Path(given["model"]),
        int(given["train"]),
        "shelf" if given["method"] == "neural" else "referee",
    )
    made: Examples = examples(world, count, int(given["seed"]), path.with_suffix(".npz"))
    last = int(count * (1 - TESTED))
    test = made.some(slice(last, None))
    for part in (8, 4, 2):
        told = accuracy(learn(made.some(slice(0, last // part)), with_posteriors=False), test)
        print(last // part, *(f"{what} {share:.2f}" for what, share in told.items()), sep="  ", flush=True)
    learnt = learn(made.some(slice(0, last)))
    print(last, *(f"{what} {share:.2f}" for what, share in accuracy(learnt, test).items()), sep="  ", flush=True)
    save(learnt, path)


def clean_cases(seed: int, count: int) -> Iterator[Case]:
    """Cases of all ships with nothing but what is wrong with the model in every case.

    Args:
        seed: Seed; never that of a trial.
        count: How many.

    Yields:
        The cases.
    """
    ships = list(trial_ships())
    for k in range(count):
        case = draw_case(seed, k, CasePlan(ships[k % len(ships)], (), ()))
        with tempfile.TemporaryDirectory() as place:
            write_case(case, Path(place))
            yield read_case(Path(place))


def calibrate(given: dict[str, str]) -> None:
    """Write the least limits at which no clean case alarms, beside what was measured.

    Args:
        given: The settings.
    """
    method, path, seed, count = given["method"], Path(given["limits"]), int(given["calibrate"]), int(given["clean"])
    reached = []
    for case in clean_cases(seed, count):
        evidence = astuple(judge(case, method, model=Path(given["model"])).evidence)
        # Upwards: many clean cases have the very same evidence, that of no term found, and must not alarm by rounding.
        reached.append([float(np.ceil(100 * x) / 100) for x in evidence])
        print(f"{case.name}  {case.ship:18} gain {reached[-1][0]:7.2f}  misfit {reached[-1][1]:5.2f}", flush=True)
    gain, misfit = np.max(reached, axis=0).tolist()
    row = {"gain": gain, "misfit": misfit, "seed": seed, "clean": count, "reached": reached}
    known = (yaml.safe_load(path.read_text()) if path.is_file() else None) or {}
    write_file(path, yaml.safe_dump(known | {method: row}, sort_keys=False, default_flow_style=None, width=110))


def answer(given: dict[str, str]) -> int:
    """Answer the cases that have no answer yet; a broken one does not stop the others.

    Args:
        given: The settings.

    Returns:
        How many failed.

    Raises:
        InputError: If there are no limits.
    """
    method, path, failed = given["method"], Path(given["limits"]), 0
    known = (yaml.safe_load(path.read_text()) if path.is_file() else None) or {}
    if method not in known:
        raise InputError(f"limits={path} has none for {method}: write method={method} calibrate=SEED first")
    limits = Limits(known[method]["gain"], known[method]["misfit"])
    for folder in case_folders(Path(given["cases"])):
        place = Path(given["out"]) / folder.name
        if (place / ANSWER).is_file():
            continue
        try:
            case = read_case(folder)
            said = diagnosis(case, judge(case, method, model=Path(given["model"])), limits)
        except (InputError, ArithmeticError, ValueError) as error:
            failed += 1
            print(f"{folder.name}: failed: {error}", file=sys.stderr, flush=True)
            continue
        write_answer(said, place)
        told = "  ".join(f"{c.name} {c.probability:.2f}" for c in said.causes[:3])
        print(f"{folder.name}  {said.verdict:8}  {told}", flush=True)
    return failed


def main(arguments: list[str]) -> int:
    """Answer, calibrate or train.

    Args:
        arguments: ``key=value``.

    Returns:
        Exit code.
    """
    use_threads(1)
    given = settings(arguments)
    if given["calibrate"] or given["train"]:
        (calibrate if given["calibrate"] else train)(given)
        return 0
    return 1 if answer(given) else 0


if __name__ == "__main__":
    with one_line():
        sys.exit(main(sys.argv[1:]))
