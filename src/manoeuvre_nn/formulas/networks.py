"""What each network is in closed form: scaled inputs to scaled outputs. A new network adds one function."""

from collections.abc import Sequence
from functools import singledispatch
from math import prod

import numpy as np
import sympy
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.formulas.program import Builder, added, at_least, logistic, median, product, ratio, smallest, times
from manoeuvre_nn.network import hull_rudder, series
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.ship.taylor import VARIABLES as TAYLOR_VARIABLES
from manoeuvre_nn.ship.taylor import TaylorForce

Values = Sequence[sympy.Expr]
ONE = sympy.Integer(1)
OUTPUTS = "XYN"
MAX_RECORDS = 1000
"""Stored records of a regression that are written out."""


@singledispatch
def closed_form(network: Network, x: Values, build: Builder) -> list[sympy.Expr]:
    """Write down what a network does with its inputs: its scaled outputs, as symbols of the program.

    A network of one's own is added by ``@closed_form.register`` on a function of these arguments.

    Args:
        network: The network.
        x: Its scaled inputs, as symbols of the program.
        build: What values are named with.

    Raises:
        InputError: If nobody has written it down.
    """
    raise InputError(
        f"a {type(network).__name__} has no closed form here: train another network (network=wang, rajesh, cubic, "
        "hull_rudder), or keep its checkpoint"
    )


@closed_form.register
def perceptrons(network: Perceptron, x: Values, build: Builder) -> list[sympy.Expr]:
    """``y_o = sum_h B_oh f(sum_i W_hi x_i + W_h,I+1) + B_o,H+1`` of every network.

    Returns:
        Outputs of all networks, one after the other.
    """
    first, last = numbers(network.input_weights), numbers(network.output_weights)
    count, hidden, outputs = len(first), first.shape[1], last.shape[1]
    squash, found = _logistic if network.activation == "sigmoid" else _tanh, []
    for k in range(count):
        build.section("Hidden nodes" if count == 1 else f"Hidden nodes of network {k + 1} of {count}")
        nodes = build.weighted(
            indexed("h", k, hidden, count), [*x, ONE], first[k], squash, symbols=latex_indexed("h", k, hidden, count)
        )
        build.section("What the network gives" if count == 1 else f"What network {k + 1} gives")
        names = indexed("y", k, outputs, count)
        found += build.weighted(names, [*nodes, ONE], last[k], symbols=latex_indexed("y", k, outputs, count))
    return found


@closed_form.register
def taylor_series(network: TaylorForce, x: Values, build: Builder) -> list[sympy.Expr]:
    """Polynomials in a, v, r, delta.

    Returns:
        X, Y, N.
    """
    build.section("Taylor series")
    return sums_of_products([taylor_product(t, x) for t in network.terms], numbers(network.coefficients).T, build, "y")


@closed_form.register
def series_of_products(network: Series, x: Values, build: Builder) -> list[sympy.Expr]:
    """Sums of products of velocities, rudder angle, shaft speed and wind: the estimate, without its draws.

    Returns:
        X, Y, N.
    """
    whole = len(x) == 7
    shaft = sympy.Float(float(network.shaft))
    pace = None
    if network.speed_law == "approach" and whole:  # velocities over the approach speed of the run itself
        pace = x[4]
        build.section("Velocities over the approach speed of the run")
        names = ("ua", "va", "ra", "wxa", "wya")
        moved = [build.let(n, z / pace) for n, z in zip(names, (*x[:3], *x[5:]), strict=True)]
        x = [*moved[:3], x[3], x[4], *moved[3:]]
    u, v, r, d = x[:4]
    n = (pace or x[4]) if whole else shaft
    wx, wy = x[5:] if whole else (-u, -v)
    build.section("Products")
    used = {token for term in network.terms for token in term.split()}
    table = {"1": ONE, "u": u, "v": v, "r": r, "d": d, "n": n / pace if pace is not None else n, "wx": wx, "wy": wy}
    table |= {"|v|": sympy.Abs(v), "|r|": sympy.Abs(r), "|d|": sympy.Abs(d)}
    if "a" in used:
        table["a"] = build.let("a", u - 1)
    if "|w|" in used:
        table["|w|"] = build.let("w", sympy.sqrt(wx**2 + wy**2))
    if "/U" in used:
        speed = build.let("U", at_least(sympy.sqrt(u**2 + v**2), series.MIN_SPEED_PRIME), r"{U}'")
        table["/U"] = 1 / speed
    products = [prod((table[token] for token in term.split()), start=ONE) for term in network.terms]
    found = sums_of_products(products, numbers(network.coefficients[0]), build, "y")
    if pace is None:
        return found
    return [build.let(f"z_{e}", pace**2 * y) for e, y in zip(OUTPUTS, found, strict=True)]


