"""Levenberg-Marquardt of this package beside other implementations: CPU time of an epoch and to a given error.

    OMP_NUM_THREADS=1 python benchmarks/levenberg_marquardt.py [starts]

One thread, one process; every start is run by all methods in turn before the next one. An epoch is a step that lowers
the error, with the tries that failed before it. Compilation is left out, scipy is given the Jacobian by formula, and a
method that did not come to the goal counts as having taken for ever. Other packages are left out where they are not
installed: torch-levenberg-marquardt, optimistix.

Two problems for a 4-14-3 network of tanh, 1501 samples each, targets of unit variance: ``tanker``, the zigzag of Rajesh
& Bhattacharyya 2009, on which no 4-14-3 network comes near 1e-10, so that only epochs are timed; and ``smooth``, a map
that eight nodes could represent, to 1e-10.
"""

import importlib.util
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # studies stand beside the package, not in it
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")

import numpy as np  # noqa: E402
import torch  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402
from torch import Tensor  # noqa: E402

from manoeuvre_nn.manoeuvre.zigzag import zigzag  # noqa: E402
from manoeuvre_nn.network.perceptron import Perceptron  # noqa: E402
from manoeuvre_nn.numerics.damping import Damping, Rule, Stops  # noqa: E402
from manoeuvre_nn.numerics.levenberg_marquardt import LevenbergMarquardt  # noqa: E402
from manoeuvre_nn.numerics.one_hidden import OneHidden  # noqa: E402
from manoeuvre_nn.numerics.restarts import minimise  # noqa: E402
from manoeuvre_nn.ship.esso_190k import esso_190k  # noqa: E402
from manoeuvre_nn.ship.known import no_part  # noqa: E402
from manoeuvre_nn.training.data import DataSettings, SimulatedData  # noqa: E402
from manoeuvre_nn.training.scalings import make_scaling  # noqa: E402
from studies.rajesh2009.separable import Separable  # noqa: E402

HIDDEN, SAMPLES = 14, 1501
TIMED_EPOCHS = 30
MOST_EPOCHS = 400


@dataclass(frozen=True)
class Data:
    """Inputs (n, 4), targets (n, 3) and the error to reach, if any."""

    name: str
    x: Tensor
    y: Tensor
    goal: float | None


@dataclass(frozen=True)
class Ended:
    """Epochs done and the mean square error they came to."""

    epochs: int
    mse: float


Method = Callable[[Data, Perceptron, float, int], Ended]
"""Data, network with the first weights, goal and most epochs."""


def tanker() -> Data:
    """1500 s of the 20-deg zigzag of the tanker, inputs and forces standardised."""
    ship = esso_190k()
    known = no_part(ship)
    data = SimulatedData(ship, known, [zigzag(20.0)], [zigzag(10.0)], settings=DataSettings(SAMPLES - 1.0, rate_hz=1.0))
    data.setup()
    scaling = make_scaling("standard", known, data.tuples)
    return Data("tanker", scaling.inputs(data.tuples.inputs), scaling.outputs(data.tuples.targets), None)


def smooth() -> Data:
    """Eight nodes of tanh over the cube."""
    generator = torch.Generator().manual_seed(0)
    x = 2 * torch.rand(SAMPLES, 4, generator=generator, dtype=torch.float64) - 1
    inner = torch.randn(8, 4, generator=generator, dtype=torch.float64)
    outer = torch.randn(3, 8, generator=generator, dtype=torch.float64)
    y = torch.tanh(x @ inner.T) @ outer.T
    return Data("smooth", x, (y - y.mean(0)) / y.std(0), 1e-10)


def flat(network: Perceptron) -> Tensor:
    """All weights as one row."""
    return torch.cat([p.detach().reshape(1, -1) for p in network.parameters()], 1)


def structured(rule: Rule) -> Method:
    """Normal equations by blocks, all weights unknown."""

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        problem = OneHidden(data.x, data.y, HIDDEN, activation="tanh")
        found = minimise(problem, flat(network), damping=Damping(rule), stops=Stops(epochs, goal))
        return Ended(int(found.epochs), float(found.mse))

    return run


