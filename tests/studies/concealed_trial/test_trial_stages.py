"""The three stages and the script that runs them, with a tool that answers at once."""

import importlib.util
import json
import os
import subprocess
import sys
import time
from concurrent.futures import Future
from pathlib import Path

import pytest

from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial import stages
from studies.concealed_trial.commitments import METHOD, commitment
from studies.concealed_trial.drawing import Trial, case_name
from studies.concealed_trial.rivals.ablations import PARTS
from studies.concealed_trial.stages import answer, generate, score

SCRIPT = Path(__file__).parents[3] / "scripts" / "concealed_trial.py"
TOOL = """
import json, os, sys
from pathlib import Path
given = dict(word.split("=", 1) for word in sys.argv[1:])
for case in sorted(Path(given["cases"]).iterdir()):
    out = Path(given["out"]) / case.name
    out.mkdir(parents=True)
    seen, path = sorted(os.environ), sys.path[1:]
    (out / "answer.json").write_text(json.dumps({"verdict": "none", "effects": [], "seen": seen, "path": path}))
"""


class Drawn:
    """A case that costs nothing to draw."""

    def __init__(self, seed, index):
        self.name, self.salt = case_name(seed, index), f"salt {seed} {index}"

    def answers(self):
        return {"case": self.name, "ship": "mariner", "verdict": "none", "effects": []}


class InThisProcess:
    """Stands for a pool of processes."""

    def __init__(self, jobs):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future


@pytest.fixture
def quick(monkeypatch):
    """Cases that are drawn and written at once, in this process."""

    def write(case, folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "manifest.json").write_text(case.name)

    monkeypatch.setattr(stages, "ProcessPoolExecutor", InThisProcess)
    monkeypatch.setattr(stages, "draw_case", lambda seed, index, plan, nuisance: Drawn(seed, index))
    monkeypatch.setattr(stages, "write_case", write)
    monkeypatch.setattr(stages, "POLL", 0.05)


def test_generated_cases_are_committed_to_and_kept(quick, tmp_path):
    trial = Trial(5, 4)
    generate(trial, tmp_path, 1)
    published = json.loads((tmp_path / "commitments.json").read_text())
    drawn = [Drawn(5, k) for k in range(4)]
    assert published["method"] == METHOD
    assert published["commitments"] == {c.name: commitment(c.salt, c.answers()) for c in drawn}
    assert "seed" not in published["trial"]
    manifest = tmp_path / "recordings" / drawn[0].name / "manifest.json"
    manifest.write_text("kept")
    (tmp_path / "recordings" / drawn[1].name / "manifest.json").unlink()
    generate(trial, tmp_path, 1)
    assert manifest.read_text() == "kept"
    assert (tmp_path / "recordings" / drawn[1].name / "manifest.json").is_file()


@pytest.mark.parametrize("other", [Trial(6, 4), Trial(5, 3), Trial(5, 4, 0.5), Trial(5, 4, sort="clean")])
def test_a_folder_with_another_trial_is_refused(quick, tmp_path, other):
    generate(Trial(5, 4), tmp_path, 1)
    with pytest.raises(InputError, match="holds another trial"):
        generate(other, tmp_path, 1)


