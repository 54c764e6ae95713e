import io
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from diagnosed import CASES, LONG, NOISE, brief, calm, proof, residual, unknown, windy
from matplotlib.figure import Figure
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from manoeuvre_nn.diagnosis.result import Check, Diagnosis, Nature, Value
from manoeuvre_nn.diagnosis.words import summary_sentence
from manoeuvre_nn.report.diagnosis_figures import (
    CALM,
    REPAIRED,
    TRUTH,
    channel_figure,
    draw_diagnosis,
    error_figure,
    probability_figure,
    residual_figure,
    track_figure,
)
from manoeuvre_nn.report.diagnosis_html import diagnosis_html, log_to_tensorboard
from manoeuvre_nn.report.diagnosis_tables import (
    FOUND,
    alias_texts,
    cause_rows,
    diagnosis_markdown,
    error_rows,
    interval_text,
    outcomes,
    parameter_rows,
    percent,
    print_diagnosis,
    site_rows,
    value_text,
    verdict_text,
    when_text,
    words,
)
from manoeuvre_nn.report.html import save_figures
from manoeuvre_nn.report.interactive import scripts


def drawn(axes, label_or_colour) -> np.ndarray:
    return next(line for line in axes.get_lines() if line.get_color() == label_or_colour["color"]).get_xydata()