def separable(kaufman: bool) -> Method:
    """Output weights solved exactly."""

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        problem = Separable(data.x, data.y, HIDDEN, activation="tanh", kaufman=kaufman)
        found = minimise(problem, flat(network)[:, : problem.parameters], stops=Stops(epochs, goal))
        return Ended(int(found.epochs), float(found.mse))

    return run


def optimizer(products: bool) -> Method:
    """The torch optimizer, with normal equations by blocks or with the dense Jacobian by formula."""

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        problem = OneHidden(data.x, data.y, HIDDEN, activation="tanh")
        given: dict[str, Any] = {"jacobian": lambda: network.jacobian(data.x)}
        if products:
            given = {"normal": lambda: problem.normal_equations(flat(network))}
        lm = LevenbergMarquardt(
            network.parameters(), rows=1, damping=Damping("nielsen"), stops=Stops(goal=goal, min_step=0.0), **given
        )
        done = 0
        while done < epochs and not lm.stopped:
            lm.step(lambda: (network.rows(data.x) - data.y).flatten(1))
            done += 1
        return Ended(done, float(lm.loss))

    return run


def scipy_method(name: str) -> Method:
    """scipy.optimize.least_squares with the dense Jacobian by formula; it knows no goal, so an exception ends it."""

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        done, mse = -1, inf

        class Enough(Exception):
            pass

        def put(weights: np.ndarray) -> None:
            first, last = network.parameters()
            given = torch.from_numpy(weights)
            first.data = given[: first.numel()].reshape(first.shape)
            last.data = given[first.numel() :].reshape(last.shape)

        @torch.no_grad()
        def errors(weights: np.ndarray) -> np.ndarray:
            nonlocal mse
            put(weights)
            e = (network.rows(data.x)[0] - data.y).flatten()
            now = float(e.square().mean())
            mse = min(mse, now)
            if now <= goal:
                raise Enough
            return e.numpy()

        def jacobian(weights: np.ndarray) -> np.ndarray:
            nonlocal done
            done += 1
            if done >= epochs:
                raise Enough
            put(weights)
            return network.jacobian(data.x)[0].numpy()

        start = flat(network)[0].numpy().copy()
        tight = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
        try:
            least_squares(errors, start, jacobian, method=name, max_nfev=10 * epochs, **tight)
        except Enough:
            done += mse <= goal  # the step that came to the goal asked for no Jacobian any more
        return Ended(max(done, 1), mse)

    return run


def torch_levenberg_marquardt() -> Method:
    """torch-levenberg-marquardt with its fastest solver."""
    from torch_levenberg_marquardt.training import LevenbergMarquardtModule  # noqa: PLC0415

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        model = torch.nn.Sequential(torch.nn.Linear(4, HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, 3)).double()
        for layer, weights in zip((model[0], model[2]), network.parameters(), strict=True):
            layer.weight.data, layer.bias.data = weights.detach()[0, :, :-1].clone(), weights.detach()[0, :, -1].clone()
        lm = LevenbergMarquardtModule(model, solve_method="cholesky")
        done, mse, over = 0, inf, False
        while done < epochs and mse > goal and not over:
            _, loss, over, _ = lm.training_step(data.x, data.y)
            done, mse = done + 1, float(loss)
        return Ended(done, mse)

    return run


def optimistix(solver: str) -> Method:
    """optimistix.LevenbergMarquardt, with its own QR or with Cholesky's factors of the normal equations."""
    import equinox as eqx  # noqa: PLC0415
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415
    import lineax as lx  # noqa: PLC0415
    import optimistix as optx  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)

    class ToGoal(optx.LevenbergMarquardt):
        """Ends at an error; its own tests are set so tight that they never end it first."""

        def terminate(self, fn, y, args, options, state, tags):  # noqa: ANN001, ANN202, D102
            mse = jnp.mean(state.f_info.residual**2)
            over = (mse <= args[2]) | (state.num_accepted_steps > args[3])
            return (over | state.terminate) & ~state.first_step, state.result

    def errors(w, args):  # noqa: ANN001, ANN202
        nodes = jnp.tanh(args[0] @ w[0][:, :-1].T + w[0][:, -1])
        return nodes @ w[1][:, :-1].T + w[1][:, -1] - args[1]

    linear = lx.QR() if solver == "qr" else lx.Normal(lx.Cholesky())
    method = ToGoal(rtol=1e-15, atol=1e-15, linear_solver=linear)

    @eqx.filter_jit
    def solve(w, args):  # noqa: ANN001, ANN202
        return optx.least_squares(errors, method, w, args, max_steps=10 * MOST_EPOCHS, throw=False)

    def run(data: Data, network: Perceptron, goal: float, epochs: int) -> Ended:
        w = [jnp.asarray(p.detach()[0].numpy()) for p in network.parameters()]
        found = solve(w, (data.x.numpy(), data.y.numpy(), np.float64(goal), np.int64(epochs)))
        mse = float(jnp.mean(found.state.f_info.residual**2))
        return Ended(max(int(found.state.num_accepted_steps) - 1, 1), mse)

    return run


