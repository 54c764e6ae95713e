"""Files of settings in which one value is another, or which try to run something."""

import json
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from robustness_oracle import UNITS, Tried, is_number, meaning, sailed
from robustness_recordings import form, reads
from robustness_traps import trap

import manoeuvre_nn as mnn
from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.response import read_records_mapping
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.response import Variable
from manoeuvre_nn.diagnosis.case import read_case
from manoeuvre_nn.recording.read.records import read_records
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected

ODD: tuple[Any, ...] = (
    None, True, False, "", "x", -1, 0, 1, 0.5, 3, 1e300, -1e300, float("nan"), float("inf"), 10**30, [], {}, [1, 2],
    ["a"], {"a": 1}, "\x85", "1e3", "${oc.env:HOME}", "a" * 300, "../up", "/etc/passwd", 1e9, 1e-300, "\u202eab", -0.0,
)  # fmt: skip
LIMIT = 35.0
"""Where the rudder of the bulker stops [deg]."""


def mapping(rng: np.random.Generator, folder: Path) -> Tried:
    """A mapping in which an entry of a channel is another."""
    made = form(rng, plain=True)
    said = json.loads(json.dumps(made.said))
    made.table.to_csv(folder / "run.csv", index=False)
    channel = str(rng.choice(["time", *said["channels"]]))
    entry = said["time"] if channel == "time" else said["channels"][channel]
    key = str(rng.choice(["column", "unit", "sign", "offset", "scale", "delay", "colour"]))
    units = sorted({u for known in UNITS.values() for u in known})
    value = str(rng.choice(units)) if key == "unit" and rng.random() < 0.5 else _odd(rng)
    if rng.random() < 0.15:
        entry.pop("column")
    entry[key] = value
    expected = _wrong_entry(channel, entry, said, list(made.table)) or meaning(
        _cells(made.table), said, made.particulars
    )
    _write(folder / "mapping.yaml", said)
    must = "refuse" if isinstance(expected, str) else "either"
    work = partial(reads, folder / "run.csv", said, made.ship, expected)
    return Tried(f"{channel}.{key} = {value!r}", work, must, ("mapping", "run.csv"))


def _cells(table: pd.DataFrame) -> dict[str, list[Any]]:
    return {k: list(v) for k, v in table.items()}


def _wrong_entry(channel: str, entry: dict[str, Any], said: dict[str, Any], headings: list[str]) -> str:
    """Why an entry makes no sense; nothing if it does."""
    others = [e["column"] for k, e in {"time": said["time"], **said["channels"]}.items() if k != channel]
    if set(entry) - {"column", "unit", "sign", "offset", "scale", "delay"} or not {"column", "unit"} <= set(entry):
        return "its keys are others"
    if channel == "time" and set(entry) - {"column", "unit", "scale"}:
        return "time has no such key"
    if not isinstance(entry["column"], str) or entry["column"] not in headings:
        return "there is no such column"
    if entry["column"] in others:
        return "the column is that of another channel"
    if not isinstance(entry["unit"], str) or entry["unit"] not in UNITS[channel]:
        return "the unit measures something else"
    if not is_number(entry.get("sign", 1)) or abs(entry.get("sign", 1)) != 1:
        return "it is no sign"
    numbers = [entry.get("offset", 0), entry.get("scale", 1), entry.get("delay", 0)]
    if not all(map(is_number, numbers)) or not numbers[1] > 0:
        return "it is no number"
    return "it is no delay of a ship's sensor" if abs(numbers[2]) > 1e4 else ""


