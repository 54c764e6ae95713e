"""The concealed trial in small: cases drawn, diagnosed by the command that a user runs, opened and scored."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SEEDS = {2: 1101, 4: 52}
"""Of two, short runs of small ships."""
CANDIDATES = {2: "[current]"}
"""Of two, the effect; of four, all that an answer may name."""


@pytest.fixture(scope="module", params=[2, pytest.param(4, marks=pytest.mark.slow)])
def cases(request):
    """A clean one and a strong current; of four, an ice field and an effect that is not listed besides."""
    return request.param


@pytest.fixture(scope="module")
def tool(cases, tmp_path_factory):
    out = tmp_path_factory.mktemp("trial")
    command = [sys.executable, "scripts/concealed_trial.py", f"cases={cases}", f"seed={SEEDS[cases]}", f"out={out}"]
    command += [f"jobs={cases // 2}", "strength=strong", "channels=full"]
    command.append(f"tool=candidates={CANDIDATES.get(cases, 'default')}")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return json.loads((out / "scoreboard.json").read_text())["tools"]["manoeuvre_nn"]


def test_every_case_is_answered(tool, cases):
    assert tool["board"]["totals"]["answered"]["right"] == cases
    assert tool["board"]["notes"] == {}


def test_clean_cases_raise_no_alarm(tool):
    alarms = tool["board"]["totals"]["false alarms"]
    assert alarms is not None
    assert alarms["right"] == 0


def test_strong_effects_of_the_list_are_named_and_no_prediction_is_made_worse(tool, cases):
    clear = [case for case in tool["cases"] if case["truth"] and "unknown" not in case["truth"]]
    assert len(clear) == cases // 2
    assert [case["case"] for case in clear if not case["first_right"]] == []
    assert tool["board"]["totals"]["predictions made worse"]["right"] == 0
