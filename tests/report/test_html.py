import base64
from html.parser import HTMLParser
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from manoeuvre_nn.report.figures import time_series_figure
from manoeuvre_nn.report.html import Report, data_address, save_figures, write_page, write_report

EVIL = "<script>alert('x')</script> & \"quoted\""
OUTSIDE = ("src", "href", "srcset", "data", "action", "poster")


class Page(HTMLParser):
    """Tags, addresses and text of a page in their order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in OUTSIDE]

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> str:
    figures = {name: Figure(figsize=(1, 1)) for name in ("zz20/track", "zz20/time series", "training/learning curve")}
    path = write_report(
        tmp_path_factory.mktemp("report") / "deep" / "report.html",
        Report(
            title=f"Report {EVIL}",
            summary=f"All went well {EVIL}",
            tables={
                f"Scores {EVIL}": [{"manoeuvre": EVIL, "status": "ok", "dev/L": 0.12345}],
                "All criteria": [{"criterion": str(k)} for k in range(13)],
                "Nothing": [],
            },
            figures=figures,
            config={"ship": EVIL},
            versions={"torch": EVIL},
            notes=[EVIL],
        ),
    )
    return Path(path).read_text(encoding="utf-8")


def test_nothing_is_loaded_from_anywhere(written):
    addresses = [address for address in Page(written).addresses if not address.startswith("#part")]
    assert len(addresses) == 3
    assert all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert "link" not in Page(written).tags
    assert "@import" not in written
    assert "url(" not in written


def test_everything_that_is_given_is_escaped(written):
    page = Page(written)
    assert "script" not in page.tags
    assert "".join(page.words).count(EVIL) == 9


def test_the_verdict_comes_before_the_tables_and_these_before_the_figures(written):
    words = "\n".join(Page(written).words)
    assert written.index("<p class=") < written.index("<table>") < written.index("<img")
    assert words.index("All went well") < words.index("Scores") < words.index("\nzz20\n") < words.index("\nTraining\n")
    assert 'alt="Training: learning curve"' in written
    assert words.index("Training") < words.index("Resolved configuration")


def test_long_tables_are_folded_away_and_empty_ones_left_out(written):
    assert "13 rows" in written
    assert Page(written).tags.count("details") == 3 + 2  # those of the columns of both tables
    assert "Nothing" not in written


def test_numbers_stand_right_and_status_words_are_coloured(written):
    assert '<td class="number">0.123</td>' in written
    assert '<td class="good">ok</td>' in written


def test_the_same_figure_gives_the_same_text(recorded):
    first, second = (data_address(time_series_figure(recorded, recorded)) for _ in range(2))
    assert first == second
    assert b"<svg" in base64.b64decode(first.partition(",")[2])


def test_a_figure_is_drawn_once_for_its_file_and_once_for_the_page_in_the_same_layout(monkeypatch, tmp_path, recorded):
    drawn, draw, figure = [], Figure.draw, time_series_figure(recorded, recorded)

    def counted(self, renderer):
        drawn.append([a.get_position().bounds for a in self.axes])
        return draw(self, renderer)

    monkeypatch.setattr(Figure, "draw", counted)
    save_figures({"zz20/time series": figure}, tmp_path)
    data_address(figure)
    assert len(drawn) == 2 and drawn[0] == drawn[1]


@pytest.mark.parametrize("height, wide", [(2.5, 1), (5.0, 0)])
def test_a_figure_of_many_panels_in_a_row_has_a_row_of_the_page_to_itself(tmp_path, height, wide):
    shown = {"Errors/a": Figure(figsize=(9.0, height)), "Errors/b": Figure(figsize=(6.0, 4.0))}
    report = Report(title="t", summary="s", tables={}, figures=shown, config={}, versions={}, notes=[])
    write_report(tmp_path / "r.html", report)
    assert (tmp_path / "r.html").read_text().count('<figure class="wide">') == wide


def test_a_report_without_figures_and_tables_can_be_written(tmp_path):
    path = write_report(
        tmp_path / "r.html",
        Report(title="t", summary="s", tables={}, figures={}, config={}, versions={}, notes=[]),
    )
    assert {"table", "figure", "details", "script"}.isdisjoint(Page(path.read_text()).tags)


def test_long_words_may_be_broken_and_an_empty_cell_stands_as_its_column_does(tmp_path):
    rows = [{"what": "drift and yaw rate are not told apart in these runs", "why": None, "size": None},
            {"what": "short", "why": "word", "size": 2.0}]  # fmt: skip
    path = write_report(
        tmp_path / "r.html", Report(title="t", summary="s", tables={"a": rows}, figures={}, config={}, versions={},
        notes=["mind this"],
    ))  # fmt: skip
    text = path.read_text()
    assert '<td class="long">drift' in text and "td.long" in text and '<td class="text">short</td>' in text
    assert text.count('<td class="text">–</td>') == 1 and text.count('<td class="number">–</td>') == 1
    assert "Training" not in text and "What to know" in text


def test_pages_of_others_have_no_explanations_that_are_meant_for_ours(tmp_path):
    rows = [{"verdict": "holds", "value": 1.0}]
    titles = []
    for package in ("manoeuvre_nn.report", "studies.reproduction"):
        report = Report(title="t", summary="s", tables={"Claims": rows})
        shown = {"report": report, "config": "", "key": [], "sections": {}, "training": []}
        page = write_page(tmp_path / "r.html", "report.html", package, **shown).read_text()
        titles.append(page.count("What the columns say"))
    assert titles == [1, 0]


def test_a_wide_table_is_told_apart_so_that_paper_has_room_for_it(tmp_path):
    for count in (8, 9):
        rows = [{f"value {k}": 0.1 for k in range(count)}]
        page = write_report(tmp_path / "r.html", Report(title="t", summary="s", tables={"Runs": rows})).read_text()
        assert ('class="cards many"' in page) == (count > 8)
