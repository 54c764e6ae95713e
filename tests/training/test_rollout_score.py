import math
from functools import cache

import pytest
import tiny
import torch
from fleet import unchecked
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.training.rollout_score import MONITOR, RolloutScore, for_solvers, scalars


@cache
def minute() -> HeldOut:
    """So long that the rudder is reversed."""
    return tiny.simulated(score=[zigzag(20.0, duration=60.0)]).held_out


def scorer(**settings) -> RolloutScore:
    return RolloutScore(tiny.usual().held_out, **settings)


def spoilt(weight: float):
    fit = tiny.lm()
    with torch.no_grad():
        fit.dynamics.network.output_weights.fill_(weight)
    return fit


@pytest.mark.parametrize("solver", ["torchdiffeq", "rollout"])
@pytest.mark.parametrize("weight", [1e3, -1e200, math.inf, math.nan])
def test_a_network_that_runs_away_is_counted_and_never_scored_as_nan(solver, weight):
    held_out = minute()
    with unchecked():
        values = scalars(held_out.score(held_out.predict(spoilt(weight).dynamics, solver)))
    assert values["score/left_range"] == 1.0
    assert all(math.isfinite(value) for value in values.values())
    assert values[MONITOR] == values["zz20/dev_L"] > 0.5


def test_a_session_with_a_network_that_runs_away_goes_on(tmp_path):
    trained, seen = tiny.train(spoilt(1e3), tmp_path, max_epochs=1, every=1)
    assert trained.history[0][MONITOR] > 0 and math.isfinite(trained.history[0][MONITOR])
    assert "score/left_range" in trained.history[0]


def test_the_monitor_is_the_mean_over_the_manoeuvres():
    held_out, fit = minute(), spoilt(0.0)
    with unchecked():
        (one,) = held_out.score(held_out.predict(fit.dynamics, "rollout"))
    two = type(one)("other", "left the physical range at 3 s", 1.0, {"u": 0.5})
    values = scalars([one, two])
    assert values[MONITOR] == pytest.approx((one.dev_L + 1.0) / 2)
    assert (values["score/left_range"], values["other/dev_L"], values["other/nrmse_u"]) == (1.0, 1.0, 0.5)
    errors = {k: v - one.reference[k] for k, v in one.criteria.items() if k in one.reference}
    assert any(errors.values())
    assert {k: values[f"zz20/error_{k}"] for k in errors} == errors


def test_the_two_solvers_agree_on_the_score():
    held_out, fit = minute(), spoilt(0.0)
    with unchecked():
        fine, coarse = (held_out.score(held_out.predict(fit.dynamics, s))[0] for s in ("torchdiffeq", "rollout"))
    assert fine.dev_L == pytest.approx(coarse.dev_L, abs=2e-3)


def test_every_so_many_epochs_are_judged_and_the_last_one(tmp_path):
    trained, seen = tiny.train(tiny.lm(), tmp_path, max_epochs=7, every=3)
    assert [row["epoch"] for row in trained.history] == [3, 6, 7]
    assert seen.scored(7) and not seen.scored(6)


def test_the_history_survives_its_state():
    old, new = scorer(), scorer()
    assert not new.scored(0)
    old.history = [{"epoch": 1.0, MONITOR: 0.3}, {"epoch": 2.0, MONITOR: 0.1}, {"epoch": 3.0, MONITOR: 0.1}]
    state = old.state_dict()
    new.load_state_dict(state)
    assert new.history == old.history
    new.history.append({"epoch": 4.0, MONITOR: 0.2})
    assert len(state["history"]) == 3
    assert new.best["epoch"] == 2, "the first of equals"


def test_scores_and_errors_are_on_the_dashboard(tmp_path):
    trained, _ = tiny.train(tiny.lm(), tmp_path, max_epochs=4, every=2)
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert len(events.Scalars("3 training/mse")) == 4
    shown = [event.value for event in events.Scalars("1 held-out/dev_L")]
    assert shown == pytest.approx([row[MONITOR] for row in trained.history], rel=1e-6)
    seen = {"1 held-out/left_range", "4 zz20/nrmse_psi", "3 training/relrmse_g3", "3 training/mu"}
    assert seen <= set(events.Tags()["scalars"])


def test_solvers_get_a_double_copy_of_a_single_precision_model():
    single = tiny.dynamics(tiny.simulated(dtype=torch.float32), dtype=torch.float32)
    double = for_solvers(single)
    assert {p.dtype for p in double.parameters()} == {torch.float64}
    assert {p.dtype for p in single.parameters()} == {torch.float32}
    kept = tiny.lm().dynamics
    assert for_solvers(kept) is kept


@pytest.mark.parametrize(
    "settings, told",
    [
        ({"every": 0}, "scoring.every=0: expected at least 1 epoch"),
        ({"solver": "euler"}, "scoring.solver 'euler' is unknown; choose one of: torchdiffeq, rollout"),
    ],
)
def test_settings_of_the_judge_are_refused(settings, told):
    with unchecked(), pytest.raises(InputError, match=told):
        scorer(**settings)
