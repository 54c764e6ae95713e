"""Time and memory of large recordings, and whether memory stays flat when the same is done again and again.

    python benchmarks/scale.py [rows=1e6,2e6,5e6,1e7] [files=100,300,1000] [hours=6,12,24] [epochs=1000] [jobs=1000]
        [cases=1000]

Only what is named is done. Growing sizes: each step at each size runs in a process of its own; its time is CPU time,
its memory the peak of that process, of which 0.3 to 0.4 GB are Python and its libraries. The exponents are the slopes
of both over the two largest sizes, in logarithms (1: linear). Repeated work: one process does all; its resident memory,
open files and threads are read now and then, and the slope of the memory over the second half, with its standard error,
says what so many more would add.

    rows    recordings of so many samples at 100 Hz: read, check, import, and made ready for a diagnosis
    files   folders of so many recordings of 300 s: check, and the data of a training
    hours   voyages of so many hours at 1 Hz: check, coefficients in closed loop, a diagnosis with one candidate
    epochs  of each method of training
    jobs    of a sweep in one process, and by the package's launcher
    cases   of a diagnosis

The inputs are hours of the Mariner under a helmsman (``scale_inputs.py``), in a temporary folder of up to 2 GB.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import scale_growing
import scale_repeated

Work = Callable[[], object]
GROWING = {"rows": scale_growing.rows, "files": scale_growing.files, "hours": scale_growing.hours}
REPEATED = {"epochs": scale_repeated.epochs, "jobs": scale_repeated.jobs, "cases": scale_repeated.cases}
FLAT_MB, LINEAR = 5.0, 1.15
"""What as many repetitions again may add to be called flat, and exponent up to which growth is called linear."""


def main(words: Sequence[str]) -> int:
    """Measure what was asked for; 1 if something grows."""
    asked = dict(word.partition("=")[::2] for word in words)
    unknown = set(asked) - {*GROWING, *REPEATED}
    if unknown or not asked:
        print(f"error: {sorted(unknown) or 'nothing was asked for'}: write {'=N '.join([*GROWING, *REPEATED])}=N")
        return 2
    wrong = 0
    for name, value in asked.items():
        sizes = [int(float(size)) for size in value.split(",")]
        with tempfile.TemporaryDirectory(prefix="scale_") as folder:
            if name in GROWING:
                wrong += _grown(name, sizes, Path(folder))
            else:
                wrong += _repeated(name, sizes[-1], Path(folder))
    return int(wrong > 0)


def _grown(name: str, sizes: Sequence[int], folder: Path) -> int:
    """A table of every step at every size; how many steps grow faster than linearly."""
    measured: dict[str, list[tuple[float, float]]] = {}
    for size in sizes:
        for step, work in GROWING[name](size, folder):
            measured.setdefault(step, []).append(in_process(work, folder))
            print(f"{name} {size} {step}: {measured[step][-1][0]:.1f} s, {measured[step][-1][1]:.0f} MB", flush=True)
    print(f"\n{name:<10}" + "".join(f"{size:>20,}" for size in sizes) + f"{'exponents':>16}")
    faster = 0
    for step, both in measured.items():
        time_slope, memory_slope = (_slope(sizes, [max(one[k], 1e-3) for one in both]) for k in (0, 1))
        faster += max(time_slope, memory_slope) > LINEAR
        cells = "".join(f"{seconds:>10.1f} s {peak:>5.0f} MB" for seconds, peak in both)
        print(f"{step:<10}{cells}{time_slope:>10.2f} {memory_slope:.2f}", flush=True)
    return faster


def _slope(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Exponent of growth, by the two largest sizes: small ones show what is the same for all."""
    return float("nan") if len(sizes) < 2 else float(np.diff(np.log(values[-2:]))[0] / np.diff(np.log(sizes[-2:]))[0])


def _repeated(name: str, count: int, folder: Path) -> int:
    """What so many repetitions leave behind, a line a kind; how many kinds grow."""
    growing = 0
    for kind, work in REPEATED[name](count, folder):
        told = folder / "readings.txt"
        in_process(lambda work=work, told=told: scale_repeated.watched(work, told), folder)
        readings = np.array([line.split() for line in told.read_text().splitlines()], dtype=float)
        if len(readings) < 4:
            print(f"{name} {kind}: ended after {len(readings)} readings")
            growing += 1
            continue
        done, memory = readings[:, 0], readings[:, 1]
        late = done >= 0.5 * done[-1]
        (slope, _), covariance = np.polyfit(done[late], memory[late], 1, cov="unscaled")
        rest = memory[late] - np.polyval(np.polyfit(done[late], memory[late], 1), done[late])
        error = float(np.sqrt(covariance[0, 0] * rest @ rest / max(len(rest) - 2, 1)))
        more, uncertain = slope * done[-1], error * done[-1]
        growing += more - 2 * uncertain > FLAT_MB
        thirds = [int(np.abs(done - share * done[-1]).argmin()) for share in (0.1, 0.3, 1.0)]
        cells = ", ".join(f"{done[k]:.0f}: {memory[k]:.0f} MB" for k in thirds)
        print(
            f"{name} {kind}: {cells}; {done[-1]:.0f} more would add {more:.1f} +- {uncertain:.1f} MB; open files "
            f"{readings[thirds[0], 2]:.0f} -> {readings[-1, 2]:.0f}, threads {readings[thirds[0], 3]:.0f} -> "
            f"{readings[-1, 3]:.0f}; {readings[-1, 4] / done[-1]:.3f} s each",
            flush=True,
        )
    return growing


def in_process(work: Work, folder: Path) -> tuple[float, float]:
    """CPU time [s] of a piece of work in a forked process, and its peak memory [MB]."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.chdir(folder)
            out = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(out, 1), os.dup2(out, 2)
            work()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            sys.stdout.flush()
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status):
        print(f"  ended with {os.waitstatus_to_exitcode(status)}: {(folder / 'said.txt').read_text()[-600:]}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


if __name__ == "__main__":
    began = time.monotonic()
    ended = main(sys.argv[1:])
    print(f"{time.monotonic() - began:.0f} s")
    sys.exit(ended)
