"""Whatever text a file of settings holds: plain values, the same that were written, or one line."""

import json
from math import isfinite

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from manoeuvre_nn.core.data_files import REFUSED, check_plain, load_json, load_yaml
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import OBEYED, as_file_name, check_name, harmless
from manoeuvre_nn.core.prime import bis_system, length_system
from manoeuvre_nn.diagnosis.manifest import read_manifest
from manoeuvre_nn.recording.read.mapping_file import read_mapping

words = st.text(st.characters(blacklist_categories=["Cs"]), max_size=12).filter(lambda word: not REFUSED.search(word))
plain = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(allow_nan=False), words),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(words, inner, max_size=4)),
    max_leaves=12,
)
keys = st.sampled_from("time channels psi column unit runs ship format frame << _target_".split())
snippets = st.sampled_from("&a *a !!python/name:os.system !!int ? - { } [ ] | ' \"".split()).map("{} ".format)
texts = st.one_of(
    st.text(max_size=200),
    st.lists(st.one_of(snippets, keys.map("{}: ".format), words, st.just("\n")), max_size=20).map("".join),
)


def value_or_line(load, path):
    """What a file says; None if it was refused in one line."""
    try:
        return load(path)
    except InputError as error:
        line = str(error)
        assert "\n" not in line and not OBEYED.search(line) and len(line) < 700
        return None


@given(texts)
def test_any_text_is_plain_values_or_refused_in_one_line(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("a") / "manifest.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    for load in (load_yaml, load_json, read_mapping, lambda place: read_manifest(place.parent)):
        value_or_line(load, path)


@given(plain)
def test_what_was_written_is_read(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("a") / "file"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert load_json(path) == content
    path.write_text(yaml.safe_dump(content, allow_unicode=False), encoding="utf-8")
    assert load_yaml(path) == content


@given(st.dictionaries(st.sampled_from(["psi", "u", "_target_", "_args_", "colour"]), plain, max_size=3))
def test_settings_are_plain_or_refused(content):
    names_code = any(key.startswith("_") for key in _keys(content)) or "${" in str(content)
    if names_code:
        with pytest.raises(InputError):
            check_plain(content, "mine")
    else:
        check_plain(content, "mine")


def _keys(value):
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return {*(value if isinstance(value, dict) else ()), *(key for part in inner for key in _keys(part))}


@given(st.text(max_size=200))
def test_no_text_keeps_what_a_terminal_or_a_path_would_obey(text):
    assert not OBEYED.search(harmless(text))
    assert harmless(text) == text or OBEYED.search(text)
    assert not set("/\\ \n") & set(as_file_name(text))
    try:
        name = check_name("name", text)
    except InputError as error:
        assert "\n" not in str(error) and not OBEYED.search(str(error))
    else:
        assert name == text and not set("/\\\n") & set(name) and not name.startswith(".")


@given(st.floats(1.0, 500.0), st.floats(0.1, 30.0), st.floats(1e3, 1e9), st.floats(-10.0, 10.0))
def test_the_units_of_a_prime_system_fit_each_other(length, speed, mass, number):
    """F = m a, N = I rdot with I over m L^2, and what is made non-dimensional comes back."""
    for prime in (length_system(length, speed), bis_system(length, mass)):
        velocity, _, rate = prime.velocity_units
        linear, _, angular = prime.acceleration_units
        time = prime.length / prime.speed
        assert velocity / time == pytest.approx(linear) and rate / time == pytest.approx(angular)
        assert prime.mass * linear == pytest.approx(prime.force)
        assert prime.mass * prime.length**2 * angular == pytest.approx(prime.moment)
        assert number / prime.moment * prime.moment == pytest.approx(number) and isfinite(prime.force)
