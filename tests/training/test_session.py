import io
import math
import os
import re
import signal
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest
import tiny
import torch
from fleet import unchecked
from rich.console import Console
from tiers import only
from tiny import Each

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.steepest_descent import StoppingRules
from manoeuvre_nn.training.rollout_score import MONITOR
from manoeuvre_nn.training.session import Session

FITS = {"Levenberg-Marquardt": tiny.lm, "backpropagation": lambda: tiny.backprop(batch_size=16, seed=3)}


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(tiny.weights(a), tiny.weights(b), strict=True))


@pytest.mark.parametrize("make", FITS.values(), ids=FITS)
def test_a_resumed_run_equals_a_straight_one_bit_for_bit(make, tmp_path):
    straight, _ = tiny.train(make(), tmp_path / "straight", max_epochs=12, every=3, keep="last")
    tiny.train(make(), tmp_path / "broken", max_epochs=6, every=3, keep="last")
    resumed, _ = tiny.train(make(), tmp_path / "broken", max_epochs=12, every=3, keep="last")
    assert same(straight.fit, resumed.fit)
    assert straight.history == resumed.history
    assert [row["epoch"] for row in resumed.history] == [3, 6, 9, 12]
    assert not same(straight.fit, make())


@pytest.mark.slow
def test_a_run_resumed_from_a_file_in_another_folder_equals_a_straight_one(tmp_path):
    straight, _ = tiny.train(tiny.lm(), tmp_path / "straight", max_epochs=8)
    tiny.train(tiny.lm(), tmp_path / "before", max_epochs=6)
    start = tmp_path / "before" / "checkpoints" / "last.ckpt"
    resumed, _ = tiny.train(tiny.lm(), tmp_path / "after", max_epochs=8, resume=str(start))
    assert same(straight.fit, resumed.fit)
    assert straight.chosen == resumed.chosen
    assert (tmp_path / "after" / "checkpoints" / "best.ckpt").is_file()


def test_the_last_checkpoint_is_that_of_the_last_epoch_even_if_it_was_not_judged_or_not_the_best(tmp_path):
    epochs = []

    def look(epoch, trainer):
        path = tmp_path / "checkpoints" / "last.ckpt"
        epochs.append(torch.load(path, weights_only=True)["epoch"] + 1 if path.exists() else 0)

    tiny.train(tiny.lm(), tmp_path, max_epochs=7, every=3, extra=[Each(look)])
    assert epochs == [0, 1, 2, 3, 4, 5, 6], "the file is written after all other callbacks"
    look(7, None)
    assert epochs[-1] == 7


def test_resume_never_starts_anew(tmp_path):
    first, _ = tiny.train(tiny.lm(), tmp_path, max_epochs=4)
    again, _ = tiny.train(tiny.lm(), tmp_path, max_epochs=4, resume="never")
    assert first.history == again.history


def test_patience_counts_scores_and_not_epochs(tmp_path):
    trained, scorer = tiny.train(tiny.lm(), tmp_path, max_epochs=60, every=2, patience=2)
    assert trained.stopped == "no better held-out score"
    assert trained.epochs == 2 * len(scorer.history) < 60
    scores = [row[MONITOR] for row in scorer.history]
    assert min(scores[-2:]) >= min(scores[:-2])
    assert all(min(scores[k - 2 : k]) < min(scores[: k - 2]) for k in range(3, len(scores)))


@pytest.mark.slow
def test_patience_survives_a_resumption(tmp_path):
    straight, _ = tiny.train(tiny.lm(), tmp_path / "straight", max_epochs=60, patience=2)
    tiny.train(tiny.lm(), tmp_path / "broken", max_epochs=straight.epochs - 3, patience=2)
    resumed, _ = tiny.train(tiny.lm(), tmp_path / "broken", max_epochs=60, patience=3)
    assert resumed.epochs > straight.epochs - 3 and resumed.stopped == "no better held-out score"


STOPPED = {
    "by the optimizer": (lambda: tiny.lm(goal=1e-4), {}),
    "by a stopping rule": (lambda: tiny.backprop(stopping=StoppingRules(goal=0.02)), {}),
    "by scores that were no better": (tiny.lm, {"patience": 1}),
    "at the last epoch": (tiny.backprop, {"max_epochs": 3}),
}