def printed(d: Diagnosis, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_diagnosis(d, console)
    return console.file.getvalue()


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize("make", CASES.values(), ids=CASES)
def test_every_figure_can_be_drawn_without_a_warning(make):
    d = make()
    figures = draw_diagnosis(d)
    assert "probabilities" in figures
    assert sum(name.partition("/")[0] in {"channels", "residual"} for name in figures) == len(d.proofs + d.residuals)
    for figure in figures.values():
        figure.draw_without_rendering()


@pytest.mark.filterwarnings("error::UserWarning")
def test_six_long_runs_have_a_map_each():
    runs = [proof(f"r{k:02d}", samples=1000) for k in range(6)]
    figure = track_figure(runs, repaired=True)
    figure.draw_without_rendering()
    assert [axes.get_title("left").split(",")[0] for axes in figure.axes] == [p.run for p in runs]


def test_tracks_start_at_the_origin_with_equal_axes_and_keep_their_gaps():
    d = windy()
    for axes, p in zip(track_figure(d.proofs, repaired=True).axes, d.proofs, strict=True):
        assert axes.get_aspect() == 1.0
        east, north = drawn(axes, TRUTH).T
        assert (east[0], north[0]) == (0.0, 0.0)
        assert np.isnan(east[150:181]).all()
        assert np.isfinite(np.delete(east, np.s_[150:181])).all()
        assert drawn(axes, CALM)[-1] == pytest.approx((p.before - p.recorded.iloc[0])[["y", "x"]].iloc[-1])


def test_headings_recorded_between_0_and_360_are_compared_without_jumps():
    p = windy().proofs[0]
    p = replace(p, before=p.before.assign(psi=p.before["psi"] - 720.0))
    assert p.recorded["psi"].max() < 360.0 < p.after["psi"].max()
    shown, beside = channel_figure(p, NOISE, repaired=True).axes[:2]
    assert np.abs(np.diff(drawn(shown, TRUTH)[:, 1])).max() < 5.0
    rms_shown = [np.sqrt(np.mean(drawn(beside, style)[:, 1] ** 2)) for style in (CALM, REPAIRED)]
    assert rms_shown == pytest.approx([p.rmse_before["psi"], p.rmse_after["psi"]])


def test_errors_are_on_the_scale_of_the_repaired_model_and_the_largest_of_calm_water_is_written():
    beside = channel_figure(windy().proofs[0], NOISE, repaired=True).axes[3]
    errors = [np.nanmax(np.abs(drawn(beside, style)[:, 1])) for style in (CALM, REPAIRED)]
    assert beside.get_ylim()[1] == pytest.approx(max(1.2 * errors[1], 3 * NOISE["r"]))
    assert beside.get_title("left") == f"calm water: up to {errors[0]:.2g} deg/s"
    assert np.ptp(beside.collections[0].get_paths()[0].vertices[:, 1]) == pytest.approx(4 * NOISE["r"])


def test_the_band_of_the_missing_force_is_two_standard_deviations_and_windows_end_with_the_run():
    r = residual(windows=[(60.0, 140.0), (250.0, 1e9), (1e6, 2e6)])
    for k, axes in enumerate(residual_figure(r, True).axes):
        spans = [(p.get_x(), p.get_x() + p.get_width()) for p in axes.patches]
        assert spans == [(60.0, 140.0), (250.0, 399.0)]
        corners = axes.collections[0].get_paths()[0].vertices
        widths = np.ptp(corners[corners[:, 0] == 50.0][:, 1])
        assert widths == pytest.approx(4 * r.error[50, k])
        assert drawn(axes, REPAIRED)[:, 1] == pytest.approx(r.left[:, k])


def test_a_name_is_no_formula_and_loses_its_middle_when_it_is_long():
    title = residual_figure(residual(LONG), True).get_suptitle()
    assert title.startswith("a_run_whose_name")
    assert title.endswith(r"\$bridge\$_<b>port</b>")
    assert max(map(len, title.splitlines())) <= 46


def test_only_runs_with_windows_are_shown_where_something_is_missing():
    figure = draw_diagnosis(replace(windy(), proofs=[]))["where"]
    assert [axes.get_title("left") for axes in figure.axes] == ["r05"]
    marked = np.isfinite(figure.axes[0].get_lines()[0].get_xdata())
    assert np.flatnonzero(marked).tolist() == [*range(60, 141), *range(250, 400)]
    assert "where" not in draw_diagnosis(calm())


def test_bars_are_as_long_as_the_probabilities_and_named_as_what_they_are():
    axes = probability_figure(windy()).axes[0]
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([99.8, 95.0, 12.0, 3.4])
    assert [words.get_text() for words in axes.texts] == [">99 %", "95 %", "12 %", "3 %"]
    legends = [probability_figure(d).legends[0].get_texts() for d in (windy(), unknown())]
    assert [words[0].get_text() for words in legends] == ["in the repaired model", "not in the list"]


def test_the_noise_has_a_tick_where_no_error_is_far_from_it():
    p = replace(calm().proofs[0], rmse_before={channel: 1.3 * sigma for channel, sigma in NOISE.items()})
    for d in (replace(calm(), proofs=[p]), windy()):
        axes = error_figure(d).axes[0]
        assert 1.0 in list(axes.get_xticks())
    assert error_figure(replace(calm(), proofs=[p])).axes[0].get_xticks().tolist()[:3] == [1.0, 1.5, 2.0]


def test_units_stand_with_the_value_and_not_with_the_name():
    names = [
        words(Value(name, 1.0, 0.1, unit)) for name, unit in (("force_kN", "kN"), ("from_deg", "deg"), ("cx", "-"))
    ]
    assert names == ["force", "from", "cx"]


def test_errors_stand_beside_the_noise():
    d = windy()
    axes = error_figure(d).axes[0]
    points = [tuple(line.get_xydata()[0]) for line in axes.get_lines() if line.get_marker() == "o"]
    assert points == [(pytest.approx(d.rmse("after")[c] / NOISE[c]), row) for row, c in enumerate(d.rmse("after"))]
    rows = {row["RMS error"]: row for row in error_rows(d)}
    assert rows["position [m]"]["repaired / noise"] == pytest.approx(d.rmse("after")["pos"])


def test_without_a_repaired_model_nothing_is_shown_of_it():
    d = calm()
    assert all("repaired" not in heading for row in error_rows(d) for heading in row)
    for name, figure in draw_diagnosis(d).items():
        assert all(line.get_color() != REPAIRED["color"] for axes in figure.axes for line in axes.get_lines()), name


def test_corrected_coefficients_are_shown_though_nothing_is_missing():
    d = replace(calm(), proofs=windy().proofs)
    assert d.repaired and all("repaired" in row for row in error_rows(d))


@pytest.mark.parametrize(
    ("probability", "shown"),
    [(0.0, "<1 %"), (0.004, "<1 %"), (0.01, "1 %"), (0.954, "95 %"), (0.99, "99 %"), (0.991, ">99 %"), (1.0, ">99 %")],
)
def test_nothing_is_certain(probability, shown):
    assert percent(probability) == shown


@pytest.mark.parametrize(
    ("value", "shown", "interval"),
    [
        (Value("speed", 11.234, 0.42, "m/s"), "11.23 ± 0.42 m/s", "10.41 to 12.06"),
        (Value("gap", 1234.0, 120.0, "m"), "1230 ± 120 m", "999 to 1469"),
        (Value("width_deg", 20.0, 14.0, "deg", low=0.0, high=70.0), "20 ± 14 deg", "0 to 47"),
        (Value("fraction", 0.9, 0.1, "-", low=0.0, high=1.0), "0.90 ± 0.10", "0.70 to 1.00"),
        (Value("from_deg", 355.0, 10.0, "deg", period=360.0), "355 ± 10 deg", "335 to 15"),
        (Value("from_deg", 20.0, 92.0, "deg", period=360.0), "20 ± 92 deg", "any"),
        (Value("cx", 1.0, 0.0, "-"), "1", "–"),
        (Value("cx", 1.0, float("inf"), "-"), "1", "–"),
    ],
)
def test_values_have_the_digits_of_their_error(value, shown, interval):
    assert (value_text(value), interval_text(value)) == (shown, interval)


def acting(times, errors=None):
    """A cause that acts at times."""
    return replace(windy().causes[0], intervals=times, interval_errors=errors or {})


def test_times_are_named_up_to_a_number_and_then_counted():
    times = {"r01": [(0.0, 10.4)], "r02": [(5.0, 6.0), (7.0, 8.0)]}
    errors = {"r01": [(np.nan, 2.4)], "r02": [(0.2, 3.0), (1.0, np.nan)]}
    assert when_text(acting(times)) == "r01 0 to 10 s, r02 5 to 6 s, r02 7 to 8 s"
    assert when_text(acting(times, errors), 2) == "r01 0 to 10 ± 2 s, r02 5 ± 1 to 6 ± 3 s, and 1 more"
    assert (when_text(acting(None)), when_text(acting({}))) == ("throughout", "–")


def test_errors_of_all_runs_leave_out_channels_that_a_run_did_not_record():
    first, second = windy().proofs
    less = replace(second, rmse_before={"pos": 30.0, "u_log": np.nan, "only_here": 2.0}, rmse_after={})
    d = replace(windy(), proofs=[first, less])
    before = d.rmse("before")
    assert before["pos"] == pytest.approx(np.sqrt((first.rmse_before["pos"] ** 2 + 30.0**2) / 2))
    assert before["psi"] == pytest.approx(first.rmse_before["psi"]), "the second run has no heading"
    assert before["u_log"] == pytest.approx(first.rmse_before["u_log"]) and before["only_here"] == 2.0
    assert d.rmse("after") == pytest.approx(first.rmse_after)
    nowhere = replace(d, proofs=[replace(less, rmse_before={"r": np.nan})])
    assert np.isnan(nowhere.rmse("before")["r"]) and replace(d, proofs=[]).rmse("before") == {}
    draw_diagnosis(nowhere)


def test_what_is_unknown_is_called_so():
    assert [d.unknown for d in (windy(), unknown(), calm())] == [False, True, False]
    for d, said in ((windy(), "something is"), (unknown(), "something unknown is"), (calm(), "nothing is")):
        assert verdict_text(d) == f"{said} missing in the calm-water model"
        assert f"{said} missing" in printed(d) and f"{said} missing" in diagnosis_markdown(d)
    rows = {row["cause"]: row["ln B"] for row in cause_rows(unknown(), unknown().causes)}
    assert rows["something that is not in the list"] == 88 and rows["a current"] == 120


def test_the_captain_is_told_what_is_unknown_and_where_and_whether_a_formula_helps():
    causes, proofs = unknown().causes, windy().proofs
    said = "Unknown: the recordings differ from calm water in sway, and no effect that is known explains it"
    assert summary_sentence(causes, [], proofs, True) == f"{said}."
    told = replace(causes[0], terms=("Y |r|",), parameters=(Value("Y |r|", 412.0, 10.0, "kN"),))
    sides = "positive: Y to starboard; motion in units of a tight turn"
    assert summary_sentence([told], ["unknown"], proofs, True).startswith(
        f"{said}; a short formula for it is Y = 412 kN |r| ({sides}); with that the predicted"
    )
    assert summary_sentence(causes, [], proofs, False).startswith("The recordings agree")


@pytest.mark.parametrize("refuted, formula", [(False, "N = 3 kN m r"), (True, "N = -20 kN m cos(2 pi t/period)")])
def test_the_captain_is_not_told_the_phase_that_each_run_has_of_its_own(refuted, formula):
    nature = Nature("periodic", ("N",), Value("amplitude", 12.0, 1.0, "MN m"), refuted=refuted)
    names, period = ("N cos periodic_by_run", "N sin periodic_by_run", "N r"), Value("period_s", 17.5, 0.1, "s")
    values = [Value(name, size, 1.0, "kN m") for name, size in zip(names, (-20.0, 9.0, 3.0), strict=True)]
    for count, said in ((3, formula), (2, formula if refuted else "")):
        numbers = {"terms": names[:count], "parameters": (*values[:count], period), "nature": nature}
        told = summary_sentence([replace(unknown().causes[0], **numbers)], ["unknown"], [], True)
        assert said in told and ("a short formula" in told) == bool(said)


def test_the_captain_is_told_to_which_side_and_when():
    force = Value("force_kN", -221.6, 1.7, "kN", sides=("to starboard", "to port"))
    lever = Value("lever_m", 10.19, 0.48, "m", sides=("forward of midship", "aft of midship"))
    times = {"r01": [(190.6, 383.0)], "r02": [], "r03": [(20.0, 60.4), (266.0, 402.0)]}
    pushed = replace(windy().causes[0], label="a side force", parameters=(force, lever), intervals=times)
    said = summary_sentence([pushed], ["wind_steady"], [], True)
    place = "force 222 kN to port, lever 10.2 m forward of midship"
    assert said == f"The recordings show a side force ({place}; r01 191 to 383 s, r03 20 to 60 s and 1 more)."
    rows = [(row[FOUND], row["95 % interval"]) for row in parameter_rows([pushed])]
    assert rows == [
        ("221.6 ± 1.7 kN to port", "218.3 to 224.9 to port"),
        ("10.19 ± 0.48 m forward of midship", "9.25 to 11.13 forward of midship"),
    ]
    assert interval_text(replace(force, error=200.0)) == "614 to port, 170 to starboard"
    assert interval_text(replace(force, value=221.6, error=200.0, low=0.0)) == "0 to 614 to starboard"


def test_every_named_cause_has_its_own_rivals():
    said = ["These recordings cannot tell a steady wind from wave drift, a current.",
            "These recordings cannot tell a rudder offset from another effect, number 1."]  # fmt: skip
    assert alias_texts(windy()) == said
    for sentence in said:
        assert sentence in diagnosis_markdown(windy()) and sentence in " ".join(printed(windy(), 400).split())
    assert alias_texts(calm()) == [] == alias_texts(replace(windy(), alias={"wind_steady": []}))


def test_the_runner_up_is_told_with_what_speaks_for_and_against_it():
    shown = " ".join(printed(windy(), 400).split())
    assert "runner-up: " + " ".join(windy().runner_up) in shown
    assert "runner-up" not in printed(replace(windy(), runner_up=[]), 400)


def test_sites_are_said_in_words_with_log_bayes_factors_of_three_digits():
    d = replace(windy(), sites={"surge": 16034.2})
    assert site_rows(d) == [{"site": "any force in surge", "ln B over calm water": 16034}]
    assert site_rows(windy())[1] == {"site": "kinematics or sensors", "ln B over calm water": 118}


def test_the_terminal_says_it_in_about_25_lines():
    shown = printed(windy(), 100)
    assert len(shown.splitlines()) <= 30
    for said in (
        ">99 %",
        "from 243.1 ± 3.2 deg",
        "not passed: residual is white",
        "record next: Sail a turning circle",
    ):
        assert said in shown
    assert " ".join(shown.split()).index("A steady wind of 11.2 m/s") < shown.index("243.1 ± 3.2 deg")
    assert "held-out runs improve" not in shown


@pytest.mark.parametrize("make", [windy, *CASES.values()], ids=["wind", *CASES])
def test_every_case_is_told_in_words(make):
    d = make()
    for shown in (" ".join(printed(d, 400).split()), diagnosis_markdown(d)):
        assert d.sentence in shown
        assert ("no run was held out" in shown.lower()) == (not d.proofs)
        assert "nan" not in shown


class Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in {"src", "href", "srcset", "data"}]


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "deep" / "diagnosis.html"
    d = replace(brief(windy()), case=LONG)
    diagnosis_html(d, draw_diagnosis(d), path)
    return path.read_text(encoding="utf-8")


def test_the_page_loads_nothing_from_anywhere(page):
    addresses = [address for address in Page(page).addresses if not address.startswith("#part")]
    assert len(addresses) == 6
    assert all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert {"link", "iframe", "b"}.isdisjoint(Page(page).tags)
    assert "url(" not in page.replace(scripts()[0], "")


def test_the_sentence_comes_first_and_what_to_record_follows_the_proof(page):
    order = ("<h1", "A steady wind of 11.2", "<img", "<table", "held out</h2>", "against the runner-up</h2>",
             "a wind that sets in explains", "What to record next</h2>", ">residual is white")  # fmt: skip
    places = [page.index(words) for words in order]
    assert places == sorted(places)


def test_the_top_of_the_page_says_what_was_not_passed_and_what_to_record(page):
    top = page[: page.index("<h2>")]
    assert '<strong class="bad">Not passed:</strong> residual is white: sway of r03' in top
    assert "<strong>Record next:</strong> Sail a turning circle of 35 deg to port" in top


def test_a_claim_that_held_out_runs_refused_is_no_failed_test_of_the_answer():
    refused = Check("held-out gain", False, "with a wind and a tug the error goes from 9 to 8")
    passed = Check("held-out gain", True, "with a wind it goes from 9 to 1")
    d = replace(windy(), checks=[refused, passed, Check("little is left", True, "0.3 %")])
    assert outcomes(d) == [("tests passed", "held-out gain, little is left", "good"), ("refused", refused.text, "")]
    assert "refused: with a wind and a tug" in printed(d) and "not passed" not in printed(d)


