"""The ways to a Jacobian: reverse and forward mode, blocks that never hold it whole, and the network's own formula."""

import pytest
import torch
from fleet import unchecked
from levenberg import lm
from torch.nn import Linear, Parameter, Sequential, Tanh

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.levenberg_marquardt import LevenbergMarquardt


def stepped(count: int, analytic: bool = False, blocks: int = 0, **options) -> tuple[torch.Tensor, LevenbergMarquardt]:
    """Weights after three epochs on ``count`` tuples."""
    network = Perceptron((3, 4, 5, 1), initial="symmetric", seed=6)
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(count, 4, generator=generator, dtype=torch.float64)
    y = torch.sin(x[:, :3].T * 2)
    if analytic:
        jacobian = network.jacobian
        options["jacobian"] = lambda: jacobian(x).split(blocks, dim=1) if blocks else jacobian(x)
    optimizer = lm(network.parameters(), rows=3, mu=0.1, **options)
    with unchecked():
        for _ in range(3):
            optimizer.step(lambda: network.rows(x)[..., 0] - y)
    return torch.cat([p.detach().reshape(3, -1) for p in network.parameters()], 1), optimizer


def autograd_blocks(count: int, max_elements: float = 2e7) -> tuple[list[str], list[torch.Tensor], torch.Tensor]:
    """Which ways were taken, the blocks they gave and the whole by formula; 31 parameters in each of three rows."""
    network = Perceptron((3, 4, 5, 1), initial="symmetric", seed=6)
    x = torch.linspace(-2, 2, count * 4, dtype=torch.float64).reshape(count, 4).sin()
    optimizer = lm(network.parameters(), rows=3, max_elements=max_elements)
    taken: list[str] = []
    for way in ("_reverse_blocks", "_forward_block"):
        original = getattr(optimizer, way)
        setattr(optimizer, way, lambda *a, way=way, original=original: (taken.append(way), original(*a))[1])
    blocks = list(optimizer._autograd_blocks(network.rows(x)[..., 0]))
    return taken, blocks, network.jacobian(x)


@pytest.mark.parametrize(
    ("count", "max_elements", "way"),
    [
        (20, 2e7, "_reverse_blocks"),  # fewer residuals than parameters
        (70, 2e7, "_forward_block"),  # more
        (70, 6510.0, "_forward_block"),  # the same, a few tangents at a time
        (70, 6509.0, "_reverse_blocks"),  # too large to be built whole
        (70, 1.0, "_reverse_blocks"),  # one residual at a time
    ],
)
def test_every_way_gives_the_same_jacobian(count, max_elements, way):
    taken, blocks, expected = autograd_blocks(count, max_elements)
    assert taken == [way]
    torch.testing.assert_close(torch.cat(blocks, 1), expected, rtol=1e-11, atol=1e-13)


def test_a_large_jacobian_is_never_built_whole():
    for limit in (6000.0, 2000.0):
        _, blocks, whole = autograd_blocks(70, limit)
        assert whole.numel() > limit
        assert len(blocks) > 1 and max(block.numel() for block in blocks) <= limit


@pytest.mark.parametrize("count", [20, 70])
def test_the_fit_does_not_depend_on_the_way_to_the_jacobian(count):
    expected, _ = stepped(count)
    ways = [{"max_elements": 1e3}, {"analytic": True}, {"analytic": True, "blocks": 6}, {"analytic": True, "blocks": 1}]
    for way in ways:
        torch.testing.assert_close(stepped(count, **way)[0], expected, rtol=1e-8, atol=1e-9)


def test_tries_of_a_step_cost_residuals_only():
    network = Perceptron((1, 2, 3, 1), initial="symmetric", seed=1)
    x = torch.randn(30, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    asked, tried = [], []

    def jacobian() -> torch.Tensor:
        asked.append(1)
        return network.jacobian(x)[0]

    def closure() -> torch.Tensor:
        tried.append(torch.is_grad_enabled())
        return network(x)[:, 0] - x.prod(1)

    optimizer = lm(network.parameters(), jacobian=jacobian)
    for _ in range(6):
        optimizer.step(closure)
    assert len(asked) == 6 < len(tried) == optimizer.evaluations
    assert not any(tried)


@pytest.mark.parametrize("count", [3, 40])
def test_any_module_and_a_parameter_that_is_not_used_will_do(count):
    torch.manual_seed(0)
    model = Sequential(Linear(2, 4), Tanh(), Linear(4, 1)).double()
    idle = Parameter(torch.full((2,), 3.0, dtype=torch.float64))
    x = torch.randn(count, 2, dtype=torch.float64)
    y = x.prod(1, keepdim=True)
    optimizer = lm([idle, *model.parameters()])
    with unchecked():
        first = float(optimizer.step(lambda: model(x) - y))
        for _ in range(30):
            last = float(optimizer.step(lambda: model(x) - y))
    assert last < 1e-2 * first
    assert torch.equal(idle.detach(), torch.full((2,), 3.0, dtype=torch.float64))


def test_a_jacobian_of_other_residuals_is_refused():
    w = Parameter(torch.zeros(2, dtype=torch.float64))
    blocks = [torch.ones(2, 2, dtype=torch.float64)]
    optimizer = lm([w], jacobian=lambda: blocks)
    with pytest.raises(InputError, match="Jacobian of 2 residuals: the closure gives 3"):
        optimizer.step(lambda: w.sum() - torch.arange(3, dtype=torch.float64))
