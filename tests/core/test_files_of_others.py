"""Files of others are data: whatever stands in them ends in plain values or in one line."""

import errno
import io
import json
from pathlib import Path

import pytest
from pydantic import BaseModel
from rich.table import Table

from manoeuvre_nn.core.data_files import check_plain, load_json, load_yaml, read_as, without_format
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.plain_text import as_file_name, check_name, harmless, listed
from manoeuvre_nn.core.terminal import Terminal


def refused(call, *given) -> str:
    with pytest.raises(InputError) as refusal:
        call(*given)
    line = str(refusal.value)
    assert "\n" not in line and "\x1b" not in line and len(line) < 500
    return line


@pytest.mark.parametrize(
    "text",
    [
        "a: 2020-99-99",
        "a: " + "9" * 5000,
        "a: 0x" + "f" * 5000,
        "a: !!int ''",
        "a: !!bool maybe",
        "a: !!timestamp x",
        "a: !!float abc",
        "a: &b [*b]",
        "? [1]\n: 2",
        "a: " + "[" * 1200,
        "a: !!python/object/apply:os.system [ls]",
        "a: !!python/name:os.system",
        "a: !!set {b, c}",
        "!!binary aGVsbG8=",
        'a: "\\e[31mred"',
        '"\\a": 1',
        'a: "\\ud800"',
        "a: 1\na: 2",
        "a: [" + "1," * 200_000 + "1]",
    ],
    ids=lambda text: text[:24],
)
def test_a_yaml_of_any_kind_ends_in_one_line(tmp_path, text):
    path = tmp_path / "sent.yaml"
    path.write_text(text)
    assert str(path) in refused(load_yaml, path)


def bomb(path: Path, first: str, opening: str, closing: str) -> Path:
    """A yaml of ten lines, each of which refers ten times to the one before."""
    names = "abcdefghij"
    lines = [
        f"{name}: &{name} {opening}{', '.join([f'*{before}'] * 10)}{closing}"
        for before, name in zip(names, names[1:], strict=False)
    ]
    path.write_text("\n".join([f"a: &a {first}", *lines]))
    return path


def test_references_to_references_are_counted_and_not_followed(tmp_path):
    path = bomb(tmp_path / "bomb.yaml", "[x, x, x, x, x, x, x, x, x, x]", "[", "]")
    assert "more than 300000 values" in refused(load_yaml, path)


def test_a_value_that_holds_itself_is_refused_as_such(tmp_path):
    path = tmp_path / "round.yaml"
    path.write_text("a: &b {c: [1, *b]}")
    assert "holds itself" in refused(load_yaml, path)


def test_mappings_merged_ten_times_over_are_refused_or_read_once(tmp_path):
    path = bomb(tmp_path / "bomb.yaml", "{x: 1}", "{<<: [", "]}")
    try:
        assert load_yaml(path) == dict.fromkeys("abcdefghij", {"x": 1})  # since PyYAML 6.0.4
    except InputError as refusal:
        assert "more than 300000 values" in str(refusal)


@pytest.mark.parametrize("text", ["{", "[" * 100_000, '{"a": "\\u001b[2J"}', "9" * 5000, "\x00", '{"a": "\\ud83d"}'])
def test_a_json_of_any_kind_ends_in_one_line(tmp_path, text):
    path = tmp_path / "sent.json"
    path.write_text(text)
    assert str(path) in refused(load_json, path)


def test_a_whole_number_that_no_float_holds_is_refused(tmp_path):
    """Of 1024 bits some round to 2^1024, which is infinite."""
    path = tmp_path / "sent.yaml"
    path.write_text(f"a: {2**1023 - 1}")
    assert load_yaml(path) == {"a": 2**1023 - 1}
    path.write_text(f"a: {2**1023}")
    assert "larger than anything counts" in refused(load_yaml, path)


def test_what_is_no_file_is_not_waited_for(tmp_path):
    assert "is no file" in refused(load_yaml, type(tmp_path)("/dev/zero"))
    assert "is a folder" in refused(load_json, tmp_path)