SETTINGS: dict[str, Callable[[Any], bool]] = {
    "frame": lambda v: v in ("body", "earth"),
    "rudder_positive_to": lambda v: v in ("starboard", "port"),
    "rudder": lambda v: v in ("angle", "order"),
    "decimal": lambda v: v in ("point", "comma"),
    "outliers": lambda v: v in ("keep", "fill"),
    "drift": lambda v: v in ("keep", "arcs"),
    "place": lambda v: v in ("open_water", "tank"),
    "kind": lambda v: v is None,
    "time_zone": lambda v: v is None,
    "reference_point": is_number,
    "position_point": lambda v: v is None or is_number(v),
    "start": lambda v: v is None or (is_number(v) and v >= 0),
    "end": lambda v: v is None or (is_number(v) and v > 0),
    "skip_rows": lambda v: type(v) is int and v >= 0,
    "header": lambda v: isinstance(v, bool),
    "optional": lambda v: isinstance(v, bool),
    "fill_gaps": lambda v: isinstance(v, bool) or (is_number(v) and v > 0),
    "format": lambda v: type(v) is int and v == 1,
    "colour": lambda v: False,
    "channels": lambda v: False,
    "time": lambda v: False,
    "_target_": lambda v: False,
}
"""Setting of a mapping -> which values it may have; others must be refused."""


def setting(rng: np.random.Generator, folder: Path) -> Tried:
    """A mapping with a setting that makes no sense."""
    made = form(rng, plain=True)
    made.table.to_csv(folder / "run.csv", index=False)
    key = str(rng.choice(list(SETTINGS)))
    value = next(v for v in iter(partial(_odd, rng), object()) if not _may(SETTINGS[key], v))
    said = {**made.said, key: value}
    _write(folder / "mapping.yaml", said)
    work = partial(reads, folder / "run.csv", said, made.ship, f"{key} is {value!r}")
    return Tried(f"{key} = {value!r}", work, "refuse", ("mapping", "run.csv"))


def _may(allowed: Callable[[Any], bool], value: Any) -> bool:
    try:
        return bool(allowed(value))
    except TypeError:
        return False


def _odd(rng: np.random.Generator) -> Any:
    """Some value, or a number of usual size."""
    return round(float(rng.normal(0, 20)), 3) if rng.random() < 0.2 else ODD[int(rng.integers(len(ODD)))]


def _write(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, allow_unicode=True, sort_keys=False))


@cache
def _effects() -> dict[str, Any]:
    """Effects of the package as they are usually set, on a ship."""
    made = {}
    for path in sorted((CONF / "effect").glob("*.yaml")):
        try:
            made[path.stem] = build(yaml.safe_load(path.read_text()), "effect", ship=mariner_corrected())
        except Exception:  # noqa: BLE001 - some need more than a ship
            continue
    return made


def effects(rng: np.random.Generator, folder: Path) -> Tried:
    """A file of effects with a value that is another."""
    usual = _effects()
    name = str(rng.choice(list(usual)))
    declared = usual[name].declared
    p = declared[int(rng.integers(len(declared)))]
    low, high = max(p.low, -1e3), min(p.high, 1e3)
    value = round(float(rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low))), 4)
    value = _odd(rng) if rng.random() < 0.5 else value
    key = p.name if rng.random() < 0.9 else str(rng.choice(["_target_", "colour", "ship", "values"]))
    inside = key == p.name and is_number(value) and p.low <= value <= p.high
    _write(folder / "effects.yaml", {name: {key: value}})
    work = partial(_reads_effect, folder / "effects.yaml", name, key, value)
    unbounded = key == p.name and p.per_run and value == float("inf")
    return Tried(f"{name}.{key} = {value!r}", work, "either" if inside or unbounded else "refuse", (name, key))


def _reads_effect(path: Path, name: str, key: str, value: Any) -> str:
    """Read the file as commands do; the effect has the value."""
    entry = configs.read_effects(path)[name]
    made = build(entry, "effect", ship=mariner_corrected())
    got = float(made.value(key))
    return "" if got == value or abs(got - value) < 1e-12 * abs(value) else f"{key} is {got}"


