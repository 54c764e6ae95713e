from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from manoeuvre_nn.commands.config import (
    as_list,
    named_manoeuvres,
    read_mapping,
    training_manoeuvres,
)
from manoeuvre_nn.commands.job import make_fit, prepare
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.data_files import load_yaml
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.manoeuvre.zigzag import mixed_zigzag, zigzag
from manoeuvre_nn.network.perceptron import rajesh_network, wang_network
from manoeuvre_nn.recording.read.mapping_file import read_captive_mapping
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.own import own_particulars

CONF = Path(__file__).parents[2] / "conf"


def options(group: str) -> list[str]:
    return sorted(p.stem for p in (CONF / group).glob("*.yaml"))


def fits(network: str, fit: str) -> bool:
    series = network in {"cubic", "modulus", "abkowitz"}
    own = {"ensemble": network.startswith("hull_rudder"), "closed_loop": series, "recursive": network == "recursive",
           "radial_basis": network == "rbf", "general_regression": network == "grnn"}  # fmt: skip
    return own[fit] if fit in own else not any(own.values())


FIXED = [name for name in options("manoeuvre") if name.startswith(("zz", "tc"))]


def test_there_is_something_to_test():
    assert len(FIXED) >= 19 and {"mariner", "esso_190k"} <= set(options("ship"))


@pytest.mark.parametrize("name", options("manoeuvre"))
def test_every_manoeuvre_can_be_made_and_a_fixed_one_is_named_as_its_file(name):
    made, *others = named_manoeuvres([name], None)
    assert made.largest_order <= 35.1 * torch.pi / 180
    assert len({m.name for m in [made, *others]}) == 1 + len(others)
    if name in FIXED:
        assert made.name == name
        port = made.stages[0].order < 0
        assert port == name.endswith("_port")


def test_several_manoeuvres_at_one_speed(composed):
    made = training_manoeuvres(composed("manoeuvre=[zz35,tc20]", "manoeuvre.speed_kn=10").manoeuvre)
    assert [m.name for m in made] == ["zz35", "tc20"]
    assert {round(m.speed, 6) for m in made} == {round(10 * 1852 / 3600, 6)}


def prepared(composed, *words):
    return prepare(composed(*words))


@pytest.mark.parametrize("name", options("ship"))
def test_every_ship_can_be_prepared_or_says_that_it_needs_recordings(name, composed):
    if name.startswith("kvlcc2") or name in {"esso_osaka_model", "s175"}:
        with pytest.raises(InputError, match="write data=recording"):
            prepared(composed, f"ship={name}")
    else:
        job = prepared(composed, f"ship={name}")
        assert len(job.data.score_manoeuvres) == 3


def test_every_effect_can_be_prepared_with_the_values_of_its_file(composed):
    names = options("effect")
    cfg = composed(f"effect=[{','.join(names)}]", "manoeuvre.speed_kn=10")
    effects = {e.name: e for e in prepare(cfg).data.effects}
    assert len(names) > 20 and list(effects) == names
    for name, effect in effects.items():
        given = {p.name: float(v) for p, v in zip(effect.declared, effect.values, strict=True)}
        if name == "remainder":  # its weights are learned, not written down
            continue
        assert given == {k: v for k, v in cfg.effect[name].items() if k in given}, name
        assert round(effect.ship.particulars.speed, 6) == round(10 * 1852 / 3600, 6)


def test_without_effects_the_ship_sails_in_calm_water(composed):
    assert "effect" not in composed() and prepared(composed).data.effects == []
    assert type(prepared(composed).data.ship.calm) is CalmWater


def test_effects_are_set_on_the_command_line(composed):
    data = prepared(composed, "effect=[current,wind_steady]", "effect.wind_steady.speed=12").data
    assert [(e.name, float(e.values[0])) for e in data.effects] == [("current", 0.5), ("wind_steady", 12.0)]
    assert list(data.ship.effects) == data.effects


GIVEN = ["linear.inertia.mx=.8", "linear.inertia.my=1.5", "linear.inertia.mz=.08"]


@pytest.mark.parametrize("name", options("linear"))
def test_every_known_part_can_be_prepared(name, composed):
    job = prepared(composed, f"linear={name}", *(GIVEN if name == "given" else ()))
    force = job.data.known.force(torch.tensor([7.0, 0.5, 0.01]).double(), torch.tensor(0.2).double())
    assert bool(force.abs().max() > 0) == (name == "clarke")


OF_PITCH = ("cepowski2007", "structure")
"""Experiments of task=pitch: see test_pitch_command.py."""


@pytest.mark.parametrize(
    "words",
    [[f"network={name}", f"fit={fit}"] for name in options("network") for fit in options("fit") if fits(name, fit)]
    + [[f"experiment={name}"] for name in options("experiment") if name not in OF_PITCH],
    ids=str,
)
def test_every_network_fit_and_experiment_can_be_made(words, composed):
    cfg = composed(*words, "data.length=100", "score=[{zz5: {duration: 50}}]")
    job = prepare(cfg)
    job.data.setup()
    fit = make_fit(cfg, job)
    x = job.data.tuples.inputs
    if isinstance(fit.dynamics, IdentifiedShip):
        assert fit.unknown_force(x.to(job.dtype)).shape == (len(x), 3)
        fit.configure_optimizers()  # that of a recursive fit comes with its windows, which a trainer makes


