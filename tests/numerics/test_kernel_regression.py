import pytest
import torch

from manoeuvre_nn.numerics.kernel_regression import WidthSearch, first_widths, kernel_mean, leave_one_out_error


def records(count: int = 60, inputs: int = 2, seed: int = 0):
    generator = torch.Generator().manual_seed(seed)
    x = torch.rand(count, inputs, generator=generator, dtype=torch.float64)
    y = torch.stack([torch.sin(6 * x[:, 0]), x[:, 0] ** 2], 1)
    return x, y


def test_narrow_kernels_give_the_nearest_record_even_far_from_all():
    x, y = records()
    where = torch.tensor([[0.3, 0.4], [0.9, 0.1], [50.0, -70.0]], dtype=torch.float64)
    nearest = torch.cdist(where, x).argmin(1)
    assert torch.equal(kernel_mean(where, x, y, torch.full((2,), 1e-6, dtype=torch.float64)), y[nearest])


def test_wide_kernels_give_the_mean():
    x, y = records()
    found = kernel_mean(x[:3], x, y, torch.full((2,), 1e6, dtype=torch.float64))
    torch.testing.assert_close(found, y.mean(0).expand(3, -1))


def test_the_formula_is_spechts():
    x, y = records(5)
    at, widths = torch.tensor([[0.2, 0.6]], dtype=torch.float64), torch.tensor([0.3, 0.2], dtype=torch.float64)
    weights = torch.exp(-0.5 * (((at - x) / widths) ** 2).sum(1))
    torch.testing.assert_close(kernel_mean(at, x, y, widths)[0], (weights[:, None] * y).sum(0) / weights.sum())


def test_the_order_of_the_records_is_of_no_account():
    x, y = records()
    order = torch.randperm(len(x), generator=torch.Generator().manual_seed(1))
    widths = torch.tensor([0.1, 0.2], dtype=torch.float64)
    at = torch.rand(4, 2, dtype=torch.float64)
    torch.testing.assert_close(kernel_mean(at, x, y, widths), kernel_mean(at, x[order], y[order], widths))
    torch.testing.assert_close(leave_one_out_error(x, y, widths), leave_one_out_error(x[order], y[order], widths))


def test_leave_one_out_is_the_error_without_the_record():
    x, y = records(20)
    widths = torch.tensor([0.2, 0.3], dtype=torch.float64)
    wrong = []
    for k in range(len(x)):
        kept = torch.arange(len(x)) != k
        wrong.append(kernel_mean(x[[k]], x[kept], y[kept], widths)[0] - y[k])
    torch.testing.assert_close(leave_one_out_error(x, y, widths), torch.stack(wrong).square().mean())


def test_an_input_without_effect_gets_a_wide_kernel_and_the_error_falls():
    x, y = records(200)
    begun = float(leave_one_out_error(x, y, first_widths(x)))
    search = WidthSearch(x, y)
    for _ in range(60):
        search.step()
        if search.stopped:
            break
    assert search.stopped
    assert search.error < 0.2 * begun
    assert search.widths[1] > 10 * search.widths[0]
    assert search.error == pytest.approx(float(leave_one_out_error(x, y, search.widths)))


def test_a_common_width_is_common_and_no_better():
    x, y = records(200)
    own, common = WidthSearch(x, y), WidthSearch(x, y, common=True)
    for _ in range(40):
        own.step()
        common.step()
    assert common.widths[0] == common.widths[1]
    assert own.error < common.error


def test_an_input_that_does_not_vary_is_no_obstacle():
    x, y = records()
    x[:, 1] = 0.5
    assert first_widths(x)[1] == 1.0
    assert WidthSearch(x, y).step() < float(y.var(0, correction=0).mean())


def test_a_search_that_is_taken_up_goes_the_same_way():
    x, y = records(200)
    whole = WidthSearch(x, y)
    for _ in range(3):
        whole.step(0.0)
    second = WidthSearch(x, y)
    second.load_state_dict(whole.state_dict())
    assert torch.equal(second.widths, whole.widths) and second.error == whole.error
    for _ in range(4):
        assert second.step(0.0) == whole.step(0.0)
    assert torch.equal(second.widths, whole.widths)
