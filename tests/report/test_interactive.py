import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import CASES, brief, windy
from matplotlib.figure import Figure
from pages import Scripts, unexplained

from manoeuvre_nn.report import html
from manoeuvre_nn.report.chart import MAX_POINTS, Band, Chart, ChartPanel, Curve, Mark
from manoeuvre_nn.report.columns import EXPLAINED, JOBS, OF_TABLE, PATTERNS, RUNS, explained
from manoeuvre_nn.report.diagnosis_figures import channel_figure, track_figure
from manoeuvre_nn.report.diagnosis_html import diagnosis_html
from manoeuvre_nn.report.figures import draw_comparison
from manoeuvre_nn.report.html import Report, write_report
from manoeuvre_nn.report.interactive import as_data, scripts
from manoeuvre_nn.report.manoeuvre_charts import comparison_charts
from manoeuvre_nn.report.tables import criteria_rows, main_criteria_rows, score_rows
from manoeuvre_nn.scoring.score import score

EVIL = "</script><img src=x onerror=alert(1)><!-- ]]> %{x} $a$"
MAX_PAGE_BYTES = 5_000_000


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "diagnosis.html"
    d = brief(replace(windy(), dimensions=(160.0, 23.0)))
    d = replace(d, proofs=[replace(p, run=EVIL) for p in d.proofs])
    figures = {"tracks": track_figure(d.proofs, d.repaired), f"channels/{EVIL}": channel_figure(d.proofs[0], {}, True)}
    diagnosis_html(d, figures, path)
    return path.read_text(encoding="utf-8")


def test_a_page_runs_the_scripts_that_its_policy_names_and_no_others(page):
    run = Scripts(page).run
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy and len(run) == 2
    assert policy.partition("script-src ")[2].split() == [f"'sha256-{digest}'" for digest in map(digest_of, run)]


def digest_of(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def test_plotly_is_the_one_that_was_published_and_brings_its_licence():
    library = scripts()[0].partition("*/\n")[2]
    assert library.startswith("/**\n* plotly.js (basic - minified) v4.1.1")
    assert digest_of(library) == "mXhOOr+wexQqFeUhpDnm2a3c6ts/eVU/0kxyd08GSbo="
    assert "Permission is hereby granted, free of charge" in scripts()[0].partition("*/\n")[0]


def test_a_name_of_a_file_is_never_markup_nor_a_template_of_the_script(page):
    data = Scripts(page).data
    assert len(data) == 2
    words = json.dumps(data)
    assert "&lt;/script&gt;" in words and "<img" not in words
    assert "<img src=x" not in page and "hovertemplate" not in words


def test_a_page_without_such_figures_runs_no_script(tmp_path):
    text = write_report(tmp_path / "r.html", Report(title="t", summary="s")).read_text()
    assert "<script" not in text and "script-src 'none'" in text


def test_every_figure_has_a_dark_form_which_leaves_paper_and_print_alone(page):
    dark = re.search(r"@media screen and \(prefers-color-scheme: dark\) \{(.*?)\n\}", page, re.DOTALL)
    assert dark and re.search(r"figure img, \.live \{ filter: invert", dark[1])
    images = re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', page)
    assert len(images) == 2 == page.count("<figure")
    for image in images:  # a white ground would stay a bright sheet, or turn into a black one on a dark page
        drawn = base64.b64decode(image).decode()
        ground = re.search(r'<g id="patch_1">\s*<path[^>]*style="([^"]*)"', drawn)
        assert ground and ("fill: none" in ground[1] or "opacity: 0" in ground[1])


def test_a_page_of_six_long_runs_stays_below_five_megabytes(tmp_path, make_course):
    charts = comparison_charts(make_course(end=6000.0), make_course(end=6000.0, drift=1.0))
    drawn = draw_comparison(charts, "long")
    report = Report(title="t", summary="s", figures=drawn, charts=charts)
    whole, library = write_report(tmp_path / "r.html", report).stat().st_size, len(scripts()[0])
    assert whole > library > 1_000_000
    assert library + 6 * (whole - library) < MAX_PAGE_BYTES


def test_long_curves_are_thinned_evenly_and_gaps_stay_gaps():
    x = np.arange(10 * MAX_POINTS + 1.0)
    y = np.where(x == 20.0, np.nan, x)
    (trace,) = as_data(Chart([ChartPanel("x", "y", [Curve(x, y, {"color": "k"})])]))["panels"][0]["traces"]
    step = trace["dx"]
    assert len(trace["y"]) <= MAX_POINTS and trace["x0"] == 0.0
    assert step * (len(trace["y"]) - 1) == pytest.approx(x[-1], abs=step)
    uneven = Curve(np.array([0.0, 1.0, 3.0]), np.array([1.0, np.nan, 2.0]), {"color": "k"})
    (trace,) = as_data(Chart([ChartPanel("x", "y", [uneven])]))["panels"][0]["traces"]
    assert (trace["x"], trace["y"]) == ([0.0, 1.0, 3.0], [1.0, None, 2.0])


def test_the_page_shows_the_curves_of_the_figure_with_their_dashes(recorded, make_course):
    prediction = make_course(drift=1.0)
    charts = comparison_charts(recorded, prediction)
    drawn = draw_comparison(charts, "zz20")
    for name, chart in charts.items():
        panel, axes = as_data(chart)["panels"][0], drawn[name].axes[0]
        lines = {line.get_color(): line for line in reversed(axes.get_lines())}
        for said, colour in (("recorded", "#8C8C8C"), ("predicted", "#D55E00")):
            trace = next(t for t in panel["traces"] if t.get("name", "").startswith(said))
            assert trace["y"] == pytest.approx(lines[colour].get_ydata(), rel=1e-4, abs=1e-4)
            assert (trace["line"]["dash"] == "solid") == (lines[colour].get_linestyle() == "-") == (said == "recorded")


def test_a_label_stands_once_in_the_legend_of_panels_over_one_time():
    curves = [Curve(np.arange(3.0), np.arange(3.0), {"color": "k"}, "recorded")] * 2
    band = Band(np.arange(3.0), np.zeros(3), np.ones(3), {"color": "k"}, "noise")
    panels = [ChartPanel("t", "a", curves, [band]), ChartPanel("t", "b", curves, marks=[Mark(0.0, 0.0, "start", "*")])]
    shown = [
        [t["name"] for p in as_data(Chart(panels, one_time=together))["panels"] for t in p["traces"] if t["showlegend"]]
        for together in (True, False)
    ]
    assert shown == [["noise", "recorded"], ["noise", "recorded", "recorded"]]


@pytest.mark.parametrize("over, zoomable", [(0, 4), (1000, 3), (1_000_000_000, 0)])
def test_the_last_figures_of_a_large_page_are_pictures_alone(tmp_path, monkeypatch, over, zoomable):
    course = Curve(np.arange(500.0), np.arange(500.0) / 3, {"color": "k"}, "course")
    charts = {f"{k}/track": Chart([ChartPanel("t", f"channel {k}", [course])]) for k in range(4)}
    figures = {name: Figure(figsize=(1, 1)) for name in charts}
    report = Report("t", "s", tables={}, figures=figures, config={}, versions={}, notes=[], charts=charts)
    whole = html.write_report(tmp_path / "r.html", report).read_text()
    monkeypatch.setattr(html, "LARGEST_PAGE", len(whole) - over)
    page = html.write_report(tmp_path / "r.html", report).read_text()
    assert page.count("<img ") == page.count("<figcaption>") == 4
    shown = re.findall(r'<script type="application/json">.*?channel (\d)', page)
    assert shown == ["0", "1", "2", "3"][:zoomable] and page.count('<figure class="chart">') == zoomable
    assert ("plotly" in page) == (zoomable > 0)


def test_every_column_of_scores_and_of_a_diagnosis_is_explained_on_the_spot(tmp_path, page, recorded, make_course):
    assert "What the columns say" in page and unexplained(page) == set()
    assert 'title="log Bayes factor over calm water' in page and "<dt>ln B</dt>" in page
    judged = [replace(score(make_course(drift=1.0), recorded, 100.0), spread_L=0.1)]
    for rows in (score_rows(judged, {"linear": judged}), main_criteria_rows(judged), criteria_rows(judged)):
        assert rows and all(explained(column) for row in rows for column in row)
    for name, make in CASES.items():
        d = make()
        diagnosis_html(d, {}, tmp_path / f"{name[:4]}.html")
        assert unexplained((tmp_path / f"{name[:4]}.html").read_text()) == set(), name


def test_a_heading_that_holds_a_name_is_explained_with_it_and_an_unknown_one_is_not():
    assert explained("dev/L zz20").startswith("largest distance between predicted and recorded track of zz20")
    assert explained("repaired / noise").startswith(
        "RMS error, repaired, over the estimated measurement noise: about 1"
    )
    assert explained("RMS [deg]") == "root mean square error in deg"
    assert explained("RMS validation [deg]") == "root mean square error of the records of validation in deg"
    for verdict, table in (("usable", RUNS), ("usable", JOBS), ("met", "IMO MSC.137(76), predicted"), ("mend", "zz10")):
        assert verdict in explained("verdict", table)
    assert explained("u", RUNS).startswith("setting that differs") and "unfinished" in explained("status", JOBS)
    assert explained("zz10", "Deviation over L of each target") and not explained("zz10")


def test_an_explanation_is_a_line_that_says_something_and_no_heading_stands_in_two_ways():
    lines = [*EXPLAINED.values(), *(line for own in OF_TABLE.values() for line in own.values())]
    lines += [words.format("zz20", "deg") for _, words in PATTERNS]
    assert all(line and line[-1] not in ":,; " and "{" not in line and "cannot be beaten" not in line for line in lines)
    assert not [name for name in EXPLAINED for own in OF_TABLE.values() if own.get(name) == EXPLAINED[name]]


@pytest.mark.parametrize("name", ["linear", "taylor", "true terms"])
def test_the_simpler_models_beside_a_network_are_explained_each(name):
    assert explained(f"{name} dev/L").startswith("dev/L of ") and "simpler model" not in explained(f"{name} dev/L")


def test_each_member_has_its_name_under_the_pointer_and_all_share_one_entry_of_the_legend(recorded, make_course):
    members = [make_course(drift=drift) for drift in (0.5, 1.0, 1.5)]
    traces = as_data(comparison_charts(recorded, make_course(), members)["track"])["panels"][0]["traces"]
    thin = [trace for trace in traces if trace.get("name") == "members"]
    assert [trace["meta"] for trace in thin] == ["member 1", "member 2", "member 3"]
    assert [trace["showlegend"] for trace in thin] == [True, False, False]
    assert {trace["legendgroup"] for trace in thin} == {"members"} and "%{meta}" not in str(traces)
