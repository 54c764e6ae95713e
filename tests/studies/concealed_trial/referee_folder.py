"""A folder as the referee hands one out, without its recordings."""

import json
from pathlib import Path


def write_manifest(folder: Path) -> Path:
    """A folder with a manifest of two runs of 100 s."""
    runs = [{"run": r, "split": s, "file": f"{r}.csv", "duration_s": 100} for r, s in (("a", "fit"), ("b", "held_out"))]
    noise = {"position_m": 0.7, "gps_velocity_m_s": 0.04, "heading_deg": 0.1, "yaw_rate_deg_s": 0.02, "log_m_s": 0.05}
    manifest = {"ship": "mariner", "runs": runs, "warmup_s": 4.0, "nominal_noise_sd": noise}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder
