"""A paper done again, as it is told: in JSON, in the terminal, in figures and as a page."""

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.colors import to_hex
from rich.console import Console

from studies.reproduction.document import (
    Done,
    Reproduction,
    reproduction_json,
    section_from_json,
    section_to_json,
    verdict_counts,
)
from studies.reproduction.figures import PALETTE, reproduction_figure
from studies.reproduction.page import LONG_LIST, reproduction_html
from studies.reproduction.section import ChapterResult, Claim, ComputingEffort, Line, Panel, Plot, by_tolerance
from studies.reproduction.terminal import (
    about,
    by_place,
    clock,
    difference,
    number,
    print_chapter,
    print_overview,
    tally,
)

EVIL = "<script>alert('x')</script> & \"quoted\" [bold]"
X = np.linspace(0.0, 10.0, 21)
WORDS = Claim("Figure 3.12", "the loop", "an instability, slight", "a lag of the ship", "holds in direction", "it lags")


def one_panel(*lines, **more):
    return Panel("time t [s]", "r [deg/s]", lines, **more)


def term(name, ours, why=""):
    return Claim("Table 5.1", name, 1.0, ours, by_tolerance(1.0, ours, within=0.1), why)


def claims(count, wrong=()):
    return [term(f"term {k}", 1.5, "drawn anew") if k in wrong else term(f"term {k}", 1.0) for k in range(count)]


def section(title="Chapter 5: regression", made=None, **more):
    made = [Claim("Table 5.1", "Y_v", -0.244, -0.24, "holds", unit="L"), WORDS] if made is None else made
    return ChapterResult(title, "It went well.", made, **more)


def whole(*chapters):
    chapters = chapters or (Done("5", section(), seconds=65.0),)
    return Reproduction("wang1996", "Ships", "Wang 1996", ComputingEffort(), chapters, {"torch": "2"}, 70.0)


def printed(act, width=100):
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    act(console)
    return console.export_text()


# In JSON


def test_a_chapter_is_read_as_it_was_kept():
    plot = Plot("figure_1", "two curves", [one_panel(Line("a", X, X / 3), Line("b", X, -X, "paper", points=True))])
    gap = replace(WORDS, paper=float("nan"))
    before = section(made=[WORDS, gap], tables={"t": [{"m": 3, "mse": 1 / 3, "ok": True, "none": None}]}, plots=[plot])
    after = section_from_json(json.loads(json.dumps(section_to_json(before))))
    assert after.claims[0] == WORDS and np.isnan(after.claims[1].paper)
    assert after.tables == before.tables and after.tables["t"][0]["ok"] is True
    (panel,) = after.plots[0].panels
    assert [(line.label, line.role, line.points) for line in panel.lines] == [
        ("a", "ours", False),
        ("b", "paper", True),
    ]
    np.testing.assert_array_equal(panel.lines[0].y, X / 3)
    assert after.plots[0].caption == "two curves" and panel.x_label == "time t [s]"


def test_numbers_of_numpy_and_torch_become_plain_ones():
    row = {
        "f": np.float64(0.5),
        "i": np.int64(3),
        "b": np.bool_(True),
        "t": torch.tensor(2.0),
        "s": (1, 2),
        "o": Path(),
    }
    (kept,) = section_to_json(section(tables={"t": [row]}))["tables"]["t"]
    assert [type(kept[k]) for k in "fibts"] == [float, int, bool, float, list] and isinstance(kept["o"], str)


@pytest.mark.parametrize(
    "damage",
    [
        lambda kept: kept.pop("plots"),
        lambda kept: kept["claims"][0].update(verdict="perhaps"),
        lambda kept: kept["claims"][0].update(other=1),
    ],
)
def test_a_damaged_chapter_is_not_read(damage):
    kept = section_to_json(section())
    damage(kept)
    with pytest.raises((KeyError, TypeError, ValueError)):
        section_from_json(kept)


def test_the_file_of_all_holds_claims_counts_and_figures_and_is_strict_json():
    lost = replace(WORDS, paper=float("inf"), ours=float("nan"), verdict="not comparable")
    plot = Plot("figure_1", "seen", [one_panel(Line("a", X, X))])
    done = Done("5", section(made=[*section().claims, lost], plots=[plot]), seconds=65.0)
    found = reproduction_json(whole(done, Done("6", None, "a fault")), {"5": ["figures/figure_1.png"]})
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    expected = {"holds": 1, "holds in direction": 1, "does not hold": 0, "not comparable": 1}
    assert found["verdicts"] == found["chapters"]["5"]["verdicts"] == expected
    first, _, last = found["chapters"]["5"]["claims"]
    assert first["difference"] == pytest.approx(0.004) and (last["paper"], last["ours"]) == (None, None)
    assert found["chapters"]["5"]["figures"] == [{"file": "figures/figure_1.png", "caption": "seen"}]
    assert found["failed"] == ["6"] and found["chapters"]["6"] == {"failure": "a fault"}


def test_times_stand_by_themselves():
    slow = replace(whole(Done("5", section(), seconds=99.0)), seconds=100.0)
    a, b = (reproduction_json(r, {}) for r in (whole(), slow))
    assert a.pop("seconds") != b.pop("seconds") and a == b


# In the terminal


def test_values_are_written_short():
    claim = Claim("Table 1", "Y_v", -0.244, -0.2401234, by_tolerance(-0.244, -0.2401234, relative=0.05), unit="L")
    assert (about(claim), number(claim.ours), difference(claim)) == ("Y_v [L]", "-0.2401", "+0.0039")
    assert difference(replace(claim, ours=-0.244)) == "0" and difference(WORDS) == ""
    assert difference(replace(claim, ours=float("nan"))) == "" and number(float("nan")) == "–"
    assert clock(185.9) == "3:05"


def test_verdicts_are_counted_in_words():
    assert tally(claims(3, wrong=[1])) == "2 hold, 1 does not hold"
    assert tally([]) == "no claims" and verdict_counts([WORDS])["holds in direction"] == 1
    assert list(by_place([*claims(2), WORDS])) == ["Table 5.1", "Figure 3.12"]


def test_every_claim_of_a_short_table_is_shown_beside_ours():
    told = printed(lambda c: print_chapter(Done("5", section()), c))
    line = next(line for line in told.splitlines() if line.startswith("Y_v [L]"))
    assert line.split() == ["Y_v", "[L]", "-0.244", "-0.24", "+0.004", "holds"]
    for words in ("Chapter 5: regression", "It went well.", "Table 5.1", "1 holds"):
        assert words in told


def test_statements_are_shown_whole_with_the_reason():
    told = printed(lambda c: print_chapter(Done("5", section()), c))
    lines = [" ".join(line.split()) for line in told.splitlines()]
    start = lines.index("the loop holds in direction")
    assert lines[start + 1 : start + 4] == ["paper an instability, slight", "ours a lag of the ship", "why it lags"]


def test_of_a_long_table_what_holds_is_folded_into_a_count():
    told = printed(lambda c: print_chapter(Done("5", section(made=claims(20, wrong=[3, 7, 11]))), c))
    assert [f"term {k} " in told for k in (3, 7, 11, 4)] == [True, True, True, False]
    assert "17 hold, 3 do not hold" in told and "and 17 more: 17 hold" in told
    assert told.count("drawn anew") == 1 and told.count("as above") == 2


def test_a_table_that_fails_everywhere_is_cut_and_says_so():
    told = printed(lambda c: print_chapter(Done("5", section(made=claims(40, wrong=range(30)))), c))
    assert "term 11 " in told and "term 12 " not in told and "and 28 more: 10 hold, 18 do not hold" in told


def test_of_a_long_table_only_what_holds_is_a_count_alone():
    told = printed(lambda c: print_chapter(Done("5", section(made=claims(20))), c))
    assert "20 hold" in told and "and 20 more: 20 hold" in told and "term" not in told


@pytest.mark.parametrize("width", [100, 120])
def test_nothing_is_wider_than_the_terminal(width):
    tables = {"sweep": [{f"a column {k}": k * 1.23456 for k in range(14)} for _ in range(30)]}
    long = replace(WORDS, ours="word " * 60, why="reason " * 40)
    told = printed(lambda c: print_chapter(Done("5", section(made=[*claims(5), long], tables=tables)), c), width)
    assert max(map(len, told.splitlines())) <= width
    assert "and 22 rows and 5 columns more in the files" in told


def test_brackets_are_shown_and_not_obeyed():
    strange = replace(WORDS, where="[bold]here", what="[red]what", paper="[/]x", why="[link]")
    short = replace(strange, ours="[/b]")
    told = printed(lambda c: print_chapter(Done("5", section(made=[strange, short])), c))
    assert "[/b]" in told and told.count("[red]what") == 2
    assert all(words in told for words in ("[bold]here", "[red]what", "[/]x", "[link]"))


def test_a_chapter_that_failed_is_one_line():
    told = printed(lambda c: print_chapter(Done("7", None, "ZeroDivisionError: by [zero]"), c))
    assert told == "Chapter 7 failed: ZeroDivisionError: by [zero]\n"


def test_the_overview_counts_by_chapter():
    told = printed(lambda c: print_overview(whole(Done("5", section(), seconds=65.0), Done("7", None, "fault")), c))
    lines = [" ".join(line.split()) for line in told.splitlines()]
    assert "Wang 1996: 1 holds, 1 in direction" in lines
    assert "Chapter 5: regression 1 1 0 1:05" in lines and "7: failed – – – – – 0:00" in lines


# In figures


def drawn(*panels):
    figure = reproduction_figure(Plot("f", "c", panels))
    return figure, [axes for axes in figure.axes if axes.get_visible()]


def legend_of(figure):
    return [entry.get_text() for legend in figure.legends for entry in legend.get_texts()]


def test_roles_have_their_colours_in_all_panels():
    truth, ours, paper = Line("run", X, X, "reference"), Line("net", X, -X), Line("net", X, 2 * X, "paper")
    figure, panels = drawn(one_panel(truth, ours, paper), one_panel(ours, paper))
    shown = [[to_hex(line.get_color()).upper() for line in axes.lines] for axes in panels]
    grey, orange, blue = (PALETTE[role][0] for role in ("reference", "ours", "paper"))
    assert shown == [[grey, orange, blue], [orange, blue]]
    assert legend_of(figure) == ["run", "net", "net"]


def test_ours_is_dashed_only_where_it_lies_over_what_is_to_be_met():
    ours, truth = Line("net", X, X), Line("run", X, X, "reference")
    _, (alone,) = drawn(one_panel(ours))
    _, (beside,) = drawn(one_panel(ours, truth))
    assert [axes.lines[0].get_linestyle() for axes in (alone, beside)] == ["-", "--"]


def test_labels_of_one_role_differ_and_lines_of_one_label_do_not():
    lines = [Line("a", X, X), Line("b", X, -X), Line("a", X, X + 1), *(Line("", X, X * k, "other") for k in range(3))]
    figure, (axes,) = drawn(one_panel(*lines))
    a, b, again, *rest = (line.get_color() for line in axes.lines)
    assert a == again != b and len(set(rest)) == 1 and legend_of(figure) == ["a", "b"]


def test_panels_stand_in_order_two_abreast_from_four_on():
    _, panels = drawn(*(one_panel(Line("", X, X), title=str(k)) for k in range(5)))
    places = [axes.get_subplotspec() for axes in panels]
    assert [(p.rowspan.start, p.colspan.start) for p in places] == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]
    _, three = drawn(*(one_panel(Line("", X, X)) for _ in range(3)))
    assert {axes.get_subplotspec().colspan.start for axes in three} == {0}
    assert [axes.get_xlabel() for axes in three] == ["", "", "time t [s]"]


def test_a_track_has_one_scale_and_a_logarithm_leaves_out_what_has_none():
    _, (track, errors) = drawn(one_panel(Line("", X, X), equal=True), one_panel(Line("", X, X - 5), log_y=True))
    assert track.get_aspect() == 1.0 and errors.get_yscale() == "log"
    values = errors.lines[0].get_ydata()
    assert np.isnan(values[X <= 5]).all() and np.isfinite(values[X > 5]).all()


def test_points_are_not_joined_and_many_are_drawn_as_pixels():
    _, (axes,) = drawn(one_panel(Line("few", X, X, points=True), Line("many", *np.zeros((2, 999)), points=True)))
    few, many = axes.lines
    assert {few.get_linestyle(), many.get_linestyle()} == {"None"} and few.get_marker() != "None"
    assert not few.get_rasterized() and many.get_rasterized()