def manifest(rng: np.random.Generator, folder: Path) -> Tried:
    """A case whose manifest says another thing."""
    m = _case(folder)
    part = str(rng.choice(["particulars", "wind_areas", "stability", "runs", "top"]))
    value, inside = _odd(rng), True
    if part == "top":
        key = str(rng.choice(["ship", "case", "runs", "warmup_s", "particulars", "format"]))
        m[key] = value
        inside = key == "case" and isinstance(value, str | int) or key == "warmup_s" and is_number(value) and value > 0
        inside = (
            inside or (key == "format" and type(value) is int and value == 1) or (value == {} and key == "particulars")
        )
    elif part == "runs":
        key = str(rng.choice(["run", "file", "split", "rows", "campaign", "manoeuvre"]))
        m["runs"][0][key] = value
        inside = key in {"run", "campaign", "manoeuvre"} and (
            isinstance(value, str) or (key == "manoeuvre" and not value)
        )
        inside = inside and not ("/" in str(value) and key == "run")
    else:
        key = str(rng.choice(list(m[part])))
        own, m[part][key] = m[part][key], value
        inside = is_number(value) and (value > 0 or key.startswith("lateral_centroid"))
        if key in SIZES:
            inside = is_number(value) and abs(value / own - 1) < SAME_SIZE
    (folder / "manifest.json").write_text(json.dumps(m))
    work = partial(_reads_case, folder, part, key, value)
    return Tried(f"{part}.{key} = {value!r}", work, "either" if inside else "refuse", ("manifest", "r01", key, "ship"))


SIZES, SAME_SIZE = {"length_m", "beam_m", "draft_m"}, 0.02
"""Sizes of the ship, and how far another may be [relative] that is taken for the same."""
PLACES = {
    "approach_speed_m_s": ("speed", 1.0), "rudder_rate_deg_s": ("rudder_rate", np.pi / 180), "nominal_rpm": ("rpm", 1),
    "calm_water_resistance_kN": ("resistance", 1e3), "displacement_t": ("displacement", 1e3),
}  # fmt: skip


def _reads_case(folder: Path, part: str, key: str, value: Any) -> str:
    """Read a case; its ship is as the manifest says."""
    case = read_case(folder)
    if part == "particulars" and key not in SIZES:
        name, unit = PLACES[key]
        got = getattr(case.hull.particulars, name)
        return "" if abs(got / (value * unit) - 1) < 1e-9 else f"{name} is {got}"
    if key == "warmup_s" and case.warmup != value:
        return f"the warm-up is {case.warmup}"
    if (part, key) == ("runs", "run") and value not in {run.name for run in case.runs}:
        return f"runs are {[run.name for run in case.runs]}"
    return ""


def _case(folder: Path) -> dict[str, Any]:
    """Two runs of the Mariner and what a manifest says of them."""
    for name, run in zip(("r01", "r02"), sailed("mariner")[:2], strict=True):
        north, east = (
            run["u"] * np.cos(run["psi"]) - run["v"] * np.sin(run["psi"]),
            run["u"] * np.sin(run["psi"]) + run["v"] * np.cos(run["psi"]),
        )
        degrees = {k: np.degrees(run[k]) for k in ("psi", "r")} | {"delta": -np.degrees(run["delta"])}
        table = {"t": run.time, "x_north": run["x"], "y_east": run["y"], "sog": np.hypot(north, east)}
        table |= {"cog": np.degrees(np.arctan2(east, north)), **degrees}
        pd.DataFrame(table).to_csv(folder / f"{name}.csv", index=False)
    p = mariner_corrected().particulars
    return {
        "case": "c1", "ship": "mariner", "warmup_s": 40.0,
        "particulars": {"length_m": p.length, "beam_m": p.beam, "draft_m": p.draught, "approach_speed_m_s": p.speed,
                        "rudder_rate_deg_s": 2.5, "nominal_rpm": 76.0, "calm_water_resistance_kN": 350.1,
                        "displacement_t": 16274},
        "wind_areas": {"frontal_m2": 420.0, "lateral_m2": 1650.0, "lateral_centroid_fwd_of_midship_m": -4.0,
                       "length_overall_m": 158.0},
        "stability": {"GM_m": 0.6, "KG_m": 8.4, "roll_period_s": 21.5, "roll_damping_ratio": 0.08},
        "runs": [{"run": "r01", "file": "r01.csv", "split": "fit"}, {"run": "r02", "file": "r02.csv", "split": "fit"}],
    }  # fmt: skip


