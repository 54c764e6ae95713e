import io
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from manoeuvre_nn.diagnosis.result import Cause, Check, Diagnosis, Location, Proof, Residual, Value
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
    diagnosis_markdown,
    error_rows,
    interval_text,
    percent,
    print_diagnosis,
    runner_up,
    value_text,
    when_text,
)

NOISE = {"pos": 1.0, "psi": 0.1, "r": 0.02, "u": 0.04, "v": 0.04, "u_log": 0.05}
LONG = "a_run_whose_name_was_made_by_a_logger_2024-11-05T13:22:07Z_voyage_data_recorder_$bridge$_<b>port</b>"


def sailed(kind: str = "tc25", wind: float = 0.0, noise: float = 0.0, samples: int = 400) -> pd.DataFrame:
    """A turn or a zigzag; wind sets the ship to the southeast and turns it a little."""
    t = np.arange(float(samples))
    r = 0.75 * (1 - np.exp(-t / 25)) if kind.startswith("tc") else 0.9 * np.cos(t / 30)
    r = r + 0.02 * wind * np.sin(t / 60)
    psi = 340.0 + np.cumsum(r)
    angle, push = np.deg2rad(psi), 0.06 * wind * (1 - np.exp(-t / 60))
    u = 7.6 - 2.4 * (r / 0.9) ** 2 + push * np.cos(angle - 2.4)
    v = -0.9 * r - push * np.sin(angle - 2.4)
    x = np.cumsum(u * np.cos(angle) - v * np.sin(angle))
    y = np.cumsum(u * np.sin(angle) + v * np.cos(angle))
    scatter = noise * np.random.default_rng(1).normal(size=(7, samples))
    clean = {"x": x, "y": y, "psi": psi, "u": u, "v": v, "r": r, "u_log": u - push * np.cos(angle - 2.4)}
    sigma = [0.7, 0.7, 0.1, 0.04, 0.04, 0.02, 0.05]
    return pd.DataFrame({"t": t} | {c: f + s * e for (c, f), s, e in zip(clean.items(), sigma, scatter, strict=True)})


def rms(predicted: pd.DataFrame, recorded: pd.DataFrame) -> dict[str, float]:
    errors = {c: float(np.sqrt(np.nanmean((predicted[c] - recorded[c]) ** 2))) for c in ("psi", "u", "v", "r", "u_log")}
    gap = np.hypot(predicted["x"] - recorded["x"], predicted["y"] - recorded["y"])
    return {"pos": float(np.sqrt(np.nanmean(gap**2))), **errors}


def proof(run: str = "r02", kind: str = "tc25", wind: float = 10.0, samples: int = 400) -> Proof:
    recorded = sailed(kind, wind, 1.0, samples)
    before, after = sailed(kind, 0.0, 0.0, samples), sailed(kind, 0.97 * wind, 0.0, samples)
    recorded.loc[150:180, ["x", "y", "u", "v"]] = np.nan
    recorded["psi"] %= 360.0
    tables = [table.assign(psi=np.unwrap(table["psi"], period=360.0)) for table in (recorded, before, after)]
    return Proof(run, kind, recorded, before, after, rms(before, tables[0]), rms(after, tables[0]))


