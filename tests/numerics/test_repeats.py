import torch

from manoeuvre_nn.numerics.repeats import without_repeats


def test_records_with_the_same_inputs_become_one_with_their_mean_value():
    x = torch.tensor([[2.0, 0.0], [1.0, 5.0], [2.0, 1e-14], [2.0, 0.0], [0.0, 0.0]], dtype=torch.float64)
    y = torch.tensor([[1.0], [7.0], [2.0], [6.0], [9.0]], dtype=torch.float64)
    inputs, values = without_repeats(x, y)
    assert inputs.tolist() == [[2.0, 0.0], [1.0, 5.0], [0.0, 0.0]]
    assert values.tolist() == [[3.0], [7.0], [9.0]]


def test_records_that_all_differ_stay_as_they_are():
    x = torch.rand(50, 3, dtype=torch.float64)
    inputs, values = without_repeats(x, x[:, :1])
    assert torch.equal(inputs, x)
    assert torch.equal(values, x[:, :1])
