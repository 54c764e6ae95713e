"""The prediction of someone who knows what was concealed: true effects, nominal coefficients, recorded rudder."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial import unmodelled
from studies.concealed_trial.effects import FAMILY, UNKNOWN
from studies.concealed_trial.motion import COARSE, replay
from studies.concealed_trial.ships import TrialShip, trial_ships
from studies.concealed_trial.start import CHANNELS, NOISE_OF, rudder, shown_by_recorder, smoothed_start
from studies.concealed_trial.truth import ConcealedEffect, build


def read_manifest(case_dir: Path) -> dict[str, Any]:
    """Manifest of a case.

    Args:
        case_dir: Folder of the case.

    Returns:
        Its fields.

    Raises:
        InputError: If there is none or its ship is unknown.
    """
    path = case_dir / "manifest.json"
    if not path.is_file():
        raise InputError(f"{case_dir} holds no manifest.json; give the folder of one case")
    manifest: dict[str, Any] = json.loads(path.read_text())
    if manifest["ship"] not in trial_ships():
        raise InputError(f"{path}: ship {manifest['ship']!r} is unknown; choose one of: {', '.join(trial_ships())}")
    return manifest


def read_run(case_dir: Path, run: Mapping[str, Any], noise: Mapping[str, float]) -> pd.DataFrame:
    """Recording of a run with outliers taken out and headings unwrapped.

    Args:
        case_dir: Folder of the case.
        run: Its entry in the manifest.
        noise: Nominal standard deviations of the manifest.

    Returns:
        The table at whole seconds from 0 to the end; what is missing or an outlier is NaN.
    """
    table = pd.read_csv(case_dir / str(run["file"]))
    table = table.reindex(columns=["t", *table.columns.drop("t"), *(c for c in CHANNELS if c not in table)])
    table.index = table["t"].round().astype(int)
    table = table.reindex(range(int(table.index[-1]) + 1)).assign(t=lambda full: full.index.astype(float))
    known = table["psi"].notna()
    table.loc[known, "psi"] = np.degrees(np.unwrap(np.radians(table.loc[known, "psi"])))
    table = table.reset_index(drop=True)
    for channel, name in NOISE_OF.items():
        middle = table[channel].rolling(7, center=True, min_periods=3).median()
        table.loc[(table[channel] - middle).abs() > 8 * noise[name] + 0.01, channel] = np.nan
    return table


def effects_of(truth: Mapping[str, Any]) -> list[ConcealedEffect] | None:
    """The effects of an opened answer as the simulator takes them.

    Args:
        truth: An ``answers.json``.

    Returns:
        The effects, or None if one of them is not known here. Random forces are left out as gusts are: whoever knows
        what acts does not know their course.
    """
    found = []
    for entry in truth["effects"]:
        name, detail, parameters = entry["name"], entry.get("detail"), entry["parameters"]
        own = {**unmodelled.FORCES, **dict.fromkeys(unmodelled.RUDDERS), **unmodelled.SENSORS}
        if name not in FAMILY or (name == UNKNOWN and detail not in own):
            return None
        if detail not in unmodelled.RANDOM:
            strength, ramp = entry.get("strength") or "moderate", entry.get("ramp_s") or 0.0
            found.append(ConcealedEffect(name, parameters, entry["intervals"], detail, strength, ramp))
    return found


def predictions(case_dir: Path, effects: Sequence[ConcealedEffect]) -> dict[str, pd.DataFrame]:
    """Roll-outs of the held-out runs with these effects, from the warm-up to the end.

    Args:
        case_dir: Folder of the case.
        effects: What acts; none for the calm-water model.

    Returns:
        Table of each held-out run with the columns of a prediction, one row a second.
    """
    manifest = read_manifest(case_dir)
    ship, warmup = trial_ships()[manifest["ship"]], int(manifest["warmup_s"])
    runs = [run for run in manifest["runs"] if run["split"] == "held_out"]
    tables = [read_run(case_dir, run, manifest["nominal_noise_sd"]) for run in runs]
    truth = build(ship, effects, [run["run"] for run in runs])
    start = smoothed_start(ship, effects, [run["run"] for run in runs], tables, warmup)
    longest = max(len(table) for table in tables)
    t = np.arange(float(warmup), float(longest))
    order, shown = rudder(truth, tables, warmup, longest)
    with np.errstate(all="ignore"):
        states = replay(truth, start, t, order, shown, step=COARSE)
    result = {}
    for k, (run, table) in enumerate(zip(runs, tables, strict=True)):
        rows = len(table) - warmup
        result[run["run"]] = shown_by_recorder(truth, t[:rows], states[:rows, :6, k])
    return result


def scales(ship: TrialShip) -> dict[str, float]:
    """Scales of the errors in J.

    Args:
        ship: The ship.

    Returns:
        Scale of each channel.
    """
    return {"pos": 0.02 * ship.length, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}


def rmse(case_dir: Path, tables: Mapping[str, pd.DataFrame]) -> dict[str, float] | None:
    """Errors of predictions against the recordings.

    Args:
        case_dir: Folder of the case.
        tables: Prediction of each held-out run.

    Returns:
        RMS error of each channel that is recorded, per run and then over runs; infinite where a prediction is not a
        number. None if a prediction is missing or does not cover its run.
    """
    manifest = read_manifest(case_dir)
    warmup, per_run = manifest["warmup_s"], []
    for run in manifest["runs"]:
        if run["split"] != "held_out":
            continue
        recorded = read_run(case_dir, run, manifest["nominal_noise_sd"])
        recorded = recorded[(recorded["t"] >= warmup) & recorded[[*CHANNELS]].notna().any(axis=1)]
        predicted = tables.get(run["run"])
        needed = {CHANNELS[c] for c in CHANNELS if recorded[c].notna().any()} | {"t"}
        if predicted is None or needed - set(predicted):
            return None
        predicted = predicted.assign(t=predicted["t"].round(2)).drop_duplicates("t").set_index("t")
        predicted = predicted.reindex(columns=[*CHANNELS.values()])
        if not recorded["t"].isin(predicted.index).all():
            return None
        per_run.append(_errors(recorded, predicted.loc[recorded["t"]]))
    channels = [c for c in per_run[0] if all(c in errors for errors in per_run)] if per_run else []
    return {c: float(np.sqrt(np.mean([e[c] for e in per_run]))) for c in channels} or None


def _errors(recorded: pd.DataFrame, predicted: pd.DataFrame) -> dict[str, float]:
    """Mean square error of each channel over the samples that were recorded, if any."""
    miss = {c: predicted[p].to_numpy(float) - recorded[c].to_numpy(float) for c, p in CHANNELS.items()}
    miss["psi"] = (miss["psi"] + 180.0) % 360.0 - 180.0
    squares = {c: miss[c] ** 2 for c in ("psi", "u", "v", "r", "u_log")}
    squares = {"pos": miss["x_north"] ** 2 + miss["y_east"] ** 2} | squares
    needed = {"pos": ["x_north", "y_east"]}
    result = {}
    for channel, square in squares.items():
        known = recorded[needed.get(channel, [channel])].notna().all(axis=1).to_numpy()
        if not known.any():
            continue
        mean = float(square[known].mean())
        result[channel] = mean if np.isfinite(mean) else float("inf")
    return result


def total(ship: TrialShip, errors: Mapping[str, float]) -> float:
    """J: root of the mean square of the errors over their scales.

    Args:
        ship: The ship.
        errors: RMS error of each channel that is recorded.

    Returns:
        J [-].
    """
    scale = scales(ship)
    return float(np.sqrt(np.mean([(error / scale[c]) ** 2 for c, error in errors.items()])))
