"""Profiles of semi-linear networks against designs written out column by column, autograd and the special case."""

import numpy as np
import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.numerics.semilinear import SemiLinear
from studies.rajesh2009.separable import Separable

SAMPLES, HIDDEN, OUTPUTS = 47, 4, 4
MIRROR = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
PARITY = torch.tensor([1.0, -1.0, -1.0, 0.0], dtype=torch.float64)
"""The second and the third output share a design; the last one sees one side alone."""
SEES = torch.ones(HIDDEN, 4, dtype=torch.bool)
SEES[::2, 2] = False
NODE, FACTOR = torch.tensor([0, 1, 1, 2, 3, 3]), torch.tensor([0, 0, 1, 0, 0, 2])


def drawn(*shape: int, seed: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def parts(**other) -> dict:
    """Everything that a problem is made of."""
    z, factors = drawn(SAMPLES, 3, seed=1), 1 + 0.4 * drawn(3, SAMPLES, seed=2)
    library = torch.zeros(OUTPUTS, 2, SAMPLES, dtype=torch.float64)
    library[:, 0] = 1.0
    library[1:3, 1] = z[:, 1] * factors[1]
    library[3, 1] = z[:, 0]
    named = {"mirror": MIRROR, "parity": PARITY, "factors": factors, "node": NODE, "factor": FACTOR, "library": library}
    return {"z": z, "y": drawn(SAMPLES, OUTPUTS, seed=3), "sees": SEES} | named | other


def weights(rows: int = 1, seed: int = 4, sees: torch.Tensor = SEES) -> torch.Tensor:
    return drawn(rows, int(sees.sum()), seed=seed)


def design(p: dict, output: int, whole: torch.Tensor) -> torch.Tensor:
    """Columns of an output, one after the other, for one row's weights (H, W)."""
    columns = []
    for h, j in zip(p["node"], p["factor"], strict=True):  # torch 2.6 makes no lists of these within jacfwd
        side = torch.tanh(p["z"] @ whole[h, :-1] + whole[h, -1])
        other = torch.tanh((p["z"] * p["mirror"]) @ whole[h, :-1] + whole[h, -1])
        columns.append(p["factors"][j] * (side + p["parity"][output] * other))
    return torch.stack([*columns, *p["library"][output]], 1)


def least_squares(p: dict, output: int, whole: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Least-norm coefficients and errors of an output, by numpy."""
    columns, y = design(p, output, whole).numpy(), p["y"][:, output].numpy()
    best = np.linalg.lstsq(columns, y, rcond=1e-12)[0]
    return best, columns @ best - y


def test_the_error_is_that_of_plain_least_squares_output_by_output():
    p, w = parts(), weights(3)
    problem = SemiLinear(**p)
    mse, _ = problem.evaluate(w)
    for row, whole in enumerate(problem.full(w)):
        errors = [least_squares(p, o, whole)[1] for o in range(OUTPUTS)]
        assert float(mse[row]) == pytest.approx(np.mean(np.square(errors)), rel=1e-10)
    assert problem.residuals == SAMPLES * OUTPUTS


def test_the_best_coefficients_are_those_of_plain_least_squares_and_none_where_the_library_has_none():
    p, w = parts(), weights(2)
    problem = SemiLinear(**p)
    for whole, found in zip(problem.full(w), problem.output_weights(w).numpy(), strict=True):
        for o in range(OUTPUTS):
            np.testing.assert_allclose(found[o], least_squares(p, o, whole)[0], rtol=1e-7, atol=1e-9)
        assert found[0, -1] == 0.0 and np.abs(found[1:, -1]).min() > 1e-3


def among_zeros(free: torch.Tensor, sees: torch.Tensor) -> torch.Tensor:
    return torch.zeros(sees.shape, dtype=torch.float64).index_put(sees.nonzero(as_tuple=True), free)


def profile(p: dict, free: torch.Tensor) -> torch.Tensor:
    """Sum of squares that the best coefficients leave, by normal equations; differentiable."""
    whole = among_zeros(free, p["sees"])
    total = free.new_zeros(())
    for o in range(p["y"].shape[1]):
        a = design(p, o, whole)
        a = a[:, a.detach().abs().amax(0) > 0]
        best = torch.linalg.solve(a.T @ a, a.T @ p["y"][:, o])
        total = total + (a @ best - p["y"][:, o]).square().sum()
    return total


@pytest.mark.parametrize("parity", [(1, -1, -1, 0), (0, 0, 0, 0), (1, 1, 1, 1), (-1, 0, 1, -1)])
def test_the_gradient_is_half_of_autograds_through_the_whole_solution(parity):
    p, w = parts(parity=torch.tensor(parity, dtype=torch.float64)), weights()
    problem = SemiLinear(**p)
    _, gradient = problem.linearise(w, problem.evaluate(w)[1])
    free = w[0].clone().requires_grad_()
    (expected,) = torch.autograd.grad(profile(p, free), free)
    torch.testing.assert_close(gradient[0], expected / 2, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("parity", [(1, -1, -1, 0), (0, 0, 0, 0)])
def test_the_products_are_kaufmans_with_the_projection_built_in_full(parity):
    p, w = parts(parity=torch.tensor(parity, dtype=torch.float64)), weights()
    problem = SemiLinear(**p)
    normal, gradient = problem.linearise(w, problem.evaluate(w)[1])
    expected, slope = np.zeros((problem.parameters,) * 2), np.zeros(problem.parameters)
    for o in range(OUTPUTS):

        def columns(free, o=o):
            return design(
                p, o, torch.zeros(SEES.shape, dtype=torch.float64).index_put(SEES.nonzero(as_tuple=True), free)
            )

        a = columns(w[0]).numpy()
        slopes = torch.func.jacfwd(columns)(w[0]).numpy()  # N, C, P
        best, errors = least_squares(p, o, problem.full(w)[0])
        jacobian = (np.eye(SAMPLES) - a @ np.linalg.pinv(a, rcond=1e-12)) @ np.einsum("ncp,c->np", slopes, best)
        expected += jacobian.T @ jacobian
        slope += jacobian.T @ errors
    np.testing.assert_allclose(normal[0], expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(gradient[0], slope, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid"])
def test_without_sides_factors_masks_and_library_it_is_the_separable_perceptron(activation):
    one = torch.ones(1, SAMPLES, dtype=torch.float64)
    sees = torch.ones_like(SEES)
    p = parts(sees=sees, parity=torch.zeros(OUTPUTS, dtype=torch.float64), factors=one)
    p |= {"node": torch.arange(HIDDEN), "factor": torch.zeros(HIDDEN, dtype=torch.long)}
    ours = SemiLinear(**p | {"library": one.expand(OUTPUTS, 1, -1)}, activation=activation)
    plain, w = Separable(p["z"], p["y"], HIDDEN, activation=activation), weights(2, sees=sees)
    mse, carry = ours.evaluate(w)
    expected, expected_carry = plain.evaluate(w)
    torch.testing.assert_close(mse, expected, rtol=1e-12, atol=0)
    both = zip(ours.linearise(w, carry), plain.linearise(w, expected_carry), strict=True)
    for found, other in both:
        torch.testing.assert_close(found, other, rtol=1e-9, atol=1e-10)
    torch.testing.assert_close(ours.output_weights(w), plain.output_weights(w), rtol=1e-9, atol=1e-10)


def test_what_a_node_does_not_see_counts_no_more_than_a_weight_of_zero():
    w = weights(2)
    masked = SemiLinear(**parts())
    whole = masked.full(w)
    assert whole[:, ::2, 2].abs().max() == 0 and masked.parameters == w.shape[1] == int(SEES.sum())
    assert torch.equal(whole[:, SEES], w)
    seeing = SemiLinear(**parts(sees=torch.ones_like(SEES)))
    mse, carry = seeing.evaluate(whole.flatten(1))
    normal, gradient = seeing.linearise(whole.flatten(1), carry)
    free = SEES.flatten()
    mine, own = masked.evaluate(w)
    torch.testing.assert_close(mine, mse, rtol=1e-14, atol=0)
    for found, expected in zip(masked.linearise(w, own), (normal[:, free][:, :, free], gradient[:, free]), strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-13)
    assert gradient[:, ~free].abs().min() > 1e-6, "what is left out would have counted"


def test_outputs_that_share_a_design_add_up_as_if_each_was_alone():
    p, w = parts(), weights(2)

    def sums(chosen: list[int]) -> list[torch.Tensor]:
        problem = SemiLinear(**p | {name: p[name][chosen] for name in ("parity", "library")} | {"y": p["y"][:, chosen]})
        mse, carry = problem.evaluate(w)
        return [mse * problem.residuals, *problem.linearise(w, carry), problem.output_weights(w)]

    alone, together = [sums([o]) for o in range(OUTPUTS)], sums(list(range(OUTPUTS)))
    for k in range(3):
        torch.testing.assert_close(together[k], sum(one[k] for one in alone), rtol=1e-11, atol=1e-11)
    torch.testing.assert_close(together[3], torch.cat([one[3] for one in alone], 1), rtol=1e-9, atol=1e-10)


def test_outputs_of_one_parity_with_other_libraries_do_not_share_a_design():
    p, w = parts(parity=torch.ones(OUTPUTS, dtype=torch.float64)), weights()
    assert not torch.equal(p["library"][0], p["library"][1])
    problem = SemiLinear(**p)
    errors = [least_squares(p, o, problem.full(w)[0])[1] for o in range(OUTPUTS)]
    assert float(problem.evaluate(w)[0]) == pytest.approx(np.mean(np.square(errors)), rel=1e-10)


def test_mirrored_data_of_mirrored_forces_are_the_same_problem():
    sides = {"parity": PARITY[:3], "library": parts()["library"][:3], "y": parts()["y"][:, :3]}
    p, w = parts(**sides), weights(2)
    mirrored = p | {"z": p["z"] * MIRROR, "y": p["y"] * PARITY[:3], "library": p["library"] * PARITY[:3, None, None]}
    left, right = SemiLinear(**p), SemiLinear(**mirrored)
    (mse, carry), (other, other_carry) = left.evaluate(w), right.evaluate(w)
    torch.testing.assert_close(mse, other, rtol=1e-12, atol=0)
    for a, b in zip(left.linearise(w, carry), right.linearise(w, other_carry), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-10, atol=1e-10)


def test_rows_do_not_know_of_each_other():
    problem, w = SemiLinear(**parts()), weights(5)
    mse, carry = problem.evaluate(w)
    results = [mse, *problem.linearise(w, carry), problem.output_weights(w)]
    for k in range(5):
        own, own_carry = problem.evaluate(w[k : k + 1])
        alone = [own, *problem.linearise(w[k : k + 1], own_carry), problem.output_weights(w[k : k + 1])]
        for together, one in zip(results, alone, strict=True):
            torch.testing.assert_close(together[k : k + 1], one, rtol=1e-10, atol=1e-11)


def test_many_starts_end_where_each_ends_alone():
    problem, w = SemiLinear(**parts()), weights(4)
    together = minimise(problem, w, stops=Stops(epochs=6))
    for k in range(4):
        alone = minimise(problem, w[k : k + 1], stops=Stops(epochs=6))
        torch.testing.assert_close(together.weights[k : k + 1], alone.weights, rtol=1e-6, atol=1e-7)
    assert (together.mse < problem.evaluate(w)[0]).all()


def test_a_teacher_of_the_same_form_is_found_again():
    p, true = parts(), weights(seed=9)
    whole = SemiLinear(**p).full(true)[0]
    strengths = 0.1 * drawn(OUTPUTS, len(NODE) + 2, seed=10)  # the ridge below leaves 1e-20 of their squares
    p["y"] = torch.stack([design(p, o, whole) @ strengths[o] for o in range(OUTPUTS)], 1)
    problem = SemiLinear(**p)
    start = true + 0.2 * torch.cos(torch.arange(true.shape[1], dtype=torch.float64))
    assert float(problem.evaluate(start)[0]) > 1e-6
    found = minimise(problem, start, stops=Stops(epochs=100))
    assert float(found.mse) < 1e-20
    torch.testing.assert_close(found.weights, true, rtol=1e-6, atol=1e-7)
    expected = strengths.clone()
    expected[0, -1] = 0.0  # the library holds nothing there
    torch.testing.assert_close(problem.output_weights(found.weights)[0], expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_nodes_that_saturate_or_run_together_leave_everything_finite(dtype):
    p = {k: v.to(dtype) if v.is_floating_point() else v for k, v in parts(sees=torch.ones_like(SEES)).items()}
    problem = SemiLinear(**p)
    w = weights(2, sees=p["sees"]).to(dtype)
    w[0, :4] = torch.tensor([0.0, 0.0, 0.0, 50.0], dtype=dtype)  # 1 on both sides, as the library has it
    w[0, 8:12] = w[0, 12:16]  # the same node twice
    w[1] = 0.0  # no node at all
    mse, carry = problem.evaluate(w)
    assert all(part.isfinite().all() for part in (mse, *problem.linearise(w, carry), problem.output_weights(w)))
    found = minimise(problem, w, stops=Stops(epochs=10))
    assert found.weights.isfinite().all() and found.mse.dtype == dtype
    assert float(found.mse[0]) < float(mse[0])


def test_a_rank_that_is_lost_does_not_change_the_error_of_plain_least_squares():
    p = parts(sees=torch.ones_like(SEES))
    w = weights(sees=p["sees"])
    w[0, 8:12] = w[0, 12:16]
    problem = SemiLinear(**p)
    errors = [least_squares(p, o, problem.full(w)[0])[1] for o in range(OUTPUTS)]
    assert float(problem.evaluate(w)[0]) == pytest.approx(np.mean(np.square(errors)), rel=1e-6)


def shrunk(p: dict, output: int, whole: torch.Tensor, size: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Normal equations with ``N size^2`` added for the nodes: coefficients, and errors with the ridge."""
    a, y = design(p, output, whole), p["y"][:, output]
    a = a[:, a.detach().abs().amax(0) > 0]
    rows = size * SAMPLES**0.5 * torch.eye(a.shape[1], dtype=a.dtype)[: len(NODE)]
    best = torch.linalg.solve(a.T @ a + rows.T @ rows, a.T @ y)
    return best, torch.cat([a @ best - y, rows @ best])


def test_a_ridge_on_the_nodes_leaves_to_the_library_what_it_can_say():
    p, w, size = parts(), weights(), 0.3
    problem = SemiLinear(**p, shrink=size)
    mse, carry = problem.evaluate(w)
    found = problem.output_weights(w)[0]
    errors = []
    for o in range(OUTPUTS):
        best, wrong = shrunk(p, o, problem.full(w)[0], size)
        torch.testing.assert_close(found[o, : len(best)], best, rtol=1e-7, atol=1e-9)
        errors.append(wrong)
    assert float(mse) == pytest.approx(float(torch.cat(errors).square().sum()) / problem.residuals, rel=1e-9)
    free = w[0].clone().requires_grad_()
    total = sum(shrunk(p, o, among_zeros(free, SEES), size)[1].square().sum() for o in range(OUTPUTS))
    (expected,) = torch.autograd.grad(total, free)
    torch.testing.assert_close(problem.linearise(w, carry)[1][0], expected / 2, rtol=1e-7, atol=1e-9)


def test_a_ridge_beyond_bounds_leaves_the_library_alone():
    p, w = parts(), weights()
    found = SemiLinear(**p, shrink=1e6).output_weights(w)[0]
    for o in range(OUTPUTS):
        library = p["library"][o].T.numpy()
        alone = np.linalg.lstsq(library, p["y"][:, o].numpy(), rcond=1e-12)[0]
        np.testing.assert_allclose(found[o, len(NODE) :], alone, rtol=1e-6, atol=1e-9)
    assert found[:, : len(NODE)].abs().max() < 1e-9


def test_an_activation_that_is_none_is_refused():
    with pytest.raises(InputError, match="network.activation 'relu' is unknown; choose one of: sigmoid, tanh"):
        SemiLinear(**parts(), activation="relu")


def test_shrunk_nodes_are_ridge_regression_beside_a_free_library():
    p, w, shrink = parts(), weights(1), 0.3
    found = SemiLinear(**p, shrink=shrink).output_weights(w)[0].numpy()
    whole = SemiLinear(**p).full(w)[0]
    for o in range(1, OUTPUTS):
        a, y = design(p, o, whole).numpy(), p["y"][:, o].numpy()
        ridge = np.diag([SAMPLES * shrink**2] * len(NODE) + [0.0] * 2)
        np.testing.assert_allclose(found[o], np.linalg.solve(a.T @ a + ridge, a.T @ y), rtol=1e-6)
    far = SemiLinear(**p, shrink=1e6).output_weights(w)[0].numpy()
    library = p["library"][1].numpy().T
    np.testing.assert_allclose(far[1, len(NODE) :], np.linalg.lstsq(library, p["y"][:, 1].numpy())[0], rtol=1e-6)
    assert np.abs(far[:, : len(NODE)]).max() < 1e-6