@pytest.mark.parametrize(
    ("make", "settings"),
    only([STOPPED[k] for k in STOPPED if k != "by a stopping rule"], STOPPED.values()),
    ids=STOPPED,
)
def test_a_training_that_had_stopped_when_it_was_killed_is_not_trained_any_further(make, settings, tmp_path):
    common = {"max_epochs": 60, "every": 2, "keep": "last"} | settings
    done, _ = tiny.train(make(), tmp_path, **common)
    again, _ = tiny.train(make(), tmp_path, **common)
    assert 1 < done.epochs < 60 and (again.epochs, again.stopped) == (done.epochs, done.stopped)
    assert again.history == done.history and same(again.fit, done.fit)


def test_keep_best_takes_the_epoch_that_scored_best_and_keep_last_the_last(tmp_path):
    stored = {}

    def store(epoch, trainer):
        stored[epoch] = tiny.weights(trainer.lightning_module)

    best, scorer = tiny.train(tiny.lm(), tmp_path / "best", max_epochs=7, extra=[Each(store)], keep="best")
    scores = {row["epoch"]: row[MONITOR] for row in scorer.history}
    number = min(scores, key=scores.get)
    assert number < 7, "choose a case in which the last one is not the best"
    assert all(np.array_equal(a, b) for a, b in zip(tiny.weights(best.fit), stored[number], strict=True))
    assert f"epoch {number:.0f}," in best.chosen
    last, _ = tiny.train(tiny.lm(), tmp_path / "last", max_epochs=7, keep="last")
    assert all(np.array_equal(a, b) for a, b in zip(tiny.weights(last.fit), stored[7], strict=True))
    assert "last one" in last.chosen


def test_the_last_epoch_may_be_the_best_though_its_number_is_no_multiple(tmp_path):
    trained, scorer = tiny.train(tiny.lm(), tmp_path, max_epochs=5, every=3)
    assert scorer.best["epoch"] == 5, "choose a case in which the last one is the best"
    last, _ = tiny.train(tiny.lm(), tmp_path / "last", max_epochs=5, every=3, keep="last")
    assert same(trained.fit, last.fit)
    stored = torch.load(tmp_path / "checkpoints" / "best.ckpt", weights_only=True)
    assert stored["epoch"] == 4


def test_a_fit_whose_optimizer_stops_ends_the_training_with_the_reason(tmp_path):
    trained, scorer = tiny.train(tiny.lm(goal=1e-4), tmp_path, max_epochs=200, every=50)
    assert trained.epochs < 50 and trained.stopped == "goal reached"
    assert [row["epoch"] for row in scorer.history] == [trained.epochs]
    assert scorer.history[-1]["train/mse"] <= 1e-4


def test_all_epochs_done_is_told(tmp_path):
    assert tiny.train(tiny.lm(), tmp_path, max_epochs=2)[0].stopped == "all epochs done"


@pytest.mark.parametrize(
    "settings, told",
    [
        ({"max_epochs": 0}, "trainer.max_epochs=0: expected at least 1"),
        ({"max_epochs": 1, "patience": 0}, "trainer.patience=0: expected at least 1"),
        ({"max_epochs": 1, "keep": "first"}, "trainer.keep 'first' is unknown; choose one of: best, last"),
        ({"max_epochs": 1, "accelerator": "abacus"}, "trainer.accelerator 'abacus' is unknown; choose one of: cpu"),
    ],
)
def test_settings_out_of_range_are_refused(settings, told):
    with unchecked(), pytest.raises(InputError) as refusal:
        Session(**settings)
    assert told in str(refusal.value)


def test_a_checkpoint_of_another_network_or_method_is_refused_before_training(tmp_path):
    tiny.train(tiny.lm(), tmp_path / "a", max_epochs=2)
    start = str(tmp_path / "a" / "checkpoints" / "last.ckpt")
    for other in (tiny.lm(hidden=5), tiny.backprop()):
        with pytest.raises(InputError, match="is of another network: ") as refusal:
            tiny.train(other, tmp_path / "b", max_epochs=4, resume=start)
        assert "\n" not in str(refusal.value)
    assert not (tmp_path / "b" / "checkpoints").exists()


