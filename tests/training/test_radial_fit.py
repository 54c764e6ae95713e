import pytest
from small_response import OTHERS, Y, error_elsewhere, response, trained

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.training.fits import BackpropFit
from manoeuvre_nn.training.radial_fit import ALL_TRIED, AT_REST, GeneralRegressionFit, RadialBasisFit

FITS = [(RadialBasis, RadialBasisFit, (2, 20, 1)), (GeneralRegression, GeneralRegressionFit, (2, 1))]


def test_radial_basis_functions_learn_a_smooth_function():
    model = response(RadialBasis(2, 40, 1))
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
        model = response(RadialBasis(2, 40, 1))
        trained(RadialBasisFit(model, factors=factors))
        found.append(model.at(OTHERS.numpy()))
    assert found[0] == pytest.approx(found[1])
    alone = response(RadialBasis(2, 40, 1))
    trained(RadialBasisFit(alone, factors=[3.0]))
    assert alone.at(OTHERS.numpy()) == pytest.approx(found[0])


def test_regression_by_stored_records_finds_its_widths():
    model = response(GeneralRegression(2, 1))
    fit = GeneralRegressionFit(model)
    trained(fit)
    assert fit.stopped == AT_REST
    assert len(model.network.records) == 120
    assert error_elsewhere(model) < 0.35
    common = response(GeneralRegression(2, 1))
    trained(GeneralRegressionFit(common, common_width=True))
    assert common.network.widths[0] == common.network.widths[1]


@pytest.mark.parametrize(("kind", "fit", "size"), FITS)
def test_a_state_gives_the_fitted_network_again(kind, fit, size):
    first, second = response(kind(*size)), response(kind(*size))
    done, empty = fit(first), fit(second)
    trained(done, 3)
    empty.load_state_dict(done.state_dict())
    assert (first.at(OTHERS.numpy()) == second.at(OTHERS.numpy())).all()


def test_each_fit_is_for_its_own_network_and_each_network_for_its_own_fit():
    with pytest.raises(InputError, match="does not train a GeneralRegression"):
        RadialBasisFit(response(GeneralRegression(2, 1)))
    with pytest.raises(InputError, match="does not train a Perceptron"):
        GeneralRegressionFit(response(Perceptron((1, 2, 3, 1))))
    with pytest.raises(InputError, match="does not train a RadialBasis"):
        BackpropFit(response(RadialBasis(2, 3, 1)))


@pytest.mark.parametrize("wrong", [{"factors": []}, {"factors": [0.0]}, {"ridges": [-1.0]}, {"neighbours": 0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(InputError, match=rf"fit\.{next(iter(wrong))}"):
        RadialBasisFit(response(RadialBasis(2, 3, 1)), **wrong)


@pytest.mark.parametrize(("kind", "fit", "size"), FITS)
def test_records_given_four_times_teach_what_they_teach_once(kind, fit, size):
    once, repeated = response(kind(*size)), response(kind(*size))
    trained(fit(once))
    trained(fit(repeated), repeats=4)
    assert repeated.at(OTHERS.numpy()) == pytest.approx(once.at(OTHERS.numpy()), rel=1e-6)
