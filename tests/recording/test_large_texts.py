"""A text is read block by block: the same cells as read line by line, in memory of the order of its columns."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest

from manoeuvre_nn.core import memory
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read import table, text
from manoeuvre_nn.recording.read.mapping_file import is_written_by_package
from manoeuvre_nn.recording.read.table import read_table

ROWS = 400


def columns(rows: int = ROWS) -> dict[str, list[str]]:
    k = np.arange(rows)
    return {
        "t": [f"{0.1 * i:.1f}" for i in k],
        "whole, then not": [f"{i}" if i < rows / 2 else f"{i}.5" for i in k],
        "empty for long": ["" if i < rows / 2 else f"{i}.25" for i in k],
        "a word at the end": [f"{i}" if i < rows - 3 else "end" for i in k],
        "seldom a note": ["note" if i % 100 == 7 else "" for i in k],
        "true, then not": ["True" if i < rows / 2 else "1" for i in k],
    }


def written(path, cells: dict[str, list[str]], delimiter: str = ",", end: str = "\n", last: str = "\n"):
    rows = [delimiter.join(row) for row in zip(*cells.values(), strict=True)]
    path.write_bytes((end.join([delimiter.join(f'"{c}"' for c in cells), *rows]) + last).encode())
    return path


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(text, "BLOCK", 256)


def by_line(monkeypatch, path, **form) -> table.Table:
    with monkeypatch.context() as m:
        m.setattr(table, "even_frame", lambda *given: None)
        return read_table(path, **form)


@pytest.mark.parametrize("end, last", [("\n", "\n"), ("\r\n", "\r\n"), ("\n", "")])
def test_block_by_block_a_text_has_the_cells_that_it_has_line_by_line(tmp_path, monkeypatch, small_blocks, end, last):
    path = written(tmp_path / "a.txt", columns(), ";", end, last)
    blocks, lines = read_table(path, delimiter=";"), by_line(monkeypatch, path, delimiter=";")
    assert blocks.cells["t"].dtype == float
    pd.testing.assert_index_equal(blocks.cells.index, lines.cells.index, exact=False)
    for name in ("t", "whole, then not", "empty for long"):
        np.testing.assert_array_equal(blocks.numbers(name), lines.numbers(name))
    for name in ("a word at the end", "seldom a note", "true, then not"):
        assert list(blocks.text(name)) == list(lines.text(name))
    for one in (blocks, lines):
        with pytest.raises(InputError, match=f"line {ROWS - 1}: column 'a word at the end' is 'end'; expected a numb"):
            one.numbers("a word at the end")


def test_columns_parted_by_blanks_are_read_in_blocks_too(tmp_path, monkeypatch, small_blocks):
    rows = [f"  {0.1 * k:.17g}\t {1e5 / (k + 1):.17g} " for k in range(ROWS)]
    path = tmp_path / "a.txt"
    path.write_text("a comment\n" + "\n".join(rows))
    form = {"delimiter": "whitespace", "header": False, "skip_rows": 1}
    blocks, lines = read_table(path, **form), by_line(monkeypatch, path, **form)
    assert blocks.cells["1"].dtype == float
    for name in ("1", "2"):
        np.testing.assert_array_equal(blocks.numbers(name), lines.numbers(name))


def test_a_unicode_text_of_a_spreadsheet_is_read_in_blocks_too(tmp_path, small_blocks):
    path = tmp_path / "a.csv"
    path.write_text("a,b\n" + "".join(f"{k},{k / 2}\n" for k in range(ROWS)), encoding="utf-16")
    assert read_table(path).cells["b"].dtype == float
    np.testing.assert_array_equal(read_table(path).numbers("b"), np.arange(ROWS) / 2)


@pytest.mark.parametrize("line", ["1,2", "1,2,3,4", ",,", "", '"1",2,3'])
def test_one_line_that_is_not_like_the_others_is_seen_in_any_block(tmp_path, small_blocks, line):
    rows = [f"{k},{k},{k}" for k in range(ROWS)]
    rows[ROWS // 2] = line
    path = tmp_path / "a.csv"
    path.write_text("a,b,c\n" + "\n".join(rows))
    assert text.even_frame(path, 1, ["a", "b", "c"], ",", "point") is None


def test_a_long_text_takes_no_more_memory_than_twice_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "BLOCK", 1 << 15)
    path = tmp_path / "long.csv"
    cells = np.random.default_rng(0).standard_normal((20_000, 8))
    pd.DataFrame(cells, columns=list("abcdefgh")).to_csv(path, index=False)
    tracemalloc.start()
    try:
        read_table(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * path.stat().st_size


def test_whose_file_it_is_is_told_by_its_top_alone(tmp_path):
    path = tmp_path / "long.csv"
    path.write_bytes(b"t [s],psi [rad],delta [rad]\n" + b"1,2,3\n" * 2000 + b"\0")
    assert len(text.lines_of(path, 5)) == 5
    assert is_written_by_package(path)  # the whole of it is no text


def test_a_text_that_does_not_fit_into_memory_is_refused_with_what_to_do(tmp_path, monkeypatch):
    path = tmp_path / "long.csv"
    path.write_text("a,b\n" + "1,2\n" * 2000)
    monkeypatch.setattr(memory, "free_memory", lambda: 5 * path.stat().st_size)
    assert len(read_table(path).cells) == 2000
    path.write_text('a,b\n"1",2\n' + "1,2\n" * 2000)
    with pytest.raises(InputError, match="GB of memory, .* are free: write it without quotes .* keep fewer samples"):
        read_table(path)
    monkeypatch.setattr(memory, "free_memory", lambda: 2 * path.stat().st_size)
    with pytest.raises(InputError, match="are free: keep fewer samples"):
        read_table(path)


def test_free_memory_is_between_nothing_and_what_the_machine_has():
    free = memory.free_memory()
    assert free is None or 1e6 < free < 1e14