@closed_form.register
def ensemble(network: HullRudder, x: Values, build: Builder) -> list[sympy.Expr]:
    """Every member that answers, and the median of them.

    Returns:
        X, Y, N.
    """
    count = int(network.trained) or network.members
    z, factors, library = _seen(network, x, build)
    first, last = numbers(network.input_weights), numbers(network.output_weights)
    answers = [_member(network, k, (first[k], last[k]), (z, factors, library), build) for k in range(count)]
    if count == 1:
        return list(answers[0])
    build.section("Median of the members")
    return [build.let(f"y_{e}", median(*(one[o] for one in answers))) for o, e in enumerate(OUTPUTS)]


@closed_form.register
def radial_basis(network: RadialBasis, x: Values, build: Builder) -> list[sympy.Expr]:
    """``y_o = sum_h B_oh exp(-|x - c_h|^2 / (2 s_h^2)) + B_o,H+1``.

    Returns:
        Outputs.
    """
    build.section("Gaussian nodes")
    centres, last = numbers(network.centres), numbers(network.output_weights)
    factors = -0.5 / numbers(network.widths) ** 2
    nodes = build.weighted(indexed("h", 0, len(centres), 1), x, centres, _exponential, distance=True, factors=factors)
    build.section("What the network gives")
    return list(build.weighted(indexed("y", 0, len(last), 1), [*nodes, ONE], last))


@closed_form.register
def general_regression(network: GeneralRegression, x: Values, build: Builder) -> list[sympy.Expr]:
    """A mean of stored values, weighted by nearness; weights are over the largest, so that none is 0/0.

    Returns:
        Outputs.

    Raises:
        InputError: If there are too many records for a formula.
    """
    records, values = numbers(network.records), numbers(network.values)
    count = len(records)
    if count > MAX_RECORDS:
        raise InputError(
            f"a regression by {count} stored records has as many terms, more than {MAX_RECORDS}: use its checkpoint, "
            "or train network=mlp on the same records and export that"
        )
    build.section("Inputs over their smoothing widths")
    widths = numbers(network.widths)
    scaled = [build.let(f"z_{i + 1}", ratio(z, float(s))) for i, (z, s) in enumerate(zip(x, widths, strict=True))]
    build.section("Squared distances to the records, and weights")
    squares = build.weighted(indexed("q", 0, count, 1), scaled, records / widths, distance=True)
    nearest = build.let("qmin", smallest(*squares), r"{q}_{\min}")
    weights = build.each(indexed("w", 0, count, 1), squares, lambda q: _exponential(times(0.5, added([nearest, -q]))))
    build.section("What the network gives")
    (total,) = build.weighted(["w_s"], weights, np.ones((1, count)), symbols=[r"{w}_{\Sigma}"])
    sums = build.weighted(indexed("s", 0, values.shape[1], 1), weights, values.T)
    return [build.let(name, one / total) for name, one in zip(indexed("y", 0, len(sums), 1), sums, strict=True)]


def _seen(network: HullRudder, x: Values, build: Builder) -> tuple[Values, Values, tuple[Values, Values]]:
    """Features of the nodes, factors b of the outputs, and the library of surge and of sway and yaw."""
    u, v, r, d = x
    if network.speed_law == "approach":
        z, factors, always = list(x), [ONE], ([ONE, u, u**2] if network.symmetric else [ONE])
    else:
        build.section("Ratios to the forward speed")
        speed = build.let("s", at_least(u, hull_rudder.MIN_SPEED_PRIME))
        z = [build.let("vs", v / speed, "v_{s}"), build.let("rs", r / speed, "r_{s}"), d]
        n = sympy.Float(float(network.shaft))
        factors = [build.let("k_1", speed**2), build.let("k_2", speed * n), build.let("k_3", n**2)]
        always = factors
    more = [] if network.library == "none" else [value * factor for value in z[-3:] for factor in factors]
    if network.library == "quadratic":
        a, b = z[-3:-1]
        flow = [sympy.Abs(a) * a, sympy.Abs(a) * b, sympy.Abs(b) * a, sympy.Abs(b) * b]
        more += [value * factors[0] for value in flow]
    return z, factors, (always, [*always, *more])


