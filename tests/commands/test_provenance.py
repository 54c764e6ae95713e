import json

import pytest
import yaml

from manoeuvre_nn.commands.provenance import check_same_run, flat, versions, write_provenance
from manoeuvre_nn.commands.train import finished
from manoeuvre_nn.core.errors import InputError


def test_the_same_settings_may_go_on(composed, tmp_path):
    check_same_run(composed(), tmp_path / "not there yet")
    write_provenance(composed("data.noise.u=1e-3", "network=wang", "fit=backprop"), tmp_path)
    check_same_run(composed("data.noise.u=0.001", "network=wang", "fit=backprop"), tmp_path)


@pytest.mark.parametrize(
    "word, key",
    [
        ("network.hidden=7", "network.hidden=12, this one has network.hidden=7"),
        ("seed=1", "seed=0, this one has seed=1"),
        ("trainer.keep=best", "trainer.keep=last"),
        ("score=[zz10]", "score=default"),
        ("manoeuvre=zz30", "manoeuvre.zz30._target_=None"),
    ],
)
def test_other_settings_are_refused_by_name(composed, tmp_path, word, key):
    write_provenance(composed(), tmp_path)
    with pytest.raises(InputError) as refusal:
        check_same_run(composed(word), tmp_path)
    message = str(refusal.value)
    assert key in message and str(tmp_path) in message and "choose another out" in message
    assert "\n" not in message


@pytest.mark.parametrize("word", ["trainer.max_epochs=900", "trainer.progress=false", "trainer.resume=never"])
def test_how_long_and_how_loud_may_differ(composed, tmp_path, word):
    write_provenance(composed(), tmp_path)
    check_same_run(composed(word), tmp_path)


@pytest.mark.parametrize("content", [b"", b"a: [", b"just words", b"- 1\n- 2\n", b"\xff\xfe\x00\x80", b"null"])
def test_a_damaged_config_is_refused(composed, tmp_path, content):
    (tmp_path / "config.yaml").write_bytes(content)
    with pytest.raises(InputError, match="is damaged: remove the folder or choose another out"):
        check_same_run(composed(), tmp_path)


def test_the_config_is_written_resolved_and_with_versions(composed, tmp_path):
    write_provenance(composed("manoeuvre=zigzag", "manoeuvre.zigzag.rudder_deg=15"), tmp_path)
    written = yaml.safe_load((tmp_path / "config.yaml").read_text())
    assert written["manoeuvre"]["zigzag"]["heading_deg"] == 15
    assert written["versions"] == versions()
    assert all(versions()[name] for name in ("python", "torch", "lightning", "manoeuvre-nn"))


def test_flat_settings_join_the_keys():
    assert flat({"a": {"b": 1, "c": {"d": [1, 2]}}, "e": {}}) == {"a.b": 1, "a.c.d": [1, 2], "e": {}}


def test_a_run_is_finished_when_its_scores_are_written_and_nothing_more_is_asked_for(tmp_path):
    assert not finished(tmp_path, 10)
    scores = tmp_path / "scores.json"
    for stopped, epochs, asked, expected in (
        ("all epochs done", 10, 10, True),
        ("all epochs done", 10, 20, False),
        ("goal reached", 10, 20, True),
        ("no better held-out score", 10, 20, True),
        ("ctrl-C", 4, 10, False),
    ):
        scores.write_text(json.dumps({"training": {"stopped": stopped, "epochs": epochs}}))
        assert finished(tmp_path, asked) is expected, stopped
    for damaged in ("", "{", "[]", "{}"):
        scores.write_text(damaged)
        assert not finished(tmp_path, 10)
