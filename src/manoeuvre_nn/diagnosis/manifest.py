"""The manifest of a case: what it may say, and a ship as it says it is."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from manoeuvre_nn.core.data_files import load_json, without_format
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.plain_text import check_name
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE

SIZES = {"length_m": "length", "beam_m": "beam", "draft_m": "draught"}
"""Dimensions that belong to the coefficients: they must be the ship's."""
SETTINGS = {
    "rudder_rate_deg_s": ("rudder_rate", DEGREE),
    "nominal_rpm": ("rpm", 1.0),
    "calm_water_resistance_kN": ("resistance", 1e3),
    "displacement_t": ("displacement", 1e3),
}
"""Particulars that take the place of the ship's own -> attribute and unit in SI."""
AREAS = {
    "frontal_m2": "frontal",
    "lateral_m2": "lateral",
    "lateral_centroid_fwd_of_midship_m": "lateral_centre",
    "length_overall_m": "length_overall",
}
HEEL = {"GM_m": "gm", "KG_m": "kg", "roll_period_s": "roll_period", "roll_damping_ratio": "roll_damping"}
SIGNED = frozenset({"lateral_centroid_fwd_of_midship_m"})
MAX_NUMBER = 1e9
"""No ship has a particular, in these units, as large as this."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the ``manifest.json`` of a folder and check all of it that is used.

    Returns:
        Its content.

    Raises:
        InputError: If it is missing, no JSON, or says something that cannot be used.
    """
    path = folder / "manifest.json"
    if not path.is_file():
        raise InputError(f"{path} does not exist: write a folder with a manifest.json and the csv files that it names")
    m = load_json(path)
    if not isinstance(m, dict):
        raise InputError(f"{path} holds a {type(m).__name__}; expected an object with ship, particulars and runs")
    m = without_format(m, str(path))
    try:
        numbers(m)
        for key in ("case", "ship"):
            if not isinstance(m.get(key, ""), str | int):
                raise InputError(f"{key} is {m[key]!r}; expected a name")
        _check_runs(m, folder)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return m


def numbers(m: Mapping[str, Any]) -> dict[str, float]:
    """All numbers of a manifest that are used.

    Returns:
        Name -> value; those that are not given are left out.

    Raises:
        InputError: If one is no number, or not positive.
    """
    wanted = {"particulars": [*SIZES, *SETTINGS, "approach_speed_m_s"], "wind_areas": [*AREAS], "stability": [*HEEL]}
    given = {"warmup_s": m["warmup_s"]} if "warmup_s" in m else {}
    for part, keys in wanted.items():
        content = m.get(part, {})
        if not isinstance(content, Mapping) or (content and not set(content) & {*keys}):
            raise InputError(f"{part} is {content!r}; expected an object of numbers such as {keys[0]}")
        given |= {key: content[key] for key in keys if key in content}
    for key, value in given.items():
        good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MAX_NUMBER
        if not good or (value <= 0 and key not in SIGNED):
            raise InputError(f"{key} is {value!r}; expected a number" + ("" if key in SIGNED else " more than 0"))
    return {key: float(value) for key, value in given.items()}


def _check_runs(m: Mapping[str, Any], folder: Path) -> None:
    """Refuse a list of runs that is none, or leads out of the folder."""
    if "runs" not in m:
        return
    entries = m["runs"]
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) for e in entries):
        raise InputError("runs is no list of runs; expected [{run: r01, file: r01.csv, split: fit}, ...]")
    for entry in entries:
        for key in ("run", "file", "split"):
            if not isinstance(entry.get(key), str):
                raise InputError(f"a run has {key} {entry.get(key)!r}; expected run, file and split, such as fit")
        if not isinstance(entry.get("campaign", ""), str):
            raise InputError(
                f"campaign of run {entry['run']} is {entry['campaign']!r}; expected a name, such as monday"
            )
        check_choice(f"split of run {entry['run']}", entry["split"], ["fit", "held_out"])
        if not isinstance(entry.get("rows", 0), int):
            raise InputError(f"rows of run {entry['run']} is {entry['rows']!r}; expected a whole number")
        if not isinstance(entry.get("manoeuvre") or "", str):
            raise InputError(f"manoeuvre of run {entry['run']} is {entry['manoeuvre']!r}; expected a name")
        for key in ("run", "file"):
            check_name(key, entry[key])
        if not (folder / entry["file"]).is_file():
            raise InputError(f"run {entry['run']} is in {entry['file']}, which is not in the folder")
    names = [entry["run"] for entry in entries]
    if len(set(names)) < len(names):
        raise InputError(f"runs stand twice: {', '.join(names)}")


def adapted(ship: Ship, manifest: Mapping[str, Any]) -> Ship:
    """A ship at the approach speed, with the areas, stability and engine of a manifest.

    Returns:
        A new ship; what the manifest does not say stays the ship's own.

    Raises:
        InputError: If the manifest is of a ship of another size or speed.
    """
    given, p = numbers(manifest), ship.particulars
    for key, name in SIZES.items():
        own = getattr(p, name)
        if key in given and abs(given[key] / own - 1) > 0.02:
            raise InputError(f"manifest.json: {key} is {given[key]:g}; that of the {p.name} is {own:g}: another ship?")
    changed: dict[str, Any] = {name: given[key] * unit for key, (name, unit) in SETTINGS.items() if key in given}
    areas, heel = ({name: given[key] for key, name in keys.items() if key in given} for keys in (AREAS, HEEL))
    if areas:
        changed["wind_areas"] = replace(p.above_water, **areas)
    if heel:
        changed["stability"] = replace(p.heeling, **heel)
    speed = given.get("approach_speed_m_s", p.speed)
    if speed > 2 * p.speed:
        raise InputError(
            f"approach speed {speed:.3g} m/s; the {p.name} was identified at {p.speed:.3g} m/s: write speed_kn, or "
            "approach_speed_m_s in manifest.json, below twice that"
        )
    made = ship.on_approach(speed)
    made.particulars = replace(made.particulars, **changed)
    return made
