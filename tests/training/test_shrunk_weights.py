import pytest
import torch
from small_response import X, Y, error_elsewhere, response, trained

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.network.radial import RadialBasis
from manoeuvre_nn.numerics.damping import Damping
from manoeuvre_nn.numerics.evidence import WeightDecay
from manoeuvre_nn.training.fits import LevenbergMarquardtFit

NOISE = 0.5


def fit(*, bayesian: bool, hidden: int = 8, **settings) -> LevenbergMarquardtFit:
    network = Perceptron((1, 2, hidden, 1), "tanh", "normal", 0.7, seed=1)
    given = {"damping": Damping("nielsen"), "iterations_per_epoch": 20} | settings
    return LevenbergMarquardtFit(response(network), bayesian=bayesian, **given)


@pytest.mark.slow
def test_shrunk_weights_foretell_better_what_few_noisy_records_do_not_tell():
    plain, shrunk = fit(bayesian=False), fit(bayesian=True)
    trained(plain, 10, 60, NOISE)
    trainer = trained(shrunk, 10, 60, NOISE)
    assert error_elsewhere(shrunk.dynamics) < 0.7 * error_elsewhere(plain.dynamics)
    assert 3 < float(trainer.callback_metrics["train/effective_weights"]) < 25  # of 33


def test_the_noise_that_is_found_is_that_of_the_records():
    shrunk = fit(bayesian=True)
    trained(shrunk, 15, 120, NOISE)
    found = float(shrunk.dynamics.scaling.output_scale) / float(shrunk.shrinkage[1]) ** 0.5
    assert found == pytest.approx(NOISE, rel=0.15)


def test_prior_and_weights_come_to_rest_together():
    shrunk = fit(bayesian=True, hidden=3)
    trained(shrunk, 40, 120, NOISE)
    scaling, network = shrunk.dynamics.scaling, shrunk.dynamics.network
    generator = torch.Generator().manual_seed(2)
    noisy = Y + NOISE * torch.randn(120, 1, generator=generator, dtype=torch.float64)
    x, y = scaling.inputs(X), scaling.outputs(noisy)
    j, e = network.jacobian(x), (network.rows(x) - y).flatten(1)
    w = torch.cat([p.detach().flatten(1) for p in network.parameters()], 1)
    prior = WeightDecay(*shrunk.shrinkage)
    again = prior.again(j.mT @ j, e.detach(), w)
    torch.testing.assert_close(again.ratio, prior.ratio, rtol=1e-3, atol=0)
    slope = (j.mT @ e.detach()[..., None])[..., 0] + prior.ratio[:, None] * w
    assert slope.abs().max() < 1e-3 * (prior.ratio[:, None] * w).abs().max()


def test_the_error_that_is_told_is_that_of_the_records_alone():
    shrunk = fit(bayesian=True)
    trainer = trained(shrunk, 3, 120, NOISE)
    generator = torch.Generator().manual_seed(2)
    noisy = Y + NOISE * torch.randn(120, 1, generator=generator, dtype=torch.float64)
    model = shrunk.dynamics
    with torch.no_grad():
        wrong = model.network(model.scaling.inputs(X)) - model.scaling.outputs(noisy)
    assert float(trainer.callback_metrics["train/mse"]) == pytest.approx(float(wrong.square().mean()), rel=1e-9)


def test_a_state_holds_the_prior_and_only_where_there_is_one():
    shrunk, other = fit(bayesian=True), fit(bayesian=True)
    trained(shrunk, 2)
    other.load_state_dict(shrunk.state_dict())
    assert torch.equal(other.shrinkage, shrunk.shrinkage)
    assert "shrinkage" not in fit(bayesian=False).state_dict()


def test_weights_of_other_networks_are_not_shrunk():
    with pytest.raises(InputError, match=r"fit\.bayesian"):
        LevenbergMarquardtFit(response(_Other()), bayesian=True)


class _Other(RadialBasis):
    any_fit = True

    def __init__(self) -> None:
        super().__init__(2, 3, 1)
