"""Training of a recursive network in closed loop."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import tiny
import torch
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from manoeuvre_nn.network.recursive import RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.known import no_part
from manoeuvre_nn.training.checkpoint import load_weights
from manoeuvre_nn.training.data import DataSettings, SimulatedData
from manoeuvre_nn.training.recursive_fit import FitPlan, RecursiveFit, fit_recursive, generalization
from manoeuvre_nn.training.recursive_windows import GrowingWindows, RecursiveFitSettings
from manoeuvre_nn.training.rollout_score import GENERALIZATION, MONITOR

SHORT = RecursiveFitSettings(
    stages=(
        {"steps": 1, "updates": 8, "rows": 30, "rate": 3e-3},
        {"steps": 5, "updates": 8, "rows": 20, "rate": 3e-3},
        {"steps": None, "updates": 8, "rate": 1e-3, "track": 0.1},
    )
)


@cache
def data() -> SimulatedData:
    ship = container(2)
    chosen = (35.0, "starboard"), (20.0, "port"), (28.0, "starboard")
    *circles, unseen = (tactical_circle(angle, side, approach=10.0, turn_deg=20.0) for angle, side in chosen)
    made = SimulatedData(ship, no_part(ship), circles, [unseen], settings=DataSettings())
    with unchecked():
        made.setup()
    return made


def ship(seed=0, **settings) -> RecursiveShip:
    network = RecursiveNetwork(RecursiveSettings(**{"hidden": (8, 8)} | settings), seed=seed, dtype=torch.float64)
    return RecursiveShip(data().reference, network)


def fit(seed=0, settings=SHORT, **options) -> RecursiveFit:
    return RecursiveFit(ship(seed), settings, **{"iterations_per_epoch": 4, "seed": seed} | options)


def weights(of: RecursiveFit | RecursiveShip) -> list[np.ndarray]:
    return [p.detach().numpy().copy() for p in of.parameters()]


def same(a, b) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(weights(a), weights(b), strict=True))


def windows(model: RecursiveShip, runs=None, **changes) -> GrowingWindows:
    return GrowingWindows(model, runs or data().recordings, replace(SHORT, **changes))


@pytest.mark.slow
def test_the_network_that_sailed_the_runs_has_no_error_on_them():
    model = ship()
    windows(model)  # scales the network
    scaling = {k: v.clone() for k, v in model.network.state_dict().items()}
    own = replay(model, data().recordings)
    again = windows(model, own, approach=None)
    model.network.load_state_dict(scaling)
    again.material = again.prepared()
    rows = torch.arange(2)
    assert float(again.loss(rows, 0 * rows, steps=None, track=0.1)) < 1e-4
    other = ship(seed=1)
    shared = {k: v for k, v in scaling.items() if "weights" not in k}
    other.network.load_state_dict({**other.network.state_dict(), **shared})
    again.ship = other
    assert float(again.loss(rows, 0 * rows, steps=None, track=0.1)) > 1e-2


@pytest.mark.slow
def test_a_window_of_one_step_is_teacher_forcing():
    made = windows(ship(), weights={"u": 1.0})
    rows, k = torch.tensor([0, 0, 1]), torch.tensor([0, 7, 12])
    loss = made.loss(rows, k, steps=1)
    seen = made.material.steps.start(rows, k, 7)
    inputs = made.ship.network.join((made.material.steps.forces[rows, k], *seen.forces), (seen.velocities, seen.before))
    error = (made.ship.network(inputs) - made.material.steps.velocities[rows, k + 1])[:, 0] / made.material.scales[0, 0]
    assert float(loss) == pytest.approx(float(error.square().mean()), rel=2e-3)  # a table is linear between its samples


def test_what_has_no_weight_does_not_count():
    """Velocities in turn, angles, and two of the track, which has a weight of its own."""
    counted = windows(ship(), weights={"u": 1.0}).material.weights
    assert len(counted) > 4 and float(counted[0]) == 1.0 and not counted[1:].any()


@torch.no_grad()
def test_what_is_beyond_the_end_of_a_run_does_not_count():
    made = windows(ship())
    counts, zero = made.material.counts, torch.zeros(1, dtype=torch.long)
    short, steps = counts.argmin()[None], int(counts.max()) + 10
    before = float(made.loss(short, zero, steps=steps))
    course = made.material.course
    samples = int(course.duration[short] / course.motion.interval[short] + 1e-6) + 1
    moved = course.motion.values.clone()
    moved[short, samples + 1 :] += 100.0
    made.material = made.material._replace(course=replace(course, motion=replace(course.motion, values=moved)))
    assert float(made.loss(short, zero, steps=steps)) == before
    moved[short, samples // 2] += 100.0
    made.material = made.material._replace(course=replace(course, motion=replace(course.motion, values=moved)))
    assert float(made.loss(short, zero, steps=steps)) > before


def test_the_error_is_the_same_on_whatever_course_the_runs_were_sailed():
    def turned(run, angle=2.0):
        x, y = run["x"] * np.cos(angle) - run["y"] * np.sin(angle), run["x"] * np.sin(angle) + run["y"] * np.cos(angle)
        return run.with_channels(x=x, y=y, psi=run["psi"] + angle)

    losses = []
    for runs in (data().recordings, [turned(run) for run in data().recordings]):
        made = windows(ship(), runs)
        losses.append(float(made.loss(torch.arange(2), torch.zeros(2, dtype=torch.long), steps=None, track=0.1)))
    assert losses[0] == pytest.approx(losses[1], rel=1e-9)


def test_training_lowers_the_error_of_whole_runs_and_the_same_seed_gives_the_same_weights():
    one, two, other = ship(), ship(), ship()
    before = float(windows(one).loss(torch.arange(2), torch.zeros(2, dtype=torch.long), steps=None))
    for model, seed in ((one, 0), (two, 0), (other, 1)):
        with unchecked():
            fit_recursive(model, data().recordings, settings=SHORT, plan=FitPlan(every=1000, seed=seed))
    assert same(one, two) and not same(one, other)
    after = float(windows(one).loss(torch.arange(2), torch.zeros(2, dtype=torch.long), steps=None))
    assert after < 0.6 * before


def test_a_study_is_told_every_test_and_is_left_the_best_weights():
    told, model, runs = [], ship(), data()
    with unchecked():
        history = fit_recursive(
            model, runs.recordings, runs.held_out.references, settings=SHORT, plan=FitPlan(every=6), say=told.append
        )
    assert history == told and [row["update"] for row in history] == [6, 12, 18, 24]
    found = generalization(model, [*runs.recordings, *runs.held_out.references])
    assert found["average_angle"] == max(row["average_angle"] for row in history)


def test_generalization_of_own_runs_is_perfect():
    model = ship()
    windows(model)
    found = generalization(model, replay(model, data().recordings))
    assert found["average_angle"] > 0.98 and found["absolute"] < 0.5


def test_stages_follow_each_other_and_their_rates_rise_and_fall():
    made = windows(ship())
    stages, rates = zip(*(made._schedule(float(k)) for k in range(24)), strict=True)
    assert [stage.steps for stage in stages] == [1] * 8 + [5] * 8 + [None] * 8
    for k in range(3):
        part = np.array(rates[8 * k : 8 * k + 8])
        assert part[0] < part[1] and (np.diff(part[1:]) < 0).all() and part.max() <= stages[8 * k].rate
    assert made._schedule(1000.0)[0].steps is None


def test_a_longer_plan_stretches_the_stages():
    model, steps = ship(), []
    made = windows(model)
    optimizer, draw = made.optimizer(), torch.Generator().manual_seed(0)
    for k in range(0, 48, 8):
        steps.append(made.update(optimizer, k, 48, draw)[1].steps)
    assert steps == [1, 1, 5, 5, None, None]


def test_a_resumed_run_equals_a_straight_one_bit_for_bit(tmp_path):
    straight, _ = tiny.train(fit(), tmp_path / "straight", data=data(), max_epochs=5, every=5, keep="last")
    tiny.train(fit(), tmp_path / "broken", data=data(), max_epochs=3, every=5, keep="last")
    resumed, _ = tiny.train(fit(), tmp_path / "broken", data=data(), max_epochs=5, every=5, keep="last")
    assert same(straight.fit, resumed.fit)
    assert not same(straight.fit, fit())


def test_a_training_ends_with_its_last_stage_and_keeps_the_best_generalization(tmp_path):
    made = fit(iterations_per_epoch=8)
    trained, scorer = tiny.train(made, tmp_path, data=data(), max_epochs=50, every=1, keep="best")
    assert trained.stopped == "all stages done" and trained.epochs == 3
    errors = [row[GENERALIZATION] for row in scorer.history]
    assert scorer.best[GENERALIZATION] == min(errors) and "training and held-out runs together" in trained.chosen
    runs = [*data().recordings, *data().held_out.references]
    assert 1 - generalization(trained.fit.dynamics, runs)["average_angle"] == pytest.approx(min(errors))
    kept = fit(seed=1)
    load_weights(kept, tmp_path / "checkpoints" / "best.ckpt")
    assert same(kept, trained.fit)


@pytest.mark.slow
def test_held_out_runs_alone_may_choose(tmp_path):
    chosen = replace(SHORT, choose_by="held_out")
    _, scorer = tiny.train(fit(settings=chosen), tmp_path, data=data(), max_epochs=2, every=1)
    assert all(GENERALIZATION not in row and MONITOR in row for row in scorer.history)


def test_only_a_length_of_the_approach_is_trained_on():
    long = [tactical_circle(35.0, approach=60.0, turn_deg=40.0), overshoot(20.0, approach=60.0, cycles=0.5)]
    model = ship()
    runs = roll_out(CalmWater(data().reference), long)
    whole, cut = windows(model, runs, approach=None), windows(model, runs, approach=1.0)
    unit = data().reference.particulars.time_unit
    assert float(whole.course.duration[0] - cut.course.duration[0]) == pytest.approx(60.0 / unit - 1.0, abs=0.2)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"stages": ()}, "stages"),
        ({"stages": ({"steps": 0, "updates": 1},)}, "steps=0"),
        ({"stages": ({"steps": 1, "updates": 1, "windows": 3},)}, "windows"),
        ({"weights": {"heading": 1.0}}, "heading"),
        ({"weights": {"u": -1.0}}, "u=-1"),
        ({"clip": 0.0}, "clip"),
        ({"choose_by": "luck"}, "luck"),
        ({"weights": {"v": float("inf")}}, "fit.weights: v=inf: expected a finite number from 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused_in_one_line(change, words):
    with pytest.raises(InputError, match=words) as refused:
        replace(SHORT, **change)
    assert "\n" not in str(refused.value)


def test_another_network_is_refused():
    with unchecked(), pytest.raises(InputError, match="does not train"):
        RecursiveFit(tiny.dynamics(tiny.usual()))