def test_many_labels_stand_beside_the_panels_or_in_each():
    same = [one_panel(*(Line(f"run {k}", X, X * k, "other") for k in range(12))) for _ in range(2)]
    figure, panels = drawn(*same)
    assert len(legend_of(figure)) == 12 and all(axes.get_legend() is None for axes in panels)
    figure, panels = drawn(*(one_panel(*(Line(f"{p} {k}", X, X * k) for k in range(3))) for p in range(4)))
    assert legend_of(figure) == [] and [len(axes.get_legend().get_texts()) for axes in panels] == [3] * 4


def test_what_is_not_finite_or_empty_can_be_drawn(tmp_path):
    bad = Line("diverged", X, np.where(X > 3, np.inf, np.nan))
    figure, _ = drawn(one_panel(bad, Line("none", X[:0], X[:0])), one_panel(Line("", X, -X), log_y=True), one_panel())
    figure.savefig(tmp_path / "f.png")


# As a page


class Page(HTMLParser):
    """Tags, addresses and text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.addresses, self.ids, self.words = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in {"src", "href", "srcset", "action"}]
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_data(self, data):
        self.words.append(data)


def page(tmp_path, *chapters, images=None):
    reproduction_html(whole(*chapters), images or {}, tmp_path / "deep" / "r.html")
    return (tmp_path / "deep" / "r.html").read_text()


def test_the_page_loads_nothing_and_escapes_everything(tmp_path):
    evil = Claim(EVIL, EVIL, EVIL, EVIL, "does not hold", EVIL, EVIL)
    plot = Plot("figure_1", EVIL, [one_panel(Line("a", X, X))])
    made = ChapterResult(EVIL, EVIL, [evil], {EVIL: [{EVIL: EVIL}]}, [plot])
    text = page(tmp_path, Done("5", made), Done("6", None, EVIL), images={"5": ["data:image/png;base64,AA"]})
    seen = Page(text)
    assert "script" not in seen.tags and "url(" not in text and "@import" not in text and "link" not in seen.tags
    assert all(a.startswith(("data:", "#")) for a in seen.addresses)
    assert "".join(seen.words).count(EVIL) >= 11


def test_the_contents_lead_to_every_chapter_with_its_counts(tmp_path):
    text = page(tmp_path, Done("5", section()), Done("6", None, "a fault"))
    seen = Page(text)
    assert {a[1:] for a in seen.addresses if a.startswith("#")} == {i for i in seen.ids if i.startswith("chapter-")}
    nav = text[text.index("<nav") : text.index("</nav>")]
    assert '<span class="good">1 holds</span><span class="part">1 in direction</span>' in nav and "failed" in nav
    assert "It failed: a fault" in "".join(seen.words)


def test_verdicts_are_coloured_and_reasons_stand_below(tmp_path):
    text = page(tmp_path, Done("5", section(made=[*section().claims, *claims(1, wrong=[0])])))
    assert '<td class="judged good">holds</td>' in text
    assert '<td class="judged part">holds in direction<small>it lags</small></td>' in text
    assert '<td class="judged bad">does not hold<small>drawn anew</small></td>' in text


def test_many_claims_that_hold_are_folded_away(tmp_path):
    few = page(tmp_path, Done("5", section(made=claims(LONG_LIST, wrong=[2]))))
    many = page(tmp_path, Done("5", section(made=claims(LONG_LIST + 1, wrong=[2]))))
    assert "claims that hold</summary>" not in few and f"{LONG_LIST} claims that hold</summary>" in many
    assert many.index("term 2<") < many.index("claims that hold</summary>") < many.index("term 1<")


def test_long_tables_are_folded_and_figures_have_captions(tmp_path):
    plot = Plot("figure_1", "Figure 1: seen", [one_panel(Line("a", X, X))])
    made = section(tables={"sweep": [{"m": k} for k in range(13)], "bare": []}, plots=[plot])
    text = page(tmp_path, Done("5", made), images={"5": ["data:image/png;base64,AA"]})
    assert "<summary>13 rows</summary>" in text and "bare" not in text
    assert '<img src="data:image/png;base64,AA" alt="Figure 1: seen"><figcaption>Figure 1: seen</figcaption>' in text


def test_the_page_says_how_to_do_it_again(tmp_path):
    assert "python scripts/reproduce.py paper=wang1996 quick=false starts=8 seed=0" in page(tmp_path)
