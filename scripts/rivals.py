"""Two other ways to name what a calm-water model lacks, for comparison: they answer cases as diagnose.py does.

    python scripts/rivals.py method=regression cases=DIR out=DIR
    python scripts/rivals.py method=pysindy cases=DIR out=DIR
    python scripts/rivals.py method=regression calibrate=SEED [clean=24]

``regression`` fits every effect to the errors of the equations on a smoothed track and compares by an information
criterion; ``pysindy`` finds terms by sparse regression and names the effect that makes the same ones. ``calibrate``
draws clean cases and writes the least limits at which none of them alarms; the other commands read these (limits=FILE).
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

from manoeuvre_nn.commands.diagnose import ANSWER, case_folders  # noqa: E402
from manoeuvre_nn.core.errors import InputError, check_choice  # noqa: E402
from manoeuvre_nn.core.threads import use_threads  # noqa: E402
from manoeuvre_nn.diagnosis.answers import write_answer  # noqa: E402
from manoeuvre_nn.diagnosis.case import Case, read_case  # noqa: E402
from studies.concealed_trial.drawing import CasePlan, draw_case  # noqa: E402
from studies.concealed_trial.record import write_case  # noqa: E402
from studies.concealed_trial.rivals.result import METHODS, Limits, diagnosis, judge  # noqa: E402
from studies.concealed_trial.ships import trial_ships  # noqa: E402

DEFAULTS = {"method": "regression", "cases": "", "out": "", "calibrate": "", "clean": "24"}
DEFAULTS |= {"limits": str(ROOT / "studies" / "concealed_trial" / "rivals" / "limits.yaml")}


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
    if not given["calibrate"] and not (given["cases"] and given["out"]):
        raise InputError("cases= or out= is missing; write cases=DIR out=DIR, or calibrate=SEED")
    return given


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
        reached.append([round(float(x), 2) for x in astuple(judge(case, method).evidence)])
        print(f"{case.name}  {case.ship:18} gain {reached[-1][0]:7.2f}  misfit {reached[-1][1]:5.2f}", flush=True)
    gain, misfit = np.max(reached, axis=0).tolist()
    row = {"gain": gain, "misfit": misfit, "seed": seed, "clean": count, "reached": reached}
    known = (yaml.safe_load(path.read_text()) if path.is_file() else None) or {}
    path.write_text(yaml.safe_dump(known | {method: row}, sort_keys=False, default_flow_style=None, width=110))


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
            said = diagnosis(case, judge(case, method), limits)
        except (InputError, ArithmeticError, ValueError) as error:
            failed += 1
            print(f"{folder.name}: failed: {error}", file=sys.stderr, flush=True)
            continue
        write_answer(said, place)
        told = "  ".join(f"{c.name} {c.probability:.2f}" for c in said.causes[:3])
        print(f"{folder.name}  {said.verdict:8}  {told}", flush=True)
    return failed


def main(arguments: list[str]) -> int:
    """Answer or calibrate.

    Args:
        arguments: ``key=value``.

    Returns:
        Exit code.
    """
    use_threads(1)
    given = settings(arguments)
    if given["calibrate"]:
        calibrate(given)
        return 0
    return 1 if answer(given) else 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