@pytest.mark.parametrize("name", options("recording"))
def test_every_mapping_can_be_read(name):
    if "columns" in load_yaml(CONF / "recording" / f"{name}.yaml"):
        assert {"beta", "delta", "X", "Y", "N"} <= set(read_captive_mapping(name).columns)
    else:
        made = read_mapping(name)
        assert made.is_record or "psi" in made.channels


def test_the_experiments_are_what_their_sources_did(composed):
    wang, rajesh = composed("experiment=wang1996"), composed("experiment=rajesh2009")
    assert (wang.network.hidden, wang.data.length, wang.fit.schedule.rates[2]) == (11, 360, 1e-6)
    assert wang.fit._target_.endswith("BackpropFit") and "zz35" in wang.manoeuvre
    assert (rajesh.network.hidden, rajesh.data.length, rajesh.network.scaling) == (15, 1500, "source")
    assert rajesh.linear._target_.endswith("no_part") and "zz20" in rajesh.manoeuvre


def test_no_manoeuvre_of_the_default_score_is_trained_on(composed):
    for name in ("zz20", "tc25", "tc25_port"):
        job = prepared(composed, f"manoeuvre={name}")
        assert name not in {m.name for m in job.data.score_manoeuvres}
    with pytest.raises(InputError, match="zz20 is both in manoeuvre= and in score="):
        prepared(composed, "manoeuvre=zz20", "score=[zz20]")


def test_a_manoeuvre_to_score_may_have_settings_of_its_own():
    (made,) = named_manoeuvres([{"zz20": {"duration": 77}}], None)
    assert (made.name, made.duration) == ("zz20", 77)
    for wrong in ({"zz20": 5}, {}, {"zz20": {}, "zz10": {}}):
        with pytest.raises(InputError, match="score has an entry"):
            named_manoeuvres([wrong], None)


ZIGZAG = {"_target_": "manoeuvre_nn.manoeuvre.zigzag.zigzag", "rudder_deg": 20}
HOSTILE = [
    {"_target_": "os.system", "command": "true"},
    {"_target_": "manoeuvre_nn.commands.guard.os.system", "command": "true"},
    {"_target_": "manoeuvre_nn.training.checkpoint.pickle.loads", "data": b""},
    {"_target_": "manoeuvre_nn_evil.run"},
    {"_target_": "manoeuvre_nn.manoeuvre.zigzag.zigzag.__class__"},
    {"_target_": "builtins.eval"},
]


@pytest.mark.parametrize("hostile", HOSTILE, ids=lambda h: h["_target_"])
@pytest.mark.parametrize("nest", [lambda h: h, lambda h: ZIGZAG | {"x": [{"deep": h}]}], ids=["plain", "nested"])
def test_what_lies_outside_the_package_is_refused_and_not_run(hostile, nest, monkeypatch):
    monkeypatch.setattr("os.system", lambda *_, **__: pytest.fail("it was run"))
    for form in (nest(hostile), OmegaConf.create(nest({k: v for k, v in hostile.items() if k != "data"}))):
        with pytest.raises(
            InputError, match="is refused; (a config may only name things in manoeuvre_nn|settings are plain)"
        ):
            build(form, "manoeuvre")


def test_a_target_that_leads_nowhere_is_refused():
    for name in ("manoeuvre_nn.manoeuvre.nope.thing", "manoeuvre_nn.manoeuvre.zigzag.zagzig"):
        with pytest.raises(InputError, match=f"{name} does not exist"):
            build({"_target_": name}, "manoeuvre")


def test_objects_are_passed_on_as_they_are():
    ship = mariner()
    made = build({"_target_": "manoeuvre_nn.effect.current.Current", "speed": 1.0}, "effect", ship=ship)
    assert made.ship is ship


