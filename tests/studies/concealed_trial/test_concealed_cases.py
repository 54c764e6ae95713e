"""The concealed trial in small: cases drawn, diagnosed by the command that a user runs, opened and scored."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from fleet import unchecked
from rich.console import Console

from manoeuvre_nn.commands.diagnose import diagnose_all
from manoeuvre_nn.commands.groups import compose
from studies.concealed_trial.drawing import Trial
from studies.concealed_trial.stages import generate, score

pytestmark = pytest.mark.slow
"""Stages are tested with a tool that answers at once, the command with cases of its own."""
ROOT = Path(__file__).parents[3]
ONE = Trial(106, 1, sort="single", strength="strong", channels="full")
"""Short runs of a small ship; one candidate is enough to find what is concealed in them."""


@pytest.fixture(scope="module", params=[1, 4])
def cases(request):
    """A strong current; of four, a clean one, an ice field and an effect that is not listed besides."""
    return request.param


@pytest.fixture(scope="module")
def tool(cases, tmp_path_factory):
    """How the diagnosis did: of one case stage by stage in this process, of four by the command that a user writes."""
    out = tmp_path_factory.mktemp("trial")
    if cases == 1:
        generate(ONE, out, jobs=1)
        words = [f"cases={out / 'recordings'}", f"out={out / 'answers'}", "workers=1", "candidates=[current]"]
        with unchecked():
            diagnose_all(compose("diagnose", words), out / "answers", Console(quiet=True))
        score(ONE, out, {"manoeuvre_nn": out / "answers"}, jobs=1)
    else:
        command = [sys.executable, "scripts/concealed_trial.py", f"cases={cases}", f"out={out}", "seed=52", "jobs=2"]
        command += ["strength=strong", "channels=full"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1200)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return json.loads((out / "scoreboard.json").read_text())["tools"]["manoeuvre_nn"]


def test_every_case_is_answered(tool, cases):
    assert tool["board"]["totals"]["answered"]["right"] == cases
    assert tool["board"]["notes"] == {}


@pytest.mark.parametrize("cases", [4], indirect=True)
def test_clean_cases_raise_no_alarm(tool):
    alarms = tool["board"]["totals"]["false alarms"]
    assert alarms is not None
    assert alarms["right"] == 0


def test_strong_effects_of_the_list_are_named_and_no_prediction_is_made_worse(tool, cases):
    clear = [case for case in tool["cases"] if case["truth"] and "unknown" not in case["truth"]]
    assert len(clear) == max(1, cases // 2)
    assert [case["case"] for case in clear if not case["first_right"]] == []
    assert tool["board"]["totals"]["predictions made worse"]["right"] == 0