@pytest.mark.parametrize("value", [{"_target_": "os.system"}, {"a": [{"_args_": 1}]}, "${oc.env:HOME}", b"x", {1, 2}])
def test_settings_name_no_code_and_refer_to_nothing(value):
    refused(check_plain, {"deep": [value]}, "sent.yaml")


def test_the_form_of_a_file_is_known_or_refused():
    assert without_format({"a": 1}, "sent.yaml") == without_format({"a": 1, "format": 1}, "sent.yaml") == {"a": 1}
    for form in (2, 0, True, 1.0, "1", None, [1]):
        assert "this version reads 1" in refused(without_format, {"format": form}, "sent.yaml")


class _Sent(BaseModel):
    name: str
    parts: list[dict[str, int]]


def test_a_schema_says_where_what_stands_and_what_was_expected():
    assert read_as(_Sent, {"name": "a", "parts": [{"b": 1}], "more": 2}, "sent.json").parts == [{"b": 1}]
    assert "sent.json: parts.0.b is 'x\\n': input" in refused(
        read_as, _Sent, {"name": "a", "parts": [{"b": "x\n"}]}, "sent.json"
    )
    assert refused(read_as, _Sent, {"name": "a"}, "sent.json") == "sent.json: parts: field required"
    assert "all of it is None" in refused(read_as, _Sent, None, "sent.json")


@pytest.mark.parametrize(
    "name", ["", "..", ".hidden", "../up", "/etc/passwd", "a/b", "a\\b", "a\nb", "a\x1b[2J", " a", "x" * 300, None, 3]
)
def test_a_name_leads_nowhere(name):
    refused(check_name, "run", name)
    if isinstance(name, str):
        refused(lambda: Manoeuvre(name, "straight", (Stage(0.0),)))


def test_a_text_becomes_a_part_of_a_files_name():
    assert as_file_name("zz20/time series") == "zz20_time_series"
    assert as_file_name("../../x\x1b\\y") == ".._.._x__y"
    assert check_name("run", "Küste r.01") == "Küste r.01"


def test_control_characters_are_shown_and_not_obeyed():
    assert harmless("a\x1b[31m\x07\u202eb\x9b") == r"a\x1b[31m\x07\u202eb\x9b"
    assert harmless("Küste, 5°\tψ\n") == "Küste, 5°\tψ\n"


def test_the_terminal_shows_texts_as_they_are():
    shown, table = io.StringIO(), Table(title="t\x1b]0;mine\x07")
    table.add_column("head\x1b[2J")
    table.add_row("cell\x9b31m")
    console = Terminal(file=shown, force_terminal=True, width=100)
    console.print("a [/b] [link=http://x]y[/link] :smile: \x1b[2J", style="red", highlight=False)
    console.print(table)
    text = shown.getvalue()
    assert "[/b] [link=http://x]y[/link] :smile:" in text.replace("\x1b[0m", "").replace("\x1b[31m", "")
    assert not any(code in text for code in ("\x1b[2J", "\x1b]0", "\x07", "\x9b"))
    assert "\x1b[31m" in text  # colours of our own are there
    assert json.dumps("\\x1b[2J")[1:-1].replace("\\\\", "\\") in text


def test_a_file_that_the_system_does_not_read_is_refused(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(errno.EIO, "Input/output error")

    path = tmp_path / "sent.yaml"
    path.write_text("a: 1")
    monkeypatch.setattr(Path, "read_text", fail)
    assert "cannot be read: Input/output error" in refused(load_yaml, path)


def test_an_error_lists_names_that_fit_a_line():
    assert listed(["t", "u"]) == "t, u" and listed([]) == "none"
    assert listed(["x" * 25, "y" * 26]) == f"{'x' * 25}, {'y' * 22}..."
    line = listed([f"{k:060d}" for k in range(1000)])
    assert line.endswith(" and 980 more") and len(line) < 600
