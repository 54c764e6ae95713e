"""An ensemble trained by Lightning, a member an epoch: what each becomes, and what does not count for it."""

from dataclasses import replace

import pytest
import tiny
import torch
from fleet import unchecked
from tiny import Each

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.training.ensemble import ALL_TRAINED, STEP_TRIALS, EnsembleFit
from manoeuvre_nn.training.scalings import make_scaling

EPOCHS = 4
"""Steps of a member: enough to tell starts apart."""


def ensemble(
    data=None, members: int = 3, *, seed: int = 2, law: str = "approach", shrink: float = 0.0, **options
) -> EnsembleFit:
    data = data or tiny.usual()
    network = HullRudder(HullRudderSettings(4, members, speed_law=law, shrink=shrink), seed=seed, dtype=data.dtype)
    scaling = make_scaling(network.scalings[0], data.known, data.tuples)
    model = IdentifiedShip(data.known, network, scaling).to(data.dtype)
    return EnsembleFit(model, **{"epochs": EPOCHS, "min_fall": 0.0} | options)


def train(fit, folder, **settings):
    return tiny.train(fit, folder, **{"max_epochs": 9, "every": 9, "keep": "last"} | settings)


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Three members trained in one go, and what was told of each."""
    fit = ensemble()
    done, _ = train(fit, tmp_path_factory.mktemp("straight"), every=1)
    return fit, done


def state(fit) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in fit.network.state_dict().items()}


def same(a, b) -> bool:
    return all(torch.equal(value, state(b)[name]) for name, value in state(a).items())


def scaled(fit, data=None):
    tuples = (data or tiny.usual()).tuples
    return fit.scaled(tuples.inputs, tuples.targets)


def alone(fit, member: int, trial: int) -> tuple[torch.Tensor, torch.Tensor, float]:
    """A member solved by hand from the start of a trial: its weights and its error."""
    (x, y), network = scaled(fit), fit.network
    problem = network.least_squares(x, y)
    start = network.drawn(member, trial)[network.sees][None]
    found = minimise(problem, start, stops=Stops(epochs=EPOCHS))
    return problem.full(found.weights)[0], problem.output_weights(found.weights)[0], float(found.mse)


def test_an_epoch_trains_a_member_and_the_last_one_ends_the_training(tmp_path):
    trained, fits = [], ensemble()
    first = state(fits)

    def look(epoch, trainer):
        network = trainer.lightning_module.network
        assert int(network.trained) == epoch
        assert (network.input_weights[:epoch] != first["input_weights"][:epoch]).flatten(1).any(1).all()
        assert torch.equal(network.input_weights[epoch:], first["input_weights"][epoch:])
        assert network.output_weights[epoch:].abs().sum() == 0
        trained.append(epoch)

    done, scorer = train(fits, tmp_path, extra=[Each(look)], checked=True)
    assert trained == [1, 2, 3] and done.epochs == 3 and done.stopped == ALL_TRAINED
    assert [row["epoch"] for row in scorer.history] == [3]
    assert int(fits.network.trained) == 3


def test_every_member_is_what_variable_projection_makes_of_its_first_weights(straight):
    fit, _ = straight
    (x, y), network = scaled(fit), fit.network
    each = network.each(x.expand(3, -1, -1)).detach()
    for k in range(3):
        inner, outer, mse = alone(ensemble(), k, 0)
        torch.testing.assert_close(network.input_weights[k], inner, rtol=1e-6, atol=1e-8)
        torch.testing.assert_close(network.output_weights[k], outer, rtol=1e-5, atol=1e-6)
        assert float((each[k] - y).square().mean()) == pytest.approx(mse, rel=1e-6)


def test_the_error_that_is_told_is_that_of_the_member_just_trained(straight):
    fit, done = straight
    x, y = scaled(fit)
    errors = (fit.network.each(x.expand(3, -1, -1)) - y).detach().square().mean((1, 2)).tolist()
    assert [row["train/mse"] for row in done.history] == pytest.approx(errors, rel=1e-6)
    assert len(set(errors)) == 3


def test_fewer_epochs_train_fewer_members_and_only_these_answer(tmp_path):
    fit = ensemble()
    done, _ = train(fit, tmp_path, max_epochs=2)
    assert done.stopped == "all epochs done" and int(fit.network.trained) == 2
    (x, _), network = scaled(fit), fit.network
    torch.testing.assert_close(network(x), network.each(x.expand(3, -1, -1))[:2].mean(0), rtol=1e-10, atol=1e-12)


def test_a_member_does_not_depend_on_how_many_there_are(straight, tmp_path):
    few, (many, _) = ensemble(members=2), straight
    train(few, tmp_path)
    for name in ("input_weights", "output_weights"):
        assert torch.equal(getattr(few.network, name), getattr(many.network, name)[:2])


def test_an_ensemble_that_was_killed_goes_on_as_if_it_had_not_been(straight, tmp_path):
    broken, resumed = ensemble(), ensemble()

    class Kill(Each):
        def on_train_batch_end(self, trainer, *_):
            if trainer.current_epoch == 2:  # the third member is solved and not yet stored
                raise KeyError("pulled the plug")

    with pytest.raises(KeyError, match="plug"):
        train(broken, tmp_path, every=1, extra=[Kill(lambda *_: None)])
    done, scorer = train(resumed, tmp_path, every=1)
    assert same(resumed, straight[0]) and done.stopped == ALL_TRAINED and done.epochs == 3
    assert [row["epoch"] for row in scorer.history] == [1, 2, 3]


def test_an_ensemble_that_is_complete_is_not_trained_any_further(tmp_path):
    fit, again = ensemble(members=2), ensemble(members=2)
    train(fit, tmp_path)
    done, scorer = train(again, tmp_path)
    assert same(again, fit) and done.stopped == ALL_TRAINED and done.epochs == 2
    assert [row["epoch"] for row in scorer.history] == [2]


def test_the_same_seed_gives_the_same_ensemble_and_another_seed_another(straight, tmp_path):
    for seed, alike in ((2, True), (3, False)):
        fit = ensemble(seed=seed)
        train(fit, tmp_path / str(seed))
        assert same(fit, straight[0]) is alike


def test_noise_ends_members_early_and_after_a_kill_as_early_as_before(tmp_path, monkeypatch):
    data = tiny.simulated(noise={"v": 0.2, "r_deg_s": 0.2}, accelerations="central")
    fit, again = (ensemble(data, members=2, epochs=30) for _ in range(2))
    train(fit, tmp_path, data=data, max_epochs=1)
    assert int(fit.steps) in STEP_TRIALS and int(fit.steps) < 30
    monkeypatch.setattr("manoeuvre_nn.training.ensemble.steps_that_predict", None)  # it has been found already
    train(again, tmp_path, data=data)
    assert int(again.steps) == int(fit.steps) and int(again.network.trained) == 2


def test_exact_data_let_members_train_to_their_end(straight):
    assert int(straight[0].steps) == EPOCHS


def test_of_several_starts_the_best_is_kept(tmp_path):
    fit = ensemble(members=2, restarts=3)
    done, _ = train(fit, tmp_path, every=1)
    chosen = []
    for k in range(2):
        trials = [alone(ensemble(members=2), k, trial) for trial in range(3)]
        best = min(range(3), key=lambda trial: trials[trial][2])
        torch.testing.assert_close(fit.network.input_weights[k], trials[best][0], rtol=1e-6, atol=1e-8)
        assert done.history[k]["train/mse"] == pytest.approx(trials[best][2], rel=1e-6)
        chosen.append(best)
    assert max(chosen) > 0, "choose a case in which the first start is not always the best"


def test_the_error_of_data_set_aside_is_that_of_the_ensemble_so_far(tmp_path):
    data, told = tiny.simulated(validation=0.2), []
    fit = ensemble(data, members=2)
    look = Each(lambda epoch, trainer: told.append(float(trainer.callback_metrics["train/validation_mse"])))
    train(fit, tmp_path, data=data, extra=[look])
    batch = next(iter(data.train_dataloader()))
    x, y = fit.scaled(batch[2], batch[3])
    assert len(told) == 2
    assert told[-1] == pytest.approx(float((fit.network(x) - y).detach().square().mean()), rel=1e-9)


def test_data_set_aside_do_not_move_the_weights(tmp_path):
    data, other = (tiny.simulated(validation=0.2) for _ in range(2))
    fits = [ensemble(data, members=2) for _ in range(2)]
    other.tuples = replace(other.tuples, targets=torch.where(other.train_mask()[:, None], other.tuples.targets, 1.0))
    for k, (fit, source) in enumerate(zip(fits, (data, other), strict=True)):
        train(fit, tmp_path / str(k), data=source)
    assert not torch.equal(other.tuples.targets, data.tuples.targets) and same(*fits)


@pytest.mark.parametrize("options", [{"goal": 1e9}, {"min_fall": 1.0}])
def test_a_member_is_done_at_its_goal_or_where_its_error_hardly_falls(options, tmp_path):
    fit, steps = ensemble(members=1, **options), []
    look = Each(lambda epoch, trainer: steps.append(float(trainer.callback_metrics["train/steps"])))
    train(fit, tmp_path, extra=[look])
    assert steps == [0.0 if "goal" in options else 1.0]


def test_an_ensemble_identifies_the_mariner(tmp_path):
    data = tiny.simulated(length=300.0, score=[zigzag(20.0, duration=60.0)])
    fit = ensemble(data, members=2, epochs=30)
    done, scorer = train(fit, tmp_path, data=data)
    assert fit.relative_rmse(data.tuples.inputs, data.tuples.targets).max() < 0.05
    assert scorer.scores[0].dev_L < 0.05


def test_single_precision_trains_and_stays_single(tmp_path):
    data = tiny.simulated(dtype=torch.float32)
    fit = ensemble(data, members=2)
    batch = next(iter(data.train_dataloader()))
    train(fit, tmp_path, data=data)
    assert {p.dtype for p in fit.network.parameters()} == {torch.float32}
    assert fit.relative_rmse(batch[0], batch[1]).max() < 0.5


def test_nodes_are_shrunk_as_much_as_the_network_says(straight, tmp_path):
    fit = ensemble(shrink=0.3)
    train(fit, tmp_path, max_epochs=1)
    nodes = len(fit.network.node)
    free, held = (abs(f.network.output_weights[0, :, :nodes]).max() for f in (straight[0], fit))
    assert held < 0.5 * free
    inner, outer, _ = alone(fit, 0, 0)
    torch.testing.assert_close(fit.network.input_weights[0], inner, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(fit.network.output_weights[0], outer, rtol=1e-6, atol=1e-8)


def test_an_ensemble_that_knows_the_shaft_learns_too(tmp_path):
    fit, tuples = ensemble(law="shaft"), tiny.usual().tuples
    train(fit, tmp_path)
    assert fit.relative_rmse(tuples.inputs, tuples.targets).max() < 0.5


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: EnsembleFit(tiny.dynamics(tiny.usual())), "EnsembleFit does not train a Perceptron: choose another"),
        (lambda: ensemble(epochs=0), "fit.epochs=0, fit.restarts=1: expected at least 1 of each"),
        (lambda: ensemble(restarts=0), "fit.epochs=4, fit.restarts=0: expected at least 1 of each"),
        (lambda: ensemble(damping="none"), "fit.damping 'none' is unknown; choose one of: trainlm, nielsen"),
    ],
)
def test_other_networks_and_settings_out_of_range_are_refused_in_one_line(make, told):
    with unchecked(), pytest.raises(InputError) as refusal:
        make()
    assert told in str(refusal.value)