def test_an_event_that_no_held_out_run_had_is_told_as_not_proved():
    absent = Check("held-out gain", True, "a tug did not act in a held-out run: not proved")
    assert outcomes(replace(windy(), checks=[absent])) == [("not proved", "a tug did not act in a held-out run", "bad")]


def test_values_of_other_causes_are_not_shown_as_found(page):
    how_much = page.split("<h2>How much</h2>")[1].split("</table>")[0]
    assert "a rudder offset" in how_much and "a wind that sets in" not in how_much
    assert "11.00 ± 0.60 m/s" in page.split("All candidates</summary>")[1]


def test_errors_have_their_unit_and_what_is_written_above_them_meets_nothing():
    shown, beside = channel_figure(windy().proofs[0], NOISE, repaired=True).axes[:2]
    assert (shown.get_ylabel(), beside.get_ylabel()) == ("heading ψ\n[deg]", "error [deg]")
    assert shown.get_title("left") == ""


def test_a_page_of_nothing_says_that_nothing_was_proved_and_leaves_out_the_rest(tmp_path):
    d = CASES["nothing at all"]()
    diagnosis_html(d, draw_diagnosis(d), tmp_path / "d.html")
    text = (tmp_path / "d.html").read_text(encoding="utf-8")
    assert not any(words in text for words in ("runner-up", "What to record next", "missing force", "What was found"))
    assert "No run was held out, so nothing is proved" in text and text.count("<img") == 1


def test_tensorboard_gets_the_same_figures_and_the_numbers(tmp_path):
    d, figures = calm(), {name: Figure((1, 1)) for name in ("probabilities", "residual/r01")}
    log_to_tensorboard(d, save_figures(figures, tmp_path / "figures"), tmp_path)
    events = EventAccumulator(str(tmp_path)).Reload()
    assert set(events.Tags()["images"]) == set(figures)
    assert events.Scalars("probability/current")[0].value == pytest.approx(0.03)
    assert events.Scalars("rmse_before/pos")[0].value == pytest.approx(d.rmse("before")["pos"])
