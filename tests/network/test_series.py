"""Sums of products: by hand, mirrored, with members, at other speeds."""

import numpy as np
import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.series import VARIABLES, Series, SeriesSettings, parity


def series(seed: int = 0, **more):
    given = {"surge": ["u u", "n n", "d d n n"], "lateral": ["u v", "v |v|", "d u n", "n n", "v v r /U"]} | more
    return Series(SeriesSettings(**given), seed=seed)


def filled(**more):
    made = series(**more)
    values = torch.linspace(-1, 1, len(made.names), dtype=torch.float64)
    made.take(values, 0.01 * torch.eye(len(values), dtype=torch.float64))
    return made


def test_products_are_those_of_their_letters():
    x = torch.tensor([[0.8, -0.2, 0.5, 0.3, 1.1, 2.0, -1.5]], dtype=torch.float64)
    u, v, r, d, n, wx, wy = x[0]
    by_hand = [1, u, v, r, d, n, u - 1, abs(v), abs(r), abs(d), wx, wy, torch.hypot(wx, wy), 1 / torch.hypot(u, v)]
    made = Series(SeriesSettings(surge=[], lateral=list(VARIABLES)))
    np.testing.assert_allclose(made.products(x)[0], [float(b) for b in by_hand])
    assert float(series().products(x)[0, series().terms.index("v v r /U")]) == pytest.approx(
        float(v * v * r / torch.hypot(u, v))
    )


def test_sway_turning_rudder_and_the_wind_from_the_side_change_their_signs_in_the_mirror():
    x = torch.tensor([[0.8, -0.2, 0.5, 0.3, 1.1, 2.0, -1.5]], dtype=torch.float64)
    made = Series(SeriesSettings(surge=[], lateral=list(VARIABLES), symmetric=False))
    mirrored = made.products(x * torch.tensor([1.0, -1, -1, -1, 1, 1, -1]))
    signs = torch.tensor([[parity(term) for term in made.terms]])
    np.testing.assert_allclose(mirrored, made.products(x) * signs)


def test_forces_are_sums_of_coefficients_times_products():
    made, x = filled(), torch.rand(5, 4, dtype=torch.float64)
    products = dict(zip(made.terms, made.products(x).T, strict=True))
    total = torch.zeros(5, 3, dtype=torch.float64)
    for (output, term), value in zip(made.names, made.coefficients[0][made.used], strict=True):
        total[:, output] += value * products[term]
    np.testing.assert_allclose(made(x).detach(), total.detach())


def test_a_symmetric_ship_turns_to_port_as_it_does_to_starboard():
    made, x = filled(symmetric=True), torch.rand(6, 4, dtype=torch.float64)
    mirrored = x * torch.tensor([1.0, -1, -1, -1])
    np.testing.assert_allclose(made(mirrored).detach(), (made(x) * torch.tensor([1.0, -1, -1])).detach())
    assert all(parity(t) < 0 for o, t in made.names if o > 0)
    assert any(parity(t) > 0 for o, t in series().names if o > 0)


def test_products_of_yaw_turn_a_ship_and_do_not_push_her_aside():
    made = series(yaw=["1", "n n"])
    names = [name for name in made.names if name not in series().names]
    assert names == [(2, "1")]
    made.coefficients.data[:, made.used] = torch.tensor([float(name == (2, "1")) for name in made.names]).double()
    x = torch.rand(4, 4, dtype=torch.float64)
    np.testing.assert_allclose(made(x).detach(), np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert (2, "1") not in series(yaw=["1"], symmetric=True).names


def test_the_estimate_answers_and_members_scatter_as_their_covariance_says():
    made = series(members=400, seed=3)
    count = len(made.names)
    root = torch.tril(torch.rand(count, count, dtype=torch.float64))
    made.take(torch.zeros(count, dtype=torch.float64), root @ root.T)
    drawn = made.coefficients[1:][:, made.used].detach()
    np.testing.assert_allclose(np.cov(drawn.numpy().T), root @ root.T, atol=0.25 * float((root @ root.T).max()))
    assert not made(torch.rand(3, 4, dtype=torch.float64)).any()
    x, rows = torch.rand(2, 4, dtype=torch.float64), torch.tensor([5, 7])
    alone = [made.products(x[k]) @ made.coefficients[row].T for k, row in enumerate(rows)]
    np.testing.assert_allclose(made.of(x, rows).detach(), torch.stack(alone).detach())


def test_how_well_coefficients_are_known_is_told_after_a_fit():
    """The forces of all standard errors together have the variance that the covariance says: 0.01 of each product."""
    x = torch.rand(5, 4, dtype=torch.float64)
    assert series().sensitivities(x).shape == (5, 0, 3)
    made = filled()
    by_hand = torch.zeros(5, 3, dtype=torch.float64)
    for output, term in made.names:
        by_hand[:, output] += 0.01 * made.products(x)[:, made.terms.index(term)].square()
    np.testing.assert_allclose(made.sensitivities(x).square().sum(dim=1).detach(), by_hand)


def test_without_the_shaft_speed_forces_scale_with_the_square_of_the_approach():
    made = filled(surge=["a", "a a"], lateral=["v", "r", "a d"])
    assert made.speed_law == "approach"
    x = torch.tensor([[0.9, 0.1, 0.3, 0.2]], dtype=torch.float64)
    still = torch.zeros(1, 2, dtype=torch.float64)
    slow = torch.cat([x * torch.tensor([0.5, 0.5, 0.5, 1.0]), torch.full((1, 1), 0.5, dtype=torch.float64), still], 1)
    np.testing.assert_allclose(made(slow).detach(), 0.25 * made(x).detach())


def test_what_is_no_product_is_refused():
    with pytest.raises(InputError, match="variable of the product 'u q'"):
        series(lateral=["u q"])
    with pytest.raises(InputError, match="'v u', which changes sign"):
        series(surge=["v u"])
    with pytest.raises(InputError, match=r"network\.members=0"):
        series(members=0)
