"""The ideal observer on cases whose answer is known: the truth leaves white noise, is named, and nothing is nothing."""

from dataclasses import replace

import numpy as np
import pytest
from tiers import only

from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial import ideal
from studies.concealed_trial.drawing import CasePlan, draw_case
from studies.concealed_trial.effects import kind_of
from studies.concealed_trial.helm import Run
from studies.concealed_trial.ideal import EXACT, Observer, answer_of, main
from studies.concealed_trial.observer_events import event_starts
from studies.concealed_trial.observer_filter import Whitening, slopes
from studies.concealed_trial.observer_model import Evaluation, Part, combinations
from studies.concealed_trial.observer_track import read_track, referred
from studies.concealed_trial.record import write_case
from studies.concealed_trial.truth import ConcealedEffect

RUNS = (Run("r01", "fit", "tc20", "port", 10.0, 260), Run("r02", "fit", "zz20", "starboard", 80.0, 260))
INTERVALS = {"r01": [[120, 220]], "r02": []}
SET_IN = {"r01": [[150, 260]], "r02": [[170, 260]]}
EFFECTS = {
    "clean": (),
    "exact current": (ConcealedEffect("current", {"speed": 1.2, "toward_deg": 40.0}),),
    "compass": (ConcealedEffect("heading_bias", {"bias_deg": 20.0}),),
    "ramp": (ConcealedEffect("wind_onset", {"speed": 16.0, "from_deg": 70.0}, SET_IN, ramp=120.0),),
    "push": (ConcealedEffect("side_force", {"force_kN": 500.0, "lever_m": 10.0}, INTERVALS),),
}
CATALOGUE = ("current", "heading_bias", "hull_fouling", "rudder_area_loss")


class Tracks(dict):
    """Of each case that is asked for."""

    def __init__(self, place):
        self.place = place

    def __missing__(self, name):
        effects, nuisance = EFFECTS[name], 0.0 if "exact" in name else 1.0
        case = replace(draw_case(6, 0, CasePlan("mariner", (), ()), nuisance), runs=RUNS, effects=effects, hole=None)
        write_case(replace(case, measures=(1.0,) * len(effects)), self.place / name, 0.5)
        self[name] = read_track(self.place / name)
        return self[name]


@pytest.fixture(scope="module")
def tracks(tmp_path_factory):
    """Tracks of cases with and without effects; all but one with coefficients off, a missing term and a force."""
    return Tracks(tmp_path_factory.mktemp("cases"))


def evaluation(track, effects=(), nuisance=1.0):
    return Evaluation(track, Whitening(track, slopes(track, list(effects), nuisance), nuisance))


@pytest.fixture
def few_kinds(monkeypatch):
    monkeypatch.setattr(ideal, "KINDS", tuple(kind_of(name) for name in (*CATALOGUE, "wind_gusty")))
    monkeypatch.setattr(ideal, "UNMODELLED", (kind_of("unknown", "turn_drag"),))


@pytest.mark.parametrize("name", only({"clean", "exact current", "push"}, EFFECTS))
def test_what_the_truth_leaves_is_white_noise_of_unit_size(name, tracks):
    truth = tracks[name].truth(EFFECTS[name])
    track = referred(tracks[name], truth)
    nuisance = EXACT if "exact" in name else 1.0
    found = evaluation(track, EFFECTS[name], nuisance)
    process, measured = track.residuals(truth)
    misfit = found.whitening.whiten(process[..., None], measured[..., None])[:, 0]
    assert np.mean(misfit[misfit != 0] ** 2) == pytest.approx(1.0, abs=0.07)
    rows = misfit.reshape(-1, 8)
    assert all(abs(np.mean(row[1:] * row[:-1])) < 0.15 for row in rows.T)


def test_a_hole_ends_a_segment_and_missing_channels_are_left_out(tracks, tmp_path):
    case = replace(draw_case(6, 0, CasePlan("mariner", (), ()), 1.0), runs=RUNS, channels="gps_heading")
    write_case(replace(case, hole=("r01", 100, 180)), tmp_path, 0.5)
    track = read_track(tmp_path)
    assert track.ends.sum() == 3
    assert not np.isfinite(track.measured[5:]).any()
    assert not ((track.t >= 100) & (track.t <= 180) & (np.array(track.runs) == "r01")).any()
    misfit = evaluation(track).misfits([()])[:, 0]
    assert np.mean(misfit[misfit != 0] ** 2) == pytest.approx(1.0, abs=0.08)


