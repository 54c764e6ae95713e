import lightning as L
import pytest
import torch
from fleet import unchecked
from torch.utils.data import DataLoader

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import Quantities, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.training.fits import BackpropFit
from manoeuvre_nn.training.radial_fit import ALL_TRIED, AT_REST, GeneralRegressionFit, RadialBasisFit

X = torch.rand(120, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
Y = (torch.sin(5 * X[:, :1]) + X[:, 1:] ** 2) * 3 + 7
OTHERS = torch.rand(200, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def response(network) -> Response:
    scaling = Scaling(X.mean(0), X.std(0), Y.std(0), Y.mean(0))
    a, b, y = (Variable(name, "", 1.0, name) for name in "aby")
    return Response(network, scaling, Quantities([a, b], y, ["a", "b"]))


def trained(fit, epochs: int = 100):
    empty = X[:0], Y[:0]
    trainer = L.Trainer(
        max_epochs=epochs, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    )  # fmt: skip
    with unchecked():
        trainer.fit(fit, DataLoader([(X, Y, *empty)], batch_size=None))
    return trainer


def error_elsewhere(model: Response) -> float:
    right = (torch.sin(5 * OTHERS[:, 0]) + OTHERS[:, 1] ** 2) * 3 + 7
    with torch.no_grad():
        return float((model(OTHERS) - right).square().mean().sqrt())


def test_radial_basis_functions_learn_a_smooth_function():
    model = response(RadialBasis(2, 40))
    fit = RadialBasisFit(model)
    trainer = trained(fit)
    assert fit.stopped == ALL_TRIED
    assert trainer.current_epoch == len(fit.factors)
    assert error_elsewhere(model) < 0.01
    foretold = float(trainer.callback_metrics["train/press"]) ** 0.5 * float(Y.std())
    assert 1 / 3 < foretold / error_elsewhere(model) < 3


def test_the_network_keeps_the_best_of_the_widths_in_whatever_order_they_are_tried():
    found = []
    for factors in ([1.0, 3.0, 0.3], [0.3, 3.0, 1.0]):
        model = response(RadialBasis(2, 40))
        trained(RadialBasisFit(model, factors=factors))
        found.append(model.at(OTHERS.numpy()))
    assert found[0] == pytest.approx(found[1])
    alone = response(RadialBasis(2, 40))
    trained(RadialBasisFit(alone, factors=[3.0]))
    assert alone.at(OTHERS.numpy()) == pytest.approx(found[0])


def test_regression_by_stored_records_finds_its_widths():
    model = response(GeneralRegression(2))
    fit = GeneralRegressionFit(model)
    trained(fit)
    assert fit.stopped == AT_REST
    assert len(model.network.records) == 120
    assert error_elsewhere(model) < 0.35
    common = response(GeneralRegression(2))
    trained(GeneralRegressionFit(common, common_width=True))
    assert common.network.widths[0] == common.network.widths[1]


@pytest.mark.parametrize(
    ("kind", "fit", "size"), [(RadialBasis, RadialBasisFit, (2, 20)), (GeneralRegression, GeneralRegressionFit, (2,))]
)
def test_a_state_gives_the_fitted_network_again(kind, fit, size):
    first, second = response(kind(*size)), response(kind(*size))
    done, empty = fit(first), fit(second)
    trained(done, 3)
    empty.load_state_dict(done.state_dict())
    assert (first.at(OTHERS.numpy()) == second.at(OTHERS.numpy())).all()


def test_each_fit_is_for_its_own_network_and_each_network_for_its_own_fit():
    with pytest.raises(InputError, match="does not train a GeneralRegression"):
        RadialBasisFit(response(GeneralRegression(2)))
    with pytest.raises(InputError, match="does not train a Perceptron"):
        GeneralRegressionFit(response(Perceptron((1, 2, 3, 1))))
    with pytest.raises(InputError, match="does not train a RadialBasis"):
        BackpropFit(response(RadialBasis(2)))


@pytest.mark.parametrize("wrong", [{"factors": []}, {"factors": [0.0]}, {"ridges": [-1.0]}, {"neighbours": 0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(InputError, match=rf"fit\.{next(iter(wrong))}"):
        RadialBasisFit(response(RadialBasis(2)), **wrong)