def test_a_checkpoint_that_is_missing_is_refused(tmp_path):
    with pytest.raises(InputError, match="trainer.resume=.*expected auto, never, or the path"):
        tiny.train(tiny.lm(), tmp_path, resume=str(tmp_path / "none.ckpt"))


def test_ctrl_c_ends_the_fit_after_the_epoch_with_a_checkpoint_to_go_on_from(tmp_path):
    before, handlers = signal.getsignal(signal.SIGINT), []

    def press(epoch, trainer):
        handlers.append(signal.getsignal(signal.SIGINT))
        if epoch == 4:
            os.kill(os.getpid(), signal.SIGINT)

    told = Console(file=io.StringIO())
    trained, scorer = tiny.train(tiny.lm(), tmp_path, max_epochs=50, every=3, extra=[Each(press)], console=told)
    assert trained.stopped == "ctrl-C" and trained.epochs == 4
    assert "stopping after this epoch" in told.file.getvalue()
    assert before not in handlers and signal.getsignal(signal.SIGINT) is before
    resumed, _ = tiny.train(tiny.lm(), tmp_path, max_epochs=6, every=3, keep="last")
    straight, _ = tiny.train(tiny.lm(), tmp_path / "straight", max_epochs=6, every=3, keep="last")
    assert same(resumed.fit, straight.fit)


def test_ctrl_c_before_the_first_judgement_still_judges_and_keeps(tmp_path):
    class Early(Each):
        def on_train_epoch_start(self, trainer, pl_module):
            if trainer.current_epoch == 1:
                os.kill(os.getpid(), signal.SIGINT)

    trained, scorer = tiny.train(tiny.lm(), tmp_path, max_epochs=50, every=20, extra=[Early(lambda *_: None)])
    assert trained.stopped == "ctrl-C"
    assert [row["epoch"] for row in scorer.history] == [2]


def test_a_fit_that_breaks_gives_the_signal_back(tmp_path):
    before = signal.getsignal(signal.SIGINT)

    def fail(epoch, trainer):
        raise ZeroDivisionError("a fault of the program")

    with pytest.raises(ZeroDivisionError):
        tiny.train(tiny.lm(), tmp_path, extra=[Each(fail)])
    assert signal.getsignal(signal.SIGINT) is before


def test_progress_tells_the_epochs_that_are_done_the_error_and_the_last_score(tmp_path, monkeypatch):
    said = []

    @contextmanager
    def waiting(*_, **settings):
        yield lambda what, share=None: said.append((what, share))

    monkeypatch.setattr("manoeuvre_nn.training.session.waiting", waiting)
    tiny.train(tiny.lm(), tmp_path, max_epochs=3, every=2)
    told = [(what.split()[2].rstrip(","), share) for what, share in said if what.startswith("training, epoch ")]
    assert told == [(f"{k}/3", k / 3) for k in range(4)]
    lines = [what for what, _ in said if "mse" in what]
    errors = [float(re.search(r"mse ([^,]+)", line)[1]) for line in lines]
    assert len(errors) == 3 and all(later < earlier for earlier, later in pairwise(errors))
    assert "held-out" not in lines[0] and "held-out dev" in lines[1]


def test_progress_shows_a_bar_where_somebody_watches_and_can_be_silenced(tmp_path):
    bar = Console(file=io.StringIO(), force_terminal=True, width=120)
    tiny.train(tiny.lm(), tmp_path / "a", max_epochs=2, console=bar)
    assert "epoch 2/2" in bar.file.getvalue()
    silent = Console(file=io.StringIO(), force_terminal=True)
    tiny.train(tiny.lm(), tmp_path / "b", max_epochs=2, console=silent, progress=False)
    assert silent.file.getvalue() == ""


@pytest.mark.parametrize("make", FITS.values(), ids=FITS)
def test_all_that_is_recorded_is_finite_and_of_the_declared_types(make, tmp_path):
    trained, _ = tiny.train(make(), tmp_path, max_epochs=2, checked=True)
    assert all(math.isfinite(value) for row in trained.history for value in row.values())