MANOEUVRES: dict[str, dict[str, Any]] = {
    "zigzag": {"rudder_deg": 20, "heading_deg": 20, "first": "starboard", "executes": None, "duration": None},
    "turning_circle": {"rudder_deg": 35, "side": "starboard", "duration": None},
    "random": {"rudder_deg": 20, "shortest_period": 20, "duration": 200, "seed": 0},
    "spiral": {"rudder_deg": 20, "step_deg": 5, "hold": 20, "first": "starboard"},
    "pull_out": {"rudder_deg": 20, "side": "starboard", "turn_deg": 90, "coast": None},
    "straight": {"duration": None},
}


def manoeuvre(rng: np.random.Generator, folder: Path) -> Tried:
    """A manoeuvre of one's own with a setting that is another, sailed."""
    kind = str(rng.choice(list(MANOEUVRES)))
    said = {**yaml.safe_load((CONF / "manoeuvre" / f"{kind}.yaml").read_text()), **MANOEUVRES[kind]}
    key = str(rng.choice([*MANOEUVRES[kind], "name", "_target_", "colour"]))
    said[key] = value = _odd(rng)
    _write(folder / "manoeuvre" / "mine.yaml", said)
    bad = key in {"_target_", "colour"} or (key in {"first", "side"} and value not in ("starboard", "port"))
    bad = bad or (key == "rudder_deg" and not (is_number(value) and 0 < value <= LIMIT))
    bad = bad or (
        key in {"heading_deg", "turn_deg", "step_deg"} and value is not None and not (is_number(value) and value > 0)
    )
    bad = bad or (key in {"duration", "hold", "coast"} and value is not None and not (is_number(value) and value > 0))
    work = partial(_sails, folder, key, value)
    return Tried(f"{kind}.{key} = {value!r}", work, "refuse" if bad else "either", (key, "manoeuvre", "mine"))


def _sails(folder: Path, key: str, value: Any) -> str:
    """Sail what the folder says."""
    (made,) = configs.named_manoeuvres(["mine"], None, str(folder))
    (run,) = mnn.simulate(great_lakes_bulker(), made)
    channels = np.stack([run[k] for k in ("u", "v", "r", "x", "y", "psi", "delta")])
    if not np.isfinite(channels).all() or np.abs(run["delta"]).max() > np.radians(LIMIT) + 1e-9:
        return "it is not finite, or beyond the rudder's stop"
    if key == "rudder_deg" and np.abs(run["delta_order"]).max() > np.radians(value) + 1e-9:
        return f"the rudder was ordered to {np.degrees(np.abs(run['delta_order']).max()):.4g} deg"
    if key == "duration" and value is not None and abs(run.duration - value) > run.step and run.status == "ok":
        return f"it lasted {run.duration:g} s"
    return ""


def ship(rng: np.random.Generator, folder: Path) -> Tried:
    """A ship of one's own with a dimension that is another."""
    said = {
        "_target_": "manoeuvre_nn.ship.own.own_particulars", "name": "mine", "length": 150.0, "beam": 22.0,
        "draught": 8.0, "block": 0.6, "speed_kn": 15.0, "rudder_rate_deg_s": 2.5, "rudder_limit_deg": 35.0,
        "rudder_area_ratio": 0.02, "rpm": 80.0, "displacement_t": 15000.0, "rho": 1025.0,
    }  # fmt: skip
    key = str(rng.choice([*said, "colour"]))
    said[key] = value = _odd(rng)
    _write(folder / "mine.yaml", said)
    value = yaml.safe_load((folder / "mine.yaml").read_text())[key]  # blanks of other alphabets end lines
    word = isinstance(value, str | int | float) and not isinstance(value, bool)
    good = word if key == "name" else is_number(value) and value > 0 or (key == "displacement_t" and value is None)
    bad = key in {"_target_", "colour"} or not good
    work = partial(_reads_ship, folder / "mine.yaml", key, value)
    return Tried(f"{key} = {value!r}", work, "refuse" if bad else "either", (key, "mine", "ship"))


