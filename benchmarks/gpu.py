"""The same training on the processor and on a GPU: held-out errors and times side by side.

    OMP_NUM_THREADS=1 python benchmarks/gpu.py [fits=backprop,recursive] [to=gpu] [out=outputs/gpu]

Each fit is run by the command ``train`` with ``trainer.accelerator=cpu`` and with the other, and what the GPU left is
carried on by the processor for one epoch. Results are written to OUT/gpu.json, too.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CIRCLES = (
    "ship=container_twin", "manoeuvre=circles", "manoeuvre.circles.turn_deg=90", "manoeuvre.circles.rudder_deg=[15,35]",
    "score=[{tc25: {duration: 300}}]",
)  # fmt: skip
FITS: dict[str, tuple[int, tuple[str, ...]]] = {
    "backprop": (4, ("network=wang",)),
    "levenberg_marquardt": (8, ("network=rajesh",)),
    "ensemble": (60, ()),
    "closed_loop": (5, ("network=cubic", "data.noise.u=0.02", "data.noise.r_deg_s=0.02")),
    "recursive": (5, ("network=recursive", *CIRCLES)),
    "bayesian": (8, ("task=pitch", "data.method=closed_form")),
    "radial_basis": (2, ("task=pitch", "data.method=closed_form", "network=rbf")),
    "general_regression": (4, ("task=pitch", "data.method=closed_form", "network=grnn")),
}
"""Epochs and words of each fit."""


def trained(out: Path, epochs: int, *words: str) -> dict[str, Any]:
    """Train by the command.

    Args:
        out: Output folder.
        epochs: How many.
        words: Further settings.

    Returns:
        Held-out error (mean deviation over L, or of the pitch [deg]) and the time of the training [s], or what went
        wrong.
    """
    general = (f"trainer.max_epochs={epochs}", "trainer.progress=false", "data.noise.psi_deg=0.05")
    general = general[:2] if "task=pitch" in words else general
    command = [sys.executable, "train.py", *general, *words, f"out={out}"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if ended.returncode:
        return {"failed": (ended.stderr or ended.stdout).strip()[-300:]}
    said = json.loads((out / "scores.json").read_text())
    return {"error": said.get("mean_dev_L", said.get("error")), "seconds": said["training"]["seconds"]}


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: As above.
    """
    given = dict(a.partition("=")[::2] for a in arguments)
    other, out = given.get("to", "gpu"), Path(given.get("out", "outputs/gpu")).resolve()
    results: dict[str, Any] = {}
    print("| fit | error, cpu | gpu | carried on | time, cpu s | gpu s |\n|---|---|---|---|---|---|")
    for fit in given.get("fits", ",".join(FITS)).split(","):
        epochs, words = FITS[fit]
        cpu, gpu = (trained(out / f"{fit}_{kind}", epochs, *words, f"trainer.accelerator={kind}") for kind in
                    ("cpu", other))  # fmt: skip
        last = out / f"{fit}_{other}" / "checkpoints" / "last.ckpt"
        on = trained(out / f"{fit}_on", epochs + 1, *words, f"trainer.resume={last}")
        results[fit] = {"cpu": cpu, other: gpu, "carried on": on}
        cells = [f"{of[key]:.4g}" if key in of else of.get("failed", "–") for of, key in (
            (cpu, "error"), (gpu, "error"), (on, "error"), (cpu, "seconds"), (gpu, "seconds"))]  # fmt: skip
        print("|", " | ".join([fit, *cells]), "|", flush=True)
        (out / "gpu.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main(sys.argv[1:])