def residual(run: str = "r01", size: float = 1.0, samples: int = 400, windows=()) -> Residual:
    t = np.arange(float(samples))
    angle = np.deg2rad(117 + 0.75 * t)
    shape = np.stack([-60 * np.cos(angle), 150 * np.sin(angle), 3 * np.sin(2 * angle)], axis=-1)
    scatter = np.random.default_rng(2).normal(size=(samples // 10 + 1, 3)).repeat(10, axis=0)[:samples]
    spread = np.array([12.0, 20.0, 0.6]) * (1 + 3 * np.exp(-t / 5) + 3 * np.exp((t - t[-1]) / 5))[:, None]
    left = 0.4 * scatter * spread
    force = size * shape + left
    force[200:220] = np.nan
    return Residual(run, t, force, spread, left, list(windows))


def cause(name: str, label: str, probability: float, evidence: float = 0.0, *values: Value, **other) -> Cause:
    words = {"equations": ("X", "Y", "N"), "intervals": None, "fingerprint": "Forces turn with the compass."}
    return Cause(name, label, probability, evidence, parameters=values, source="Author 1994", **{**words, **other})


@cache
def windy() -> Diagnosis:
    causes = [
        cause(
            "wind_steady", "a steady wind", 0.998, 412.3,
            Value("speed", 11.23, 0.42, "m/s"), Value("from_deg", 243.1, 3.2, "deg"), Value("cx", 1.04, 0.17, "-"),
        ),
        cause("rudder_offset", "a rudder offset", 0.95, 31.0, Value("offset_deg", 1.04, 0.11, "deg"),
              equations=("actuator:rudder",)),
        cause("wind_onset", "a wind that sets in", 0.12, 409.8, Value("speed", 11.0, 0.6, "m/s"),
              intervals={"r01": [(60.0, 400.0)], "r03": [(45.0, 90.0), (120.0, 180.0)]}),
        cause("current", "a current", 0.034, 120.2, Value("speed", 0.4, 0.2, "m/s"), equations=("kinematics",)),
        *(cause(f"other_{k}", f"another effect, number {k}", 0.004, -1.0) for k in range(8)),
    ]  # fmt: skip
    proofs = [proof(), proof("r04", "zz20")]
    tracks = {run: sailed("tc25", 10.0, 1.0)[["x", "y"]].to_numpy() for run in ("r01", "r03")}
    return Diagnosis(
        case="c010455", ship="mariner", verdict="mismatch",
        sentence="A steady wind of 11.2 m/s from 243 deg and a rudder offset of 1.0 deg were left out of the model "
        "(probability >99 %); with them the held-out tracks are met to 6 m instead of 240 m.",
        causes=causes, model=["wind_steady", "rudder_offset"], alias=["wave_drift"],
        location=Location(
            {"kinematics or sensors": 118.4, "surge, sway and yaw": 430.1, "rudder": 33.0},
            ["The missing force turns with the compass, not with the ship.",
             "It is present from the first sample to the last in all runs."],
        ),
        residuals=[residual(), residual("r03", -0.8), residual("r05", 0.6, windows=[(60.0, 140.0), (250.0, 1e9)])],
        checks=[Check("held-out runs improve", True, "position error 240 m before, 6 m after"),
                Check("residual is white", False, "sway of r03 has a correlation of 0.31 over 20 s")],
        runner_up=["Against: a wind that sets in explains r05 worse by ln B = 2.5.",
                   "For: r03 shows little before 45 s."],
        proofs=proofs, noise=NOISE,
        next_steps=["Sail a turning circle of 35 deg to port from a heading of 60 deg.", "Write down the wind."],
        undecided=["Wind and wave drift: both turn with the compass; only another speed tells them apart."],
        tracks={**tracks, "r05": tracks["r03"]}, settings={"seed": "0", "version": "0.3.0"}, seconds=74.2,
    )  # fmt: skip


@cache
def calm() -> Diagnosis:
    proofs = [replace(proof(wind=0.0), rmse_after=proof(wind=0.0).rmse_before)]
    return replace(
        windy(), verdict="none", sentence="The calm-water model explains these recordings; nothing is missing.",
        causes=[cause("current", "a current", 0.03, -2.0, Value("speed", 0.02, 0.05, "m/s"))], model=[], alias=[],
        location=Location({}, []), residuals=[residual(size=0.0)], checks=[], runner_up=[], proofs=proofs,
        next_steps=[], undecided=[], tracks={}, settings={},
    )  # fmt: skip


@cache
def unknown() -> Diagnosis:
    named = cause("unknown", "something that is not in the list", 0.97, 88.0, equations=("Y",), fingerprint="-",
                  intervals={"r05": [(60.0, 140.0)]})  # fmt: skip
    return replace(
        windy(), sentence="Something acts that is not in the list: a side force in r05 between 60 and 140 s.",
        causes=[named, *windy().causes[3:5]], model=[], alias=[],
    )  # fmt: skip


def brief(d: Diagnosis) -> Diagnosis:
    return replace(d, proofs=d.proofs[:1], residuals=d.residuals[-1:])


CASES = {
    "none": calm,
    "unknown": lambda: replace(unknown(), residuals=unknown().residuals[-1:], proofs=[]),
    "one fitted run and nothing held out": lambda: replace(windy(), proofs=[], residuals=[residual()], tracks={}),
    "nothing at all": lambda: replace(calm(), causes=[], proofs=[], residuals=[], noise={}),
    "only gaps, noise not known, long names": lambda: renamed(
        replace(windy(), proofs=[gap()], residuals=[nothing()], tracks={"r01": NOWHERE}, noise={"pos": np.nan})
    ),
}  # fmt: skip


def gap() -> Proof:
    p = proof()
    empty = p.recorded.assign(**dict.fromkeys(("x", "y", "psi", "u", "v", "r", "u_log"), np.nan))
    return replace(p, recorded=empty, rmse_before=dict.fromkeys(NOISE, np.nan), rmse_after=dict.fromkeys(NOISE, np.nan))


NOWHERE = np.full((400, 2), np.nan)


def nothing() -> Residual:
    r = residual(windows=[(10.0, 20.0)])
    return replace(r, force=r.force * np.nan, error=r.error * np.nan, left=r.left * np.nan)


def renamed(d: Diagnosis) -> Diagnosis:
    return replace(
        d, case=LONG, ship=LONG, causes=[replace(c, label=f"{c.label} {LONG}") for c in d.causes],
        proofs=[replace(p, run=LONG) for p in d.proofs], residuals=[replace(r, run=LONG) for r in d.residuals],
        tracks={LONG: next(iter(d.tracks.values()))},
    )  # fmt: skip


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
    assert beside.get_title("right") == f"calm water: up to {errors[0]:.2g}"
    assert beside.patches[0].get_height() == pytest.approx(4 * NOISE["r"])


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


def test_errors_stand_beside_the_noise():
    d = windy()
    axes = error_figure(d).axes[0]
    points = [tuple(line.get_xydata()[0]) for line in axes.get_lines() if line.get_marker() == "o"]
    assert points == [(pytest.approx(d.rmse("after")[c] / NOISE[c]), row) for row, c in enumerate(d.rmse("after"))]
    rows = {row["RMS error"]: row for row in error_rows(d)}
    assert rows["position [m]"]["repaired / noise"] == pytest.approx(d.rmse("after")["pos"])


@pytest.mark.parametrize("make", [calm, unknown])
def test_without_a_repaired_model_nothing_is_shown_of_it(make):
    d = make()
    assert all("repaired" not in heading for row in error_rows(d) for heading in row)
    for name, figure in draw_diagnosis(d).items():
        assert all(line.get_color() != REPAIRED["color"] for axes in figure.axes for line in axes.get_lines()), name


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
        (Value("cx", 1.0, 0.0, "-"), "1", "–"),
        (Value("cx", 1.0, float("inf"), "-"), "1", "–"),
    ],
)
def test_values_have_the_digits_of_their_error(value, shown, interval):
    assert (value_text(value), interval_text(value)) == (shown, interval)