def methods() -> dict[str, Method]:
    """All methods that can be run here, this package's own first."""
    found = {
        "this: structured, nielsen": structured("nielsen"),
        "this: structured, trainlm": structured("trainlm"),
        "this: separable": separable(kaufman=False),
        "this: separable, kaufman": separable(kaufman=True),
        "this: torch optimizer, structured": optimizer(products=True),
        "this: torch optimizer, dense": optimizer(products=False),
        "scipy lm": scipy_method("lm"),
        "scipy trf": scipy_method("trf"),
    }
    if importlib.util.find_spec("torch_levenberg_marquardt"):
        found["torch-levenberg-marquardt"] = torch_levenberg_marquardt()
    if importlib.util.find_spec("optimistix"):
        found |= {"optimistix, qr": optimistix("qr"), "optimistix, cholesky": optimistix("cholesky")}
    return found


def start(seed: int) -> Perceptron:
    """A network with its first weights."""
    return Perceptron((1, 4, HIDDEN, 3), activation="tanh", initial="symmetric", seed=seed)


def timed(method: Method, data: Data, seed: int, goal: float, epochs: int) -> tuple[float, Ended]:
    """CPU seconds of a run."""
    network = start(seed)
    began = time.process_time()
    ended = method(data, network, goal, epochs)
    return time.process_time() - began, ended


def table(data: Data, runs: dict[str, Method], seeds: Sequence[int]) -> None:
    """Run all and print."""
    epoch, to_goal, needed = ({name: [] for name in runs} for _ in range(3))
    for method in runs.values():
        timed(method, data, 0, 0.0, 2)  # whatever is compiled or loaded at first use
    for seed in seeds:
        for name, method in runs.items():
            seconds, ended = timed(method, data, seed, 0.0, TIMED_EPOCHS)
            epoch[name].append(1e3 * seconds / ended.epochs)
            if data.goal is not None:
                seconds, ended = timed(method, data, seed, data.goal, MOST_EPOCHS)
                reached = ended.mse <= data.goal
                to_goal[name].append(1e3 * seconds if reached else inf)
                needed[name].append(ended.epochs if reached else inf)
    print(f"\n{data.name}: CPU ms, median of {len(seeds)} starts; goal: mse {data.goal}")
    print(f"{'method':36}{'an epoch':>10}{'ratio':>8}{'to goal':>10}{'ratio':>8}{'epochs':>8}{'reached':>9}")
    for name in runs:
        line = f"{name:36}" + _beside(epoch, name)
        if data.goal is not None:
            share = sum(t < inf for t in to_goal[name]) / len(seeds)
            line += _beside(to_goal, name) + f"{median(needed[name]):8.0f}{share:9.0%}"
        print(line, flush=True)


def _beside(times: dict[str, list[float]], name: str) -> str:
    """A median and how many times that of this package's fastest it is."""
    ours = min(median(all_) for other, all_ in times.items() if other.startswith("this"))
    return f"{median(times[name]):10.2f}{median(times[name]) / ours:8.1f}"


def main() -> None:
    """Print a table for each problem."""
    torch.set_num_threads(1)
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 16)
    runs = methods()
    for data in (smooth(), tanker()):
        table(data, runs, seeds)


if __name__ == "__main__":
    main()