def _reads_ship(path: Path, key: str, value: Any) -> str:
    """Read runs as those of the ship; it is as the file says."""
    run = sailed("mariner")[0]
    run.to_csv(path.parent / "run.csv")
    got = mnn.read(path.parent / "run.csv", ship=str(path)).ship
    names = {"speed_kn": ("speed", 1852 / 3600), "rudder_rate_deg_s": ("rudder_rate", np.pi / 180)}
    names |= {"rudder_limit_deg": ("rudder_limit", np.pi / 180), "displacement_t": ("displacement", 1e3)}
    name, unit = names.get(key, (key, 1))
    there = getattr(got, name)
    right = (
        there == value if value is None or isinstance(value, str) else abs(there - value * unit) <= 1e-9 * abs(there)
    )
    return "" if right else f"{name} is {there}"


SEA = {"V": ("kn", 1852 / 3600, 0, 60), "beta": ("deg", np.pi / 180, 0, 180), "Hs": ("m", 1.0, 0, 25),
       "T": ("s", 1.0, 1, 30), "pitch": ("deg", np.pi / 180, 0, 45)}  # fmt: skip
VARIABLES = [Variable(k, unit, size, k, low=low * size, high=high * size) for k, (unit, size, low, high) in SEA.items()]
"""Variables of a seaway, as conf/task/pitch.yaml has them."""


def records(rng: np.random.Generator, folder: Path) -> Tried:
    """A table of pitch in a seaway with a cell that is another."""
    rows = [[v, b, h, t, 0.3 * h] for v, b, h, t in rng.uniform([0, 0, 1, 8], [20, 180, 4, 14], (8, 4)).round(3)]
    row, k = int(rng.integers(8)), int(rng.integers(5))
    rows[row][k] = value = _odd(rng)
    text = [",".join(f"{name} [{unit}]" for name, (unit, *_) in SEA.items())]
    text += [
        ",".join("" if cell is None else f'"{cell}"' if "," in str(cell) else str(cell) for cell in r) for r in rows
    ]
    (folder / "sea.csv").write_text("\n".join(text), encoding="utf-8")
    name = list(SEA)[k]
    number = float(value) if isinstance(value, str) and value == "1e3" else value
    low, high = (-360, 360) if name == "beta" else SEA[name][2:]
    inside = is_number(number) and low <= number <= high
    work = partial(_reads_records, folder / "sea.csv", row, k, number)
    return Tried(f"{name} = {value!r}", work, "either" if inside else "refuse", ("sea.csv",))


def _reads_records(path: Path, row: int, k: int, value: float) -> str:
    """Read a table of records."""
    found = read_records([path], VARIABLES[:-1], VARIABLES[-1], read_records_mapping(None))
    got = float(np.column_stack([found.conditions, found.values])[row, k])
    size = list(SEA.values())[k][1]
    wanted = abs((value + 180) % 360 - 180) * size if list(SEA)[k] == "beta" else value * size
    return "" if abs(got - wanted) < 1e-9 else f"it is {got}"


KINDS: dict[str, tuple[float, Callable[[np.random.Generator, Path], Tried]]] = {
    "mapping": (0.06, mapping),
    "setting": (0.04, setting),
    "effects": (0.05, effects),
    "manifest": (0.05, manifest),
    "manoeuvre": (0.04, manoeuvre),
    "ship": (0.03, ship),
    "records": (0.03, records),
    "trap": (0.05, trap),
}
