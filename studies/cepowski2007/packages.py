"""Rivals of other packages: trees and Gaussian processes of scikit-learn, formulas of pyoperon.

Functions as in :mod:`studies.cepowski2007.learners`.
"""

from importlib.util import find_spec

import numpy as np
from jaxtyping import Float

from studies.cepowski2007.learners import Predict, Values

MAX_FOR_KERNEL = 400
"""Records that a Gaussian process chooses its kernel by; it learns from all."""


def boosted_trees(x: Float[np.ndarray, "n i"], y: Values, seed: int) -> Predict:
    """Gradient-boosted trees of scikit-learn."""
    from sklearn.ensemble import HistGradientBoostingRegressor  # noqa: PLC0415  optional: see has_scikit_learn

    leaf = 5 if len(x) < 200 else 20  # the usual 20 records would be a tenth of them
    made = HistGradientBoostingRegressor(
        max_iter=1000, learning_rate=0.05, min_samples_leaf=leaf, l2_regularization=1e-3, random_state=seed
    )
    return made.fit(x, y).predict


def gaussian_process(x: Float[np.ndarray, "n i"], y: Values, seed: int) -> Predict:
    """A Gaussian process of scikit-learn, a length for every input, the kernel by the likelihood of some records."""
    from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415  likewise
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel  # noqa: PLC0415

    kernel = ConstantKernel(10.0) * RBF(np.full(x.shape[1], 2.0), (0.05, 1e3)) + WhiteKernel(1e-4, (1e-12, 1.0))
    some = np.random.default_rng(seed).permutation(len(x))[:MAX_FOR_KERNEL]
    chosen = GaussianProcessRegressor(kernel, random_state=seed).fit(x[some], y[some])
    return GaussianProcessRegressor(chosen.kernel_, optimizer=None).fit(x, y).predict


def symbolic_regression(x: Float[np.ndarray, "n i"], y: Values, seed: int, *, length: int = 50) -> Predict:
    """A formula found by genetic programming, of at most this many symbols, by pyoperon."""
    from pyoperon.sklearn import SymbolicRegressor  # noqa: PLC0415  optional: see has_symbolic_regression

    made = SymbolicRegressor(
        allowed_symbols="add,sub,mul,div,constant,variable,exp,sin,cos,sqrt,tanh,square", max_length=length,
        generations=1000, population_size=500, pool_size=500, max_evaluations=500_000, optimizer_iterations=5,
        n_threads=1, random_state=seed,
    )  # fmt: skip
    return made.fit(x, y).predict


def has_scikit_learn() -> bool:
    """Whether scikit-learn is installed."""
    return find_spec("sklearn") is not None


def has_symbolic_regression() -> bool:
    """Whether pyoperon is installed."""
    return find_spec("pyoperon") is not None
