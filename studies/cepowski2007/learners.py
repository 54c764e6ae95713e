"""Ways to learn a response from records: the paper's networks, the recommended one, and polynomials.

Each is a function of scaled inputs (n, i), scaled values (n,) and a seed, and gives a function of scaled inputs.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.kernel_regression import WidthSearch, kernel_mean
from manoeuvre_nn.numerics.radial_basis import gaussian_nodes, k_means, neighbour_distances, ridge_by_press
from manoeuvre_nn.numerics.repeats import without_repeats
from studies.cepowski2007.perceptrons import SPREAD, Structure, train_perceptrons

Values = Float[np.ndarray, " n"]
Predict = Callable[[Float[np.ndarray, "n i"]], Values]
Learn = Callable[[Float[np.ndarray, "n i"], Values, int], Predict]
FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
RIDGES = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
NEIGHBOURS = 5
MAX_WIDTH_STEPS = 60
DEGREES = (1, 2, 3, 4, 5, 6)
"""Degrees of polynomials to choose from."""
MAX_TERMS_PER_RECORD = 0.5
BATCH, DESCENT_STEPS, RATE, MOMENTUM = 20, 6000, 0.05, 0.9
"""Of back-propagation."""


def perceptron(x: Float[np.ndarray, "n i"], y: Values, seed: int, *, structure: Structure | None = None) -> Predict:
    """A perceptron with one hidden layer by Levenberg-Marquardt, the start that learns best.

    Args:
        x: Scaled inputs.
        y: Scaled values.
        seed: Seed of the first weights.
        structure: The network, and how it is trained; by default 7 nodes.

    Returns:
        The function that was learnt.
    """
    network, errors = train_perceptrons(x, y, structure or Structure(), seed)
    best = int(errors.argmin())

    def predict(at: Float[np.ndarray, "n i"]) -> Values:
        with torch.no_grad():
            return network.rows(torch.tensor(at))[best, :, 0].numpy()

    return predict


def back_propagation(x: Float[np.ndarray, "n i"], y: Values, seed: int, *, hidden: int = 7) -> Predict:
    """A perceptron by gradient descent with momentum on batches, the paper's usual method; rate falling to 0."""
    network = Perceptron((1, x.shape[1], hidden, 1), "sigmoid", "normal", SPREAD, seed=seed)
    inputs, targets = torch.tensor(x), torch.tensor(y)
    optimizer = torch.optim.SGD(network.parameters(), lr=RATE, momentum=MOMENTUM)
    falling = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.01, DESCENT_STEPS)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(DESCENT_STEPS):
        rows = torch.randint(len(x), (BATCH,), generator=generator)
        optimizer.zero_grad()
        (network(inputs[rows])[:, 0] - targets[rows]).square().mean().backward()
        optimizer.step()
        falling.step()
    return _of_tensor(lambda at: network(at)[:, 0])


def radial_basis(x: Float[np.ndarray, "n i"], y: Values, seed: int, *, hidden: int = 300) -> Predict:
    """Gaussian nodes: centres by k-means, widths and ridge by left-out records."""
    inputs, targets = without_repeats(torch.tensor(x), torch.tensor(y)[:, None])
    centres = k_means(inputs, min(hidden, len(inputs) // 2), seed=seed)
    distances = neighbour_distances(centres, NEIGHBOURS)
    fits = [ridge_by_press(gaussian_nodes(inputs, centres, f * distances), targets, RIDGES) for f in FACTORS]
    best = min(range(len(fits)), key=lambda k: fits[k].press)
    weights, widths = fits[best].weights, FACTORS[best] * distances
    return _of_tensor(lambda at: gaussian_nodes(at, centres, widths) @ weights[0, :-1] + weights[0, -1])


def general_regression(x: Float[np.ndarray, "n i"], y: Values, seed: int, *, common: bool = False) -> Predict:
    """A mean of records weighted by nearness, widths by left-out records."""
    del seed
    inputs, targets = without_repeats(torch.tensor(x), torch.tensor(y)[:, None])
    search = WidthSearch(inputs, targets, common=common)
    for _ in range(MAX_WIDTH_STEPS):
        search.step(1e-4)
        if search.stopped:
            break
    return _of_tensor(lambda at: kernel_mean(at, inputs, targets, search.widths)[:, 0])


def polynomial(x: Float[np.ndarray, "n i"], y: Values, seed: int) -> Predict:
    """A polynomial response surface; degree and ridge by left-out records."""
    del seed
    middle, half = (x.max(0) + x.min(0)) / 2, np.maximum((x.max(0) - x.min(0)) / 2, 1e-12)
    scaled, targets = without_repeats(torch.tensor((x - middle) / half), torch.tensor(y)[:, None])
    found = []
    for degree in DEGREES:
        terms = list(_terms(x.shape[1], degree))
        if degree > 1 and len(terms) > MAX_TERMS_PER_RECORD * len(scaled):
            break
        found.append((ridge_by_press(_products(scaled, terms), targets, RIDGES), terms))
    best, terms = min(found, key=lambda pair: pair[0].press)

    def predict(at: torch.Tensor) -> torch.Tensor:
        nodes = _products((at - torch.tensor(middle)) / torch.tensor(half), terms)
        return nodes @ best.weights[0, :-1] + best.weights[0, -1]

    return _of_tensor(predict)


def _of_tensor(function: Callable[[torch.Tensor], torch.Tensor]) -> Predict:
    """A function of arrays."""

    def predict(at: Float[np.ndarray, "n i"]) -> Values:
        with torch.no_grad():
            return function(torch.tensor(at)).numpy()

    return predict


def _terms(inputs: int, degree: int) -> Iterator[tuple[int, ...]]:
    """Which inputs each product is made of."""
    for order in range(1, degree + 1):
        yield from combinations_with_replacement(range(inputs), order)


def _products(x: torch.Tensor, terms: list[tuple[int, ...]]) -> torch.Tensor:
    """A column for each product; what is one factor longer is made of what was made before."""
    made: dict[tuple[int, ...], torch.Tensor] = {(): torch.ones_like(x[:, 0])}
    for term in terms:
        made[term] = made[term[:-1]] * x[:, term[-1]]
    return torch.stack([made[term] for term in terms], 1)


PAPERS = partial(perceptron, structure=Structure(7, "sigmoid"))
"""The paper's 5-7-1, by Levenberg-Marquardt."""
RECOMMENDED = partial(perceptron, structure=Structure(7, "tanh", bayesian=True))
"""What the tool recommends, with the inputs of :data:`~studies.cepowski2007.records.PHYSICAL`."""