def _member(
    network: HullRudder,
    k: int,
    weights: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "3 c"]],
    seen: tuple[Values, Values, tuple[Values, Values]],
    build: Builder,
) -> list[sympy.Expr]:
    """A member's X, Y, N: nodes, those of the mirrored ship, and sums."""
    (first, last), (z, factors, library), hidden, many = weights, seen, len(weights[0]), network.members
    build.section(f"Nodes of member {k + 1}")
    symbols = latex_indexed("h", k, hidden, many)
    nodes = build.weighted(indexed("h", k, hidden, many), [*z, ONE], first, _tanh, symbols=symbols)
    even = odd = nodes
    if network.symmetric:
        signs = (1, -1, -1, -1) if network.speed_law == "approach" else (-1, -1, -1)
        mirrored = [sign * value for sign, value in zip(signs, z, strict=True)]
        barred = [rf"\bar{{h}}{symbol[1:]}" for symbol in symbols]
        others = build.weighted(indexed("m", k, hidden, many), [*mirrored, ONE], first, _tanh, symbols=barred)
        even = [added([a, b]) for a, b in zip(nodes, others, strict=True)]
        odd = [added([a, -b]) for a, b in zip(nodes, others, strict=True)]
    build.section(f"Forces by member {k + 1}")
    pairs = list(zip(network.node.tolist(), network.factor.tolist(), strict=True))
    found: list[sympy.Expr] = []
    for names, columns, own in (("X", even, library[0]), ("YN", odd, library[1])):
        terms = [*(product(columns[h], factors[j]) for h, j in pairs), *own]
        rows = [OUTPUTS.index(e) for e in names]
        found += build.weighted(
            [f"y_{k + 1}_{e}" for e in names], terms, last[rows, : len(terms)],
            symbols=[f"y^{{({k + 1})}}_{{{e}}}" for e in names],
        )  # fmt: skip
    return found


def sums_of_products(
    products: Values, coefficients: Float[np.ndarray, "3 terms"], build: Builder, name: str
) -> list[sympy.Expr]:
    """``sum_k c_k product_k`` of X, Y and N, each with the products that it has.

    Args:
        products: All products.
        coefficients: A row each of X, Y, N; 0 where the product is not in it.
        build: What values are named with.
        name: What they are called, with X, Y, N behind it.

    Returns:
        X, Y, N.
    """
    found = []
    for e, row in zip(OUTPUTS, coefficients, strict=True):
        kept = np.flatnonzero(row).tolist()
        found += build.weighted([f"{name}_{e}"], [products[k] for k in kept], row[None, kept])
    return found


def taylor_product(term: str, motion: Values) -> sympy.Expr:
    """The bare product of a term of a Taylor series, such as ``vvr``; the empty one is 1."""
    return prod((motion[TAYLOR_VARIABLES.index(letter)] for letter in term), start=ONE)


def numbers(values: Tensor) -> np.ndarray:
    """A tensor's numbers in double precision."""
    return values.detach().double().cpu().numpy()


def indexed(name: str, k: int, count: int, many: int) -> list[str]:
    """``h_1``, ``h_2``, ...; with the number of the network before where there are many: ``h_2_1``."""
    return [f"{name}_{i + 1}" if many == 1 else f"{name}_{k + 1}_{i + 1}" for i in range(count)]


def latex_indexed(name: str, k: int, count: int, many: int) -> list[str]:
    """The same in LaTeX."""
    return [f"{name}_{{{i + 1}}}" if many == 1 else f"{name}^{{({k + 1})}}_{{{i + 1}}}" for i in range(count)]


def _tanh(total: sympy.Expr) -> sympy.Expr:
    return sympy.tanh(total, evaluate=False)


def _exponential(total: sympy.Expr) -> sympy.Expr:
    return sympy.exp(total, evaluate=False)


def _logistic(total: sympy.Expr) -> sympy.Expr:
    return logistic(total)