def test_an_exact_strong_current_is_named_with_its_parameters(tracks, few_kinds):
    observer = Observer.of(tracks["exact current"], 0.0)
    answer = answer_of("c1", observer)
    assert answer["verdict"] == "mismatch"
    first = answer["effects"][0]
    assert (first["name"], first["equation"]) == ("current", ["kinematics"])
    assert first["probability"] > 0.99
    speed, angle = first["parameters"]["speed"], first["parameters"]["toward_deg"]
    assert abs(speed[0] - 1.2) < 0.012
    assert abs(angle[0] - 40.0) < 0.6
    assert 0 < speed[1] < 0.01 and 0 < angle[1] < 0.5


def test_a_compass_that_is_far_off_is_named_about_its_own_reference(tracks, few_kinds):
    answer = answer_of("c1", Observer.of(tracks["compass"]))
    assert answer["effects"][0]["name"] == "heading_bias"
    assert answer["effects"][0]["parameters"]["bias_deg"][0] == pytest.approx(20.0, abs=0.3)


def test_a_clean_case_is_clean_with_about_the_probabilities_before_it_was_seen(tracks, few_kinds):
    observer = Observer.of(tracks["clean"])
    answer = answer_of("c1", observer)
    assert answer["verdict"] == "none"
    assert max((e["probability"] for e in answer["effects"] if e["name"] in CATALOGUE), default=0.0) < 0.3
    assert sum(p for _, p in observer.posterior()) == pytest.approx(1.0)


def test_a_push_is_placed_in_its_run_and_time(tracks):
    found, kind = evaluation(tracks["push"]), kind_of("side_force")
    misfit = found.misfits([()])[:, 0]
    part = event_starts(found, kind, (), misfit, combinations(kind)[3:])[0]
    assert part.intervals["r02"] == []
    [[start, end]] = part.intervals["r01"]
    assert abs(start - 120) <= 20 and abs(end - 220) <= 20
    force = part.effect(tracks["push"].ship).parameters["force_kN"]
    assert force > 200


@pytest.mark.slow
def test_a_wind_that_sets_in_over_minutes_needs_no_second_effect(tracks, monkeypatch):
    monkeypatch.setattr(ideal, "KINDS", tuple(kind_of(name) for name in ("wind_onset", "side_force", "rudder_offset")))
    monkeypatch.setattr(ideal, "UNMODELLED", ())
    observer = Observer.of(tracks["ramp"])
    names = {entry["name"]: entry["probability"] for entry in answer_of("c1", observer)["effects"]}
    assert names.pop("wind_onset") > 0.99
    assert max(names.values(), default=0.0) < 0.2
    part = next(part for part in observer.posterior()[0][0].parts if part.kind.name == "wind_onset")
    assert part.ramp in (90.0, 120.0, 150.0)
    assert abs(part.intervals["r01"][0][0] - 150) < 12


def test_gauss_newton_rests_where_it_began_at_the_truth(tracks):
    part = Part(kind_of("current"), 1.2, {"angle": 40.0})
    track = referred(tracks["exact current"], tracks["exact current"].truth(EFFECTS["exact current"]))
    fitted = evaluation(track, EFFECTS["exact current"], EXACT).fit((part,))
    assert fitted.parts[0].size == pytest.approx(1.2, abs=0.01)
    sd = np.sqrt(np.diag(fitted.covariance))
    assert abs(fitted.parts[0].extras["angle"] - 40.0) < 3 * sd[1]


def test_the_command_writes_answers_and_says_what_is_wrong(tmp_path, monkeypatch):
    (tmp_path / "set" / "c1").mkdir(parents=True)
    (tmp_path / "set" / "c1" / "manifest.json").write_text("{}")
    monkeypatch.setattr(ideal, "read_track", lambda case: None)
    monkeypatch.setattr(ideal.Observer, "of", classmethod(lambda cls, track, nuisance: None))
    monkeypatch.setattr(ideal, "answer_of", lambda name, observer: {"case": name})
    main([f"cases={tmp_path / 'set'}", f"out={tmp_path / 'out'}"])
    assert (tmp_path / "out" / "c1" / "answer.json").read_text().replace("\n", "") == '{ "case": "c1"}'
    with pytest.raises(InputError, match="write cases=DIR out=DIR"):
        main(["cases=x"])
    with pytest.raises(InputError, match="holds no case"):
        main([f"cases={tmp_path / 'out'}", f"out={tmp_path}"])
