"""A sweep on a Ray cluster of two nodes on loopback, whose workers are killed in its middle, and one by submitit.

    python benchmarks/cluster.py [FOLDER]

prints what was killed, when, and what was there after. It needs the extras ``ray`` and ``sweep``.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import ray
from ray.cluster_utils import Cluster

from manoeuvre_nn.report.sweep import SCORES, sweep_rows
from manoeuvre_nn.report.tables import to_markdown

SWEEP = (
    "network=wang", "fit=levenberg_marquardt", "network.hidden=2,3,4", "data.length=60,90",
    "score=[{zz20:{duration:60}}]",
    "scoring.solver=rollout", "scoring.every=200", "trainer.max_epochs=200", "fit.iterations_per_epoch=1",
)  # fmt: skip
JOBS = 6
LIMIT_S = 900
"""Longest that a sweep may take [s]."""


def sweep(folder: Path, *words: str) -> subprocess.Popen:
    """Begin a sweep into a folder; what it prints goes to a file beside it."""
    program = "import sys; from manoeuvre_nn.commands.start import run; run('train')"
    command = [sys.executable, "-c", program, "-m", *SWEEP, *words, f"out={folder}"]
    return subprocess.Popen(command, stdout=folder.with_suffix(".txt").open("w"), stderr=subprocess.STDOUT)


def finished(folder: Path) -> list[str]:
    """Jobs that are done."""
    return sorted(path.parent.name for path in folder.glob(f"*/{SCORES}"))


def under_way(folder: Path) -> list[str]:
    """Jobs with a checkpoint and without scores."""
    begun = {path.parents[1].name for path in folder.glob("*/checkpoints/last.ckpt")}
    return sorted(begun - set(finished(folder)))


def workers() -> list[int]:
    """Processes of Ray that run a job."""
    found = subprocess.run(["ps", "-eo", "pid,args"], capture_output=True, text=True, check=True).stdout
    return [int(line.split()[0]) for line in found.splitlines() if line.split()[1] == "ray::_run_job"]


def until(what: Callable[[], object], process: subprocess.Popen) -> bool:
    """Wait for something while a sweep runs; whether it came."""
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        if what():
            return True
        if process.poll() is not None:
            return False
        time.sleep(0.2)
    return False


def ray_rows(folder: Path) -> list[dict[str, object]]:
    """The sweep on two nodes: a worker is killed in the middle of a job, then a whole node."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    second = cluster.add_node(num_cpus=1)
    began, process = (
        time.monotonic(),
        sweep(folder, "hydra/launcher=ray_cluster", f"hydra.launcher.ray.init.address='{cluster.address}'"),
    )
    rows = []

    def told(what: str) -> None:
        rows.append({
            "launcher": "Ray, two nodes", "s": round(time.monotonic() - began), "killed": what,
            "done": len(finished(folder)), "under way": ", ".join(under_way(folder)),
        })  # fmt: skip

    if until(lambda: under_way(folder) and workers(), process):
        victim = workers()[0]
        told("a worker in the middle of a job (kill -9)")
        os.kill(victim, signal.SIGKILL)
    if until(lambda: len(finished(folder)) >= 2 and under_way(folder), process):
        told("one of the two nodes with all its processes")
        cluster.remove_node(second, allow_graceful=False)
    code = process.wait(LIMIT_S)
    told(f"nothing: the sweep ended with exit code {code}")
    cluster.shutdown()
    ray.shutdown()
    return rows


def submitit_rows(folder: Path) -> list[dict[str, object]]:
    """The same by submitit's local executor, which is what Slurm's does, with processes of this machine."""
    began, process = time.monotonic(), sweep(folder, "hydra/launcher=submitit_local")
    code = process.wait(LIMIT_S)
    return [{
        "launcher": "submitit, local", "s": round(time.monotonic() - began),
        "killed": f"nothing: the sweep ended with exit code {code}", "done": len(finished(folder)), "under way": "",
    }]  # fmt: skip


def same(one: Path, other: Path) -> str:
    """Whether two sweeps have the same scores."""
    scores: Sequence[dict[str, object]] = [
        {str(row["job"]): row.get("mean dev/L") for row in sweep_rows(folder)} for folder in (one, other)
    ]
    return "the same" if scores[0] == scores[1] else f"not the same: {scores}"


def main() -> None:
    """Run both and print the table."""
    place = Path(sys.argv[1] if len(sys.argv) > 1 else "cluster").absolute()
    place.mkdir(parents=True, exist_ok=True)
    rows = ray_rows(place / "ray") + submitit_rows(place / "submitit")
    print(to_markdown(rows))
    print(f"scores of {JOBS} jobs on Ray and by submitit: {same(place / 'ray', place / 'submitit')}")


if __name__ == "__main__":
    main()