@pytest.mark.parametrize(
    "target, settings, told",
    [
        (
            zigzag,
            {"rudder_deg": 20, "foo": 1},
            "manoeuvre.foo: there is no such setting; those of zigzag are: rudder_deg, heading_deg, first, executes, "
            "duration, start_deg, name",
        ),
        (
            own_particulars,
            {"name": "ferry", "length": 120, "breadth": 20, "draught": 5, "block": 0.6, "speed_kn": 18},
            "ship.beam is missing: write it in the yaml, in the place of breadth",
        ),
        (
            zigzag,
            {"rudder": 20},
            "manoeuvre.rudder_deg is missing: write it in the yaml, in the place of rudder",
        ),
        (wang_network, {"hidden": "many"}, "network.hidden=many: expected a whole number"),
        (wang_network, {"hidden": 3.5}, "network.hidden=3.5: expected a whole number from -1e+09 to 1e+09"),
        (wang_network, {"spread": 10**21}, f"network.spread={10**21}: expected a number from 1e-06 to 1e+06"),
        (wang_network, {"spread": "wide"}, "network.spread=wide: expected a number from 1e-06 to 1e+06"),
        (zigzag, {"rudder_deg": 20, "duration": "long"}, "manoeuvre.duration=long: expected a number or null"),
        (wang_network, {"spread": 1e12}, "network.spread=1000000000000.0: expected a number from 1e-06 to 1e+06"),
        (wang_network, {"activation": 3}, "network.activation=3: expected sigmoid or tanh"),
        (wang_network, {"spread": float("inf")}, "network.spread=inf: expected a number from 1e-06 to 1e+06"),
        (
            mixed_zigzag,
            {"rudder_deg": 20},
            "manoeuvre.rudder_deg=20: expected numbers in brackets such as rudder_deg=[5,10,20]",
        ),
        (
            mixed_zigzag,
            {"heading_deg": ["far"]},
            "manoeuvre.heading_deg=['far']: expected numbers in brackets such as heading_deg=[5,10,20] or null",
        ),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused(target, settings, told):
    with pytest.raises(InputError) as refusal:
        build({"_target_": f"{target.__module__}.{target.__name__}", **settings}, target.__module__.split(".")[1])
    assert str(refusal.value) == told


def test_settings_that_a_config_leaves_out_are_those_of_the_function():
    made = build(
        {"_target_": "manoeuvre_nn.network.perceptron.rajesh_network", "activation": "tanh"}, "network", seed=3
    )
    assert made.activation == "tanh" and torch.equal(made.input_weights, rajesh_network(seed=3).input_weights)


def test_whole_numbers_do_where_a_number_is_expected():
    assert build(ZIGZAG | {"duration": 60}, "manoeuvre").duration == 60


def test_a_name_and_a_list_are_alike():
    assert as_list("zz20") == as_list(["zz20"]) == as_list(OmegaConf.create(["zz20"])) == ["zz20"]


def test_a_yaml_that_is_none_is_refused(tmp_path):
    path = tmp_path / "m.yaml"
    with pytest.raises(InputError, match="does not exist: write the path of a yaml file"):
        load_yaml(path)
    for content in (b"a: [1, 2", b"\xff\xfe\x00", b"a: b: c"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="is no valid yaml") as refusal:
            load_yaml(path)
        assert "\n" not in str(refusal.value)


def test_an_experiment_may_say_what_it_is_scored_on_and_the_command_line_has_the_last_word(composed):
    assert list(composed("experiment=rajesh2009").score) == ["zz25", "zz15", "zz10", "tc15", "tc20", "tc25"]
    assert composed("experiment=rajesh2009", "score=zz10").score == "zz10"


@pytest.mark.parametrize("job", ["train", "coefficients"])
def test_measured_files_choose_a_series_in_closed_loop_unless_told_otherwise(job):
    with initialize_config_dir(str(CONF), version_base=None):
        usual = compose(job, ["data=recording"])
        other = compose(job, ["data=recording", "network=hull_rudder", "fit=ensemble"])
    assert usual.network["_target_"].endswith("Series") and usual.fit["_target_"].endswith("ClosedLoopFit")
    assert usual.linear["_target_"].endswith("clarke_inertia_part")
    assert usual.data["_target_"] == other.data["_target_"] and usual.data["_target_"].endswith("recorded_files")
    assert other.network["_target_"].endswith("HullRudder") and other.fit["_target_"].endswith("EnsembleFit")


def test_advice_is_asked_of_an_ensemble_from_measured_files_too():
    with initialize_config_dir(str(CONF), version_base=None):
        cfg = compose("excite", ["data=files"])
    assert cfg.network["_target_"].endswith("HullRudder") and cfg.data["_target_"].endswith("recorded_files")


def test_a_key_that_stands_twice_in_a_yaml_is_refused_with_its_line(tmp_path):
    (tmp_path / "a.yaml").write_text("frame: body\nchannels:\n  u: {column: u, column: v}\n")
    with pytest.raises(InputError, match="a.yaml, line 3 is no valid yaml: column stands twice"):
        load_yaml(tmp_path / "a.yaml")
    (tmp_path / "c.yaml").write_text("? [u, v]\n: 1\n")
    with pytest.raises(InputError, match="c.yaml, line 1 is no valid yaml: found unhashable key"):
        load_yaml(tmp_path / "c.yaml")
    (tmp_path / "b.yaml").write_text("a: &x {b: 1}\nc: {<<: *x, d: 2}\n")
    assert load_yaml(tmp_path / "b.yaml") == {"a": {"b": 1}, "c": {"b": 1, "d": 2}}


@pytest.mark.parametrize("command", ["train", "check", "coefficients", "excite"])
def test_a_config_that_is_composed_from_python_has_a_name(command, monkeypatch):
    monkeypatch.setattr(HydraConfig.instance(), "cfg", None)  # as in a process where no command ran before
    with initialize_config_dir(str(CONF), version_base=None):
        cfg = compose(command, ["ship=esso_190k"])
    assert OmegaConf.to_container(cfg, resolve=True)["name"].startswith("esso_190k_")
