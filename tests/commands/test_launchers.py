"""Sweeps on other machines: ready configs, what is missing in a line, and how far a sweep is."""

import importlib.util

import hydra
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.groups import CONF
from manoeuvre_nn.commands.main import with_folder, with_job_names
from manoeuvre_nn.commands.sweep_table import how_far, jobs_of
from manoeuvre_nn.core.errors import InputError


def launcher(name: str):
    with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
        return hydra.compose("train", [f"hydra/launcher={name}"], return_hydra_config=True).hydra.launcher


def test_slurm_is_asked_for_one_core_and_keeps_its_notes_in_the_folder_of_the_sweep():
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    chosen = launcher("slurm")
    assert (chosen.cpus_per_task, chosen.timeout_min) == (1, 240) and chosen._target_.endswith("SlurmLauncher")


def test_a_job_on_ray_is_begun_again_where_a_worker_is_lost_and_the_clusters_memory_is_left_alone():
    pytest.importorskip("hydra_plugins.hydra_ray_launcher")
    chosen = launcher("ray_cluster").ray
    assert chosen.init == {"address": "auto", "object_store_memory": None}
    assert chosen.remote == {"num_cpus": 1, "max_retries": 3}


@pytest.mark.parametrize(
    ("missing", "extra"), [("launcher/submitit_slurm", "sweep"), ("launcher/ray", "ray"), ("sweeper/optuna", "search")]
)
def test_an_extra_that_is_missing_is_named(missing, extra):
    said = f"In 'hydra/launcher/slurm': Could not find 'hydra/{missing}'\n\nAvailable options:\n\tbasic"
    line = guard.explain(hydra.errors.MissingConfigException(said, missing))
    assert line == f"hydra/{missing.replace('/', '=')} is not installed: pip install 'manoeuvre-nn[{extra}]'"


@pytest.mark.parametrize(("ready", "needs", "extra"), [
    ("slurm", "submitit_slurm", "sweep"), ("ray_cluster", "ray", "ray"),
])  # fmt: skip
def test_a_ready_config_tells_the_extra_that_it_needs(ready, needs, extra):
    if importlib.util.find_spec(f"hydra_plugins.hydra_{needs.partition('_')[0]}_launcher") is not None:
        pytest.skip("it is installed")
    with pytest.raises(hydra.errors.HydraException) as refusal:
        launcher(ready)
    told = f"hydra/launcher={needs} is not installed: pip install 'manoeuvre-nn[{extra}]'"
    assert guard.explain(refusal.value) == told


@pytest.mark.parametrize(("words", "folder"), [
    (["seed=0", "out=a b"], "hydra.run.dir=a b"),
    (["-m", "seed=0,1", "out=a"], "hydra.sweep.dir=a"),
    (["seed=0,1", "out=a", "--multirun"], "hydra.sweep.dir=a"),
])  # fmt: skip
def test_one_word_chooses_the_folder_of_a_run_and_of_a_sweep(words, folder):
    assert with_folder(words, "diagnose") == words
    assert with_folder(words, "train") == [folder if word.startswith("out=") else word for word in words]


@pytest.mark.parametrize("word", ["out=", "out=null", "out=''"])
def test_a_folder_without_a_name_is_refused(word):
    with pytest.raises(InputError, match=f"^{word}: expected the path of a folder$"):
        with_folder(["seed=0", word], "check")


def test_the_folder_of_a_sweep_is_absolute_for_jobs_that_begin_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = with_job_names(["--multirun", "seed=0,1", "hydra.sweep.dir='my sweep'"])
    (parsed,) = OverridesParser.create().parse_overrides([w for w in words if w.startswith("hydra.sweep.dir")])
    assert str(parsed.value()) == str(tmp_path / "my sweep")


@pytest.mark.parametrize(("words", "trials", "count"), [
    (["ship=mariner", "network.hidden=2,3,4", "seed=range(0,2)"], None, 6),
    (["ship=mariner"], None, 1),
    (["network.hidden=range(2,20)"], 30, 30),
])  # fmt: skip
def test_jobs_of_a_sweep_are_counted(words, trials, count):
    sweeper = {} if trials is None else {"n_trials": trials}
    assert jobs_of(OmegaConf.create({"hydra": {"sweeper": sweeper, "overrides": {"task": words}}})) == count


def test_jobs_that_are_scored_or_failed_are_done(tmp_path):
    for name, file in (("a", "scores.json"), ("b", "error.txt"), ("c", ".hydra/overrides.yaml")):
        (tmp_path / name / file).parent.mkdir(parents=True)
        (tmp_path / name / file).write_text("[]")
    assert how_far(tmp_path, 4) == ("sweep, 2 of 4 jobs done", 0.5)