def test_a_tool_answers_what_is_not_answered_yet_in_a_clean_environment(quick, tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET_SEED", "5")
    generate(Trial(5, 5), tmp_path, 1)
    tool, answers = tmp_path / "tool.py", tmp_path / "answers"
    tool.write_text(TOOL)
    (tmp_path / "src").mkdir()
    first = case_name(5, 0)
    (answers / first).mkdir(parents=True)
    (answers / first / "answer.json").write_text("{}")
    command = (sys.executable, str(tool), "cases={cases}", "out={out}")
    answer(tmp_path / "recordings", answers, command, 2, root=tmp_path, method="tool")
    found = {path.parent.name: json.loads(path.read_text()) for path in answers.glob("*/answer.json")}
    assert sorted(found) == sorted(case_name(5, k) for k in range(5))
    assert found[first] == {}
    seen = set(found[case_name(5, 1)]["seen"])
    assert "SECRET_SEED" not in seen
    assert "OMP_NUM_THREADS" in seen
    assert found[case_name(5, 1)]["path"][0] == str(tmp_path / "src"), "its own checkout, whatever is installed"


def test_a_tool_that_fails_is_reported_with_its_log(quick, tmp_path):
    generate(Trial(5, 1), tmp_path, 1)
    command = (sys.executable, "-c", "raise SystemExit(3)")
    with pytest.raises(InputError, match=r"tool ended with code 3 .* see .*1\.log"):
        answer(tmp_path / "recordings", tmp_path / "answers", command, 2, root=tmp_path, method="tool")


def test_a_case_that_a_tool_refuses_stops_no_trial(quick, tmp_path):
    generate(Trial(5, 1), tmp_path, 1)
    answers = tmp_path / "answers"
    refused = answers / case_name(5, 0) / "error.txt"
    write = (
        f"import pathlib; p = pathlib.Path({str(refused)!r}); p.parent.mkdir(); p.write_text('no'); raise SystemExit(1)"
    )
    answer(tmp_path / "recordings", answers, (sys.executable, "-c", write), 1, root=tmp_path, method="tool")
    assert refused.is_file() and not list(answers.glob("*/answer.json"))
    died = (sys.executable, "-c", "raise SystemExit(3)")
    with pytest.raises(InputError, match="tool ended with code 3"):  # what was left before is no excuse
        answer(tmp_path / "recordings", answers, died, 1, root=tmp_path, method="tool")


def test_scoring_refuses_a_trial_whose_commitments_were_changed(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(stages, "score_case", lambda *_: pytest.fail("scored before it was checked"))
    generate(Trial(5, 1), tmp_path, 1)
    path = tmp_path / "commitments.json"
    published = json.loads(path.read_text())
    path.write_text(json.dumps(published | {"commitments": {case_name(5, 0): "0" * 64}}))
    with pytest.raises(InputError, match="is not the one in commitments.json"):
        score(Trial(5, 1), tmp_path, {"tool": tmp_path / "answers"}, 1)


def test_scoring_without_a_trial_says_so(tmp_path):
    with pytest.raises(InputError, match="generate the trial first"):
        score(Trial(5, 1), tmp_path, {}, 1)


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("concealed_trial", SCRIPT)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_the_diagnosis_without_each_of_its_parts_is_a_method(script):
    assert [name for name in script.METHODS if name.startswith("without_")] == [f"without_{part}" for part in PARTS]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["seed=x"], "seed=x: expected a whole number, 0 or more"),
        ([], "seed=: expected a whole number"),
        (["seed=1", "cases=0"], "cases=0: expected a whole number, 1 or more"),
        (["seed=1", "jobs=257"], "jobs=257: expected a whole number, 1 to 256"),
        (["seed=1", "case=3"], "'case=3' is not understood; write cases=..."),
        (["seed=1", "methods=guess"], "'guess' is unknown; choose from: manoeuvre_nn"),
        (["seed=1", "nuisance=5"], "nuisance=5: write a number from 0"),
        (["seed=1", "sort=none"], "sort=none: choose from: all, clean, single"),
        (["seed=1", "strength=huge"], "strength=huge: choose from: all, weak, moderate, strong, extreme"),
        (["seed=1", "channels=few"], "channels=few: choose from: all, full"),
        (["seed=1", "strict=yes"], "strict=yes: choose from: true, false"),
    ],
)
def test_the_script_ends_in_one_line_on_a_wrong_argument(script, words, message):
    with pytest.raises(InputError) as caught:
        script.main(words)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_stage_ends_when_the_trial_is_killed():
    stage = f"{[sys.executable, '-c', 'import os, time; print(os.getpid(), flush=True); time.sleep(60)']}"
    code = f"import runpy; runpy.run_path({str(SCRIPT)!r})['in_process']({stage}, '')"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as trial:
        assert trial.stdout is not None
        pid = int(trial.stdout.readline())
        trial.kill()
    until = time.monotonic() + 10
    while Path(f"/proc/{pid}").exists() and time.monotonic() < until:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists()


@pytest.mark.slow
def test_the_script_says_it_on_standard_error_with_code_two():
    done = subprocess.run(
        [sys.executable, SCRIPT, "seed=x"], capture_output=True, text=True, env=dict(os.environ), check=False
    )
    assert done.returncode == 2
    assert done.stderr == "error: seed=x: expected a whole number, 0 or more\n"
