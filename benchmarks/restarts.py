"""Restarts a second against their number in a batch: Levenberg-Marquardt on the processor and, if there is one, a GPU.

    OMP_NUM_THREADS=1 python benchmarks/restarts.py [batch=1,8,64,512] [epochs=30]

The problem is that of ``levenberg_marquardt.py``: the tanker's zigzag, 1501 samples, networks of 4 to 14 nodes of tanh
with four inputs and three outputs, all sizes in one batch. Every restart takes the same number of steps from weights of
its own. On a GPU batches grow from 512 by factors of two until memory is full; the peak of what a batch took is told.
"""

import sys
import time

import torch
from levenberg_marquardt import HIDDEN, tanker
from torch import Tensor

from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.damping import Damping, Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import minimise

SMALLEST = 4
"""Nodes of the smallest network."""


def rate(count: int, epochs: int, x: Tensor, y: Tensor) -> float:
    """Restarts a second.

    Args:
        count: Restarts in the batch.
        epochs: Steps that each takes.
        x: Inputs, on the device to use.
        y: Targets.

    Returns:
        Restarts over elapsed time [1/s].
    """
    network = Perceptron((count, 4, HIDDEN, 3), activation="tanh", initial="symmetric", seed=0)
    start = torch.cat([p.detach().flatten(1) for p in network.parameters()], 1).to(x)
    sizes = SMALLEST + torch.arange(count, device=x.device) % (HIDDEN - SMALLEST + 1)
    problem = OneHidden(x, y, HIDDEN, activation="tanh", sizes=sizes, max_elements=1e12 if x.is_cuda else 2e7)
    begun = time.perf_counter()
    minimise(problem, start, damping=Damping("nielsen"), stops=Stops(epochs=epochs))
    if x.is_cuda:
        torch.cuda.synchronize()
    return count / (time.perf_counter() - begun)


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: As above.
    """
    use_threads(1)
    given = dict(a.partition("=")[::2] for a in arguments)
    epochs, data = int(given.get("epochs", "30")), tanker()
    batches = [int(size) for size in given.get("batch", "1,8,64,512").split(",")]
    print(f"{epochs} epochs of networks of {SMALLEST} to {HIDDEN} nodes, {len(data.x)} samples")
    print(f"{'device':<8}{'batch':>8}{'restarts/s':>12}{'over one on the processor':>27}{'peak GiB':>10}")
    rate(1, 3, data.x, data.y)  # whatever is loaded at first use
    one = rate(1, epochs, data.x, data.y)
    for count in batches:
        found = rate(count, epochs, data.x, data.y)
        print(f"{'cpu':<8}{count:8d}{found:12.2f}{found / one:27.2f}{'':>10}", flush=True)
    if not torch.cuda.is_available():
        print("no GPU here: its rows are left out")
        return
    x, y, count = data.x.cuda(), data.y.cuda(), 512
    rate(8, 3, x, y)
    while True:
        torch.cuda.reset_peak_memory_stats()
        try:
            found = rate(count, epochs, x, y)
        except torch.cuda.OutOfMemoryError:
            print(f"a batch of {count} does not fit into memory")
            return
        peak = torch.cuda.max_memory_allocated() / 2**30
        print(f"{'cuda':<8}{count:8d}{found:12.2f}{found / one:27.2f}{peak:10.1f}", flush=True)
        count *= 2


if __name__ == "__main__":
    main(sys.argv[1:])
