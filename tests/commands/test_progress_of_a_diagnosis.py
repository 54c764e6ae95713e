"""What a diagnosis says while it works."""

import re
import time

import pytest
from rich.console import Console

from manoeuvre_nn.commands.diagnose import _Tracker


def test_progress_names_the_candidate_and_the_time_left(capsys):
    with _Tracker(Console(width=200), cases=2, candidates=4, seconds=0.03) as tracker:
        for show, what in ((tracker.begin, "c1"), (tracker.step, "current"), (tracker.step, "heading_bias")):
            show(what)
            time.sleep(0.2)  # a step that takes long is told again and again
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 3 and lines[0] == "c1 (1/2): reading: 0 s so far"
    assert "c1 (1/2): current: 0 s so far" in lines
    assert re.match(r"c1 \(1/2\): heading_bias: \d s so far, about \d", lines[-1])


def test_the_share_of_a_diagnosis_that_is_done_grows_up_to_its_proof(monkeypatch):
    shares = []
    tracker = _Tracker(Console(), cases=1, candidates=2)
    monkeypatch.setattr(tracker, "_say", lambda what, share: shares.append(share), raising=False)
    tracker.begin("c1")
    alone = ["tracks and noise", *(2 * ["current", "heading_bias"]), "second linearisation"]
    for what in (*alone, *(20 * ["current + heading_bias"]), "linearisation about current + heading_bias", "proof"):
        tracker.step(what)
    assert shares == sorted(shares) and shares[:3] == [0, 0, 0] and shares[6] == pytest.approx(0.6)
    assert max(shares[:-1]) < shares[-1] == 0.65