def test_times_are_named_up_to_a_number_and_then_counted():
    times = {"r01": [(0.0, 10.4)], "r02": [(5.0, 6.0), (7.0, 8.0)]}
    assert when_text(times) == "r01 0–10 s, r02 5–6 s, r02 7–8 s"
    assert when_text(times, 2) == "r01 0–10 s, r02 5–6 s, and 1 more"
    assert (when_text(None), when_text({})) == ("throughout", "–")


def test_the_runner_up_is_the_best_cause_that_the_verdict_does_not_name():
    names = [runner_up(d).name for d in (windy(), unknown(), calm())]
    assert names == ["wind_onset", "current", "current"]
    assert runner_up(replace(calm(), causes=[])) is None


def test_the_terminal_says_it_in_about_25_lines():
    shown = printed(windy(), 100)
    assert len(shown.splitlines()) <= 30
    for words in (
        ">99 %",
        "from 243.1 ± 3.2 deg",
        "not passed: residual is white",
        "record next: Sail a turning circle",
    ):
        assert words in shown
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
    diagnosis_html(replace(brief(windy()), case=LONG), path)
    return path.read_text(encoding="utf-8")


def test_the_page_loads_nothing_from_anywhere(page):
    assert len(Page(page).addresses) == 6
    assert all(address.startswith("data:image/svg+xml;base64,") for address in Page(page).addresses)
    assert {"script", "link", "iframe", "b"}.isdisjoint(Page(page).tags)
    assert "url(" not in page


def test_the_sentence_comes_first_and_what_to_record_follows_the_proof(page):
    places = [page.index(words) for words in ("<h1", "A steady wind of 11.2", "<img", "<table>", "held out</h2>",
              "runner-up: a wind that sets in", "What to record next", "residual is white")]  # fmt: skip
    assert places == sorted(places)


def test_a_page_of_nothing_says_that_nothing_was_proved_and_leaves_out_the_rest(tmp_path):
    diagnosis_html(CASES["nothing at all"](), tmp_path / "d.html")
    text = (tmp_path / "d.html").read_text(encoding="utf-8")
    assert not any(words in text for words in ("runner-up", "What to record next", "missing force", "What was found"))
    assert "No run was held out, so nothing is proved" in text
    assert text.count("<img") == 1


def test_tensorboard_gets_the_same_figures_and_the_numbers(tmp_path, monkeypatch):
    d, figures = calm(), {name: Figure((1, 1)) for name in ("probabilities", "residual/r01")}
    monkeypatch.setattr("manoeuvre_nn.report.diagnosis_html.draw_diagnosis", lambda _: figures)
    log_to_tensorboard(d, tmp_path)
    events = EventAccumulator(str(tmp_path)).Reload()
    assert set(events.Tags()["images"]) == set(figures)
    assert events.Scalars("probability/current")[0].value == pytest.approx(0.03)
    assert events.Scalars("rmse_before/pos")[0].value == pytest.approx(d.rmse("before")["pos"])
