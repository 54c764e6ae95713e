"""Folders of recordings as the concealed cases have them: CSV files and a manifest."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.runs import Run, order_lead, smooth_rudder, smooth_shaft


@dataclass(frozen=True)
class Case:
    name: str
    ship: str
    manifest: dict
    runs: tuple[Run, ...]


def read_case(folder: Path) -> Case:
    m = json.loads((folder / "manifest.json").read_text())
    rate = m["particulars"]["rudder_rate_deg_s"] * DEGREE
    runs = []
    for entry in m["runs"]:
        d = pd.read_csv(folder / entry["file"])
        runs.append(
            make_run(
                d,
                entry["run"],
                rate,
                m["particulars"]["nominal_rpm"],
                entry["manoeuvre"],
                entry["split"] == "held_out",
                m["warmup_s"],
            )
        )
    return Case(m["case"], m["ship"], m, tuple(runs))


def _unwrapped(a: np.ndarray) -> np.ndarray:
    out = a.copy()
    good = np.isfinite(a)
    out[good] = np.unwrap(a[good])
    return out


def make_run(d: pd.DataFrame, name: str, rate: float, rpm: float, kind: str, held: bool, warmup: float) -> Run:
    t = d["t"].to_numpy(float)
    cog, psi = d["cog"].to_numpy(float) * DEGREE, _unwrapped(d["psi"].to_numpy(float) * DEGREE)
    sog = d["sog"].to_numpy(float)
    measured = np.stack(
        [
            d["x_north"],
            d["y_east"],
            sog * np.cos(cog),
            sog * np.sin(cog),
            psi,
            d["r"] * DEGREE,
            d["u_log"],
            d["n"] / rpm,
        ],
        axis=-1,
    ).astype(float)
    filled = d.interpolate(limit_direction="both")
    order = -filled["delta_order"].to_numpy(float) * DEGREE
    shown = -filled["delta"].to_numpy(float) * DEGREE
    delta, noise = smooth_rudder(shown, order, t[1] - t[0], rate)
    lead = order_lead(shown, order, t[1] - t[0], rate)
    return Run(name, t, measured, delta, order, lead, smooth_shaft(measured[:, 7]), noise, kind, held, warmup, d)
