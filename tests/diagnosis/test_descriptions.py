"""What is said of what was found, by numbers that are known: kinds of forces, runs to sail next."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from pytest import approx
from trials import CALM, SHIP, values

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import (
    advise,
    answers,
    forecast,
    nature,
    next_runs,
    predictive,
    words,
)
from manoeuvre_nn.diagnosis.locate import unit_forces
from manoeuvre_nn.diagnosis.result import Cause, Value
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.sensors import LeverArm
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


def formula_of(terms: list[str], sds: float = 0.1, **numbers: float) -> FittedHypothesis:
    """A fitted formula at these numbers, all weights with the same standard error, scales with a tenth of theirs."""
    effect = Formula(SHIP, terms, **numbers)
    h = Hypothesis((effect,), (values(effect),))
    errors = [
        sds if f.parameter.name.startswith("w") else 0.1 * v for f, v in zip(h.unknowns(), h.vector(), strict=True)
    ]
    return FittedHypothesis(h, 20.0, np.zeros((1, 1)), np.diag(np.square(errors)))


KINDS = [  # terms, numbers; kind, where, scales with errors
    (["N r|r| cos psi", "Y |v||r|"], {"w1": 1.0, "w2": 0.5}, "tied to the heading", ("N",), {}),
    (["N r|r| cos psi", "Y |v||r|"], {"w1": 0.5, "w2": 1.0}, "tied to the motion", ("Y",), {}),
    (["Y 1", "N r"], {"w1": 0.5, "w2": 0.1}, "constant", ("Y",), {}),
    (["sensor psi r"], {"w1": 1.0}, "in an instrument", ("sensor:psi",), {}),
    (["Y lag d", "N lag d"], {"w1": 1.0, "w2": 1.0, "memory_s": 40.0}, "lagging", ("Y", "N"), {"memory": (40.0, 4.0)}),
    (["N cos periodic", "N sin periodic"], {"w1": 0.3, "w2": 0.3, "period_s": 50.0}, "periodic", ("N",),
     {"period": (50.0, 5.0), "phase at the start": (45.0, np.degrees(0.1 / 0.3 / 2**0.5))}),
    (["N cos periodic", "N sin periodic"], {"w1": -0.3, "w2": 0.0, "period_s": 50.0}, "periodic", ("N",),
     {"period": (50.0, 5.0), "phase at the start": (270.0, np.degrees(0.1 / 0.3))}),
    (["N cos periodic_by_run", "N sin periodic_by_run"], {"w1": 0.3, "w2": 0.3, "period_s": 50.0}, "periodic", ("N",),
     {"period": (50.0, 5.0)}),
    (["Y cos stripes", "Y sin stripes"], {"w1": 0.0, "w2": 0.3, "north_per_km": 3.0, "east_per_km": 4.0},
     "tied to the place", ("Y",),
     {"spacing": (200.0, 1000 * np.hypot(0.9, 1.6) / 5 / 25), "across": (np.degrees(np.arctan2(4.0, 3.0)),
      np.degrees(np.hypot(1.2, 1.2) / 25))}),
]  # fmt: skip


@pytest.mark.parametrize("terms, numbers, kind, where, scales", KINDS)
def test_a_formula_is_of_the_kind_of_its_clearest_terms(monkeypatch, terms, numbers, kind, where, scales):
    monkeypatch.setattr(nature, "_size", lambda data_set, formula, leading: (2.0, "kN"))
    fitted = formula_of(terms, **numbers)
    found = nature._by_rule(SimpleNamespace(dynamics=CALM), fitted, 7.0)
    assert (found.kind, found.equations, found.against, found.predictable) == (kind, where, 7.0, True)
    periodic = kind == "periodic"
    assert found.size.value == approx(2.0 * 2**0.5 if periodic else 2.0)
    assert found.size.name == ("amplitude" if periodic else "root mean square")
    weights = np.array([w for name, w in numbers.items() if name.startswith("w")]) / 0.1
    clearest = weights if len(where) == len(terms) or periodic or scales else weights[[weights.argmax()]]
    assert found.size.error / found.size.value == approx(1 / np.sqrt((clearest**2).sum()))
    assert {v.name: (v.value, v.error) for v in found.scales} == {k: approx(v, rel=1e-6) for k, v in scales.items()}


def test_a_growing_force_has_its_growth_a_minute():
    """A weight is what it is after ten minutes: a tenth of it a minute."""
    fitted = formula_of(["N t"], w1=0.5)
    data_set = SimpleNamespace(dynamics=CALM, unit=np.ones(4), runs=[])
    force = unit_forces(data_set)[2]
    (growth,) = nature._scales(data_set, fitted.hypothesis.effects[0], "growing", {"w1": 0.5}, {"w1": 0.1})
    assert (growth.name, growth.unit) == ("growth a minute", "MN m")
    assert (growth.value, growth.error) == approx((0.05 * force, 0.01 * force))


NATURES = [  # evidence of the formula, of a random force (None: model was fitted), whether proved -> by, against
    (20.0, 9.0, None, ("rule", 11.0)),
    (20.0, 24.0, None, ("chance", 4.0)),
    (20.0, 24.0, True, ("rule", -4.0)),
    (20.0, 9.0, False, ("chance", -11.0)),
    (20.0, 7.0, False, ("rule", 13.0)),  # as a swell that has another phase in other runs
    (20.0, None, False, ("rule", 17.0)),
    (2.0, 1.0, None, ("chance", -2.0)),  # neither beats calm water at 3
    (2.0, None, None, None),
    (None, 9.0, None, ("chance", 6.0)),
    (None, None, None, None),
]


@pytest.mark.parametrize("rule, chance, proved, expected", NATURES)
def test_something_unknown_is_described_by_a_proved_formula_or_by_what_is_likelier(
    monkeypatch, rule, chance, proved, expected
):
    monkeypatch.setattr(nature, "is_fitted", lambda dynamics: chance is None)
    monkeypatch.setattr(nature, "random_force", lambda likelihood, none: SimpleNamespace(evidence=chance, axes=(2, 0)))
    told = nature.Nature("", (), Value("", 0.0, 0.0, ""))
    for how in ("rule", "chance"):
        monkeypatch.setattr(
            nature, f"_by_{how}", lambda data_set, one, against, how=how: replace(told, kind=how, against=against)
        )
    monkeypatch.setattr(
        nature, "shape_of", lambda data_set, found: SimpleNamespace(hard=(0.7, 0.2), frame="body", parity="odd")
    )
    formula = None if rule is None else SimpleNamespace(evidence=rule)
    tried = SimpleNamespace(
        likelihood=SimpleNamespace(data_set=SimpleNamespace(dynamics=None)), none=SimpleNamespace(evidence=3.0)
    )
    found = nature.nature_of(tried, SimpleNamespace(formula=formula), [], proved)
    assert (None if found is None else (found.kind, found.against)) == expected
    assert found is None or (found.frame, found.parity, found.regime) == ("body", "odd", 0.7)
    assert found is None or found.clearest == (() if chance is None else ("N", "X"))


@pytest.mark.parametrize("proved, held_out, predictable, refuted", [
    (False, 8.1, False, False),  # beats of another phase: where and how often they come is right
    (False, 7.9, True, True),
    (True, 7.9, True, False),
    (None, 0.0, True, False),
])  # fmt: skip
def test_a_formula_with_which_free_runs_get_worse_tells_where_it_acts_if_held_out_runs_are_much_likelier(
    monkeypatch, proved, held_out, predictable, refuted
):
    told = nature.Nature("periodic", ("N",), Value("amplitude", 8.0, 0.5, "MN m"))
    monkeypatch.setattr(nature, "is_fitted", lambda dynamics: False)
    monkeypatch.setattr(nature, "random_force", lambda likelihood, none: SimpleNamespace(evidence=7.0, axes=(1,)))
    monkeypatch.setattr(nature, "_by_rule", lambda data_set, one, against: told)
    monkeypatch.setattr(nature, "shape_of", lambda *_: SimpleNamespace(hard=None, frame="", parity=""))
    data_set = SimpleNamespace(dynamics=None)
    tried = SimpleNamespace(likelihood=SimpleNamespace(data_set=data_set), none=SimpleNamespace(evidence=3.0))
    verdict = SimpleNamespace(formula=SimpleNamespace(evidence=20.0))
    found = nature.nature_of(tried, verdict, [], proved, held_out)
    assert (found.predictable, found.refuted) == (predictable, refuted)


# What to sail next ---------------------------------------------------------------------------------------------------


def test_what_a_rival_cannot_imitate_is_what_is_left_of_the_difference_with_a_prior_on_its_numbers():
    d, n, spread = np.array([3.0, 4.0]), np.array([1.0, 0.0]), 0.5
    gram = np.array([[d @ d, d @ n], [d @ n, n @ n]])
    assert advise.left_over(gram, np.array([spread])) == approx(0.5 * (25.0 - 9.0 / (1.0 + 4.0)))
    assert advise.left_over(gram, np.array([1e6])) == approx(8.0)
    assert advise.left_over(np.array([[1.0, 2.0], [2.0, 1.0]]), np.array([1e6])) == 0.0, "no less than nothing"


@pytest.mark.parametrize("heading, told", [(None, {}), (0.0, {"heading_deg": 0.0}), (-90.0, {"heading_deg": 270.0})])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_run_that_is_advised_is_said_for_machines(heading, told, share):
    sailed = {"manoeuvre": "zz20", "first_turn": "port"}
    plan = next_runs.Plan("a zigzag", sailed, None, None if heading is None else heading * DEGREE, share)
    assert plan.as_dict == {**sailed, **told, "speed_share": share}


def test_of_a_run_that_is_repeated_the_channel_is_said():
    again = {"repeat": "r01", "channel": "speed log"}
    assert next_runs.Plan("r01 again with the speed log", again, None).as_dict == again


def test_channels_that_can_be_written_down_too_are_those_of_a_run():
    named = {words: tuple(MEASURED[k] for k in at) for words, at in next_runs.CHANNELS.items()}
    assert named == {
        "position": ("x", "y"), "speed and course over ground": ("vn", "ve"), "heading": ("psi",),
        "rate of turn": ("r",), "speed log": ("u_log",), "shaft speed": (MEASURED[7],),
    }  # fmt: skip
    assert next_runs.HEADINGS == tuple(90.0 * k for k in range(4)), "from all four sides"


def test_manoeuvres_beyond_the_rudders_limit_are_not_tried():
    every, gentle = next_runs._manoeuvres(35 * DEGREE), next_runs._manoeuvres(30 * DEGREE)
    assert len(every) == 2 + 2 * (3 + 2) and set(every) - set(gentle) == {m for m in every if "35" in m}
    assert all(m.largest_order == approx(20 * DEGREE) for words, m in every.items() if "20" in words)


def test_bands_hold_nineteen_of_twenty():
    low, high = forecast.BAND
    assert high - low == approx(0.95) and low + high == approx(1.0)
    assert forecast.DRAWS * low >= 2, "an edge lies within the draws"


# Free runs -----------------------------------------------------------------------------------------------------------


def test_distances_are_compared_in_means_over_blocks_of_what_was_recorded():
    off = np.vstack([np.r_[np.nan, np.arange(1.0, 7.0)], np.arange(7.0) ** 2])
    assert predictive._blocks(off, 2) == approx(np.array([[1.5, 3.5, 5.5], [2.5, 12.5, 30.5]]))
    assert predictive._blocks(off, 9).shape == (2, 1)
    relative = predictive._relative(np.array([[3.0, -3.0], [1.0, 1.0], [2.0, 0.0]]))
    assert relative == approx(np.array([3.0, 1.0, np.sqrt(2.0)]) / np.sqrt(1.5))


def test_few_draws_have_a_tail_of_three():
    p = predictive.tail(np.array([2.0, 8.0, 16.0]), np.array([1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 4.0, 8.0]))
    mean = np.log([2.0, 4.0, 8.0]).mean()
    assert p == approx(3 / 8 * np.array([2.0, 8.0, 16.0]) ** (-1 / mean))


# Words ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value, error, said", [
    (12.345, 2.13, "12.3 ± 2.1 m"), (12.345, 0.0213, "12.345 ± 0.021 m"), (1234.5, 210.0, "1234 ± 210 m"),
    (12.345, 0.0, "12.3 m"), (12.345, float("nan"), "12.3 m"),
])  # fmt: skip
def test_a_value_is_told_to_two_digits_of_its_error(value, error, said):
    assert words._measured(Value("x", value, error, "m")) == said


def test_odds_and_probabilities_are_told_with_the_digits_that_matter():
    assert words._odds(8.92) == "odds 1 to 7,500" and words._odds(13.7) == "odds 1 to 890,000"
    assert words._odds(np.log(20.0)) == "odds 1 to 20" and words._odds(-3.0) == "odds 1 to 1"
    assert words._odds(13.7) != words._odds(13.9) == "odds less than one in a million" == words._odds(50.0)
    assert words._percent(0.499) == "50 %" and words._percent(1.0) == "99 %"
    assert [words._ln(f) for f in (3.14, 9.94, 9.96, -12.3)] == ["3.1", "9.9", "10", "-12"]


# Answers -------------------------------------------------------------------------------------------------------------


def unspecific(**more) -> SimpleNamespace:
    """A diagnosis that found nothing, but for what is given."""
    none = {"case": "c", "verdict": "none", "sentence": "", "doubtful": False, "causes": [], "model": [], "noise": {}}
    return SimpleNamespace(**{**none, "checks": [], "next_run": None, "rmse": lambda _: {}, **more})


def test_an_answer_has_the_rudder_positive_to_port_and_leaves_out_what_is_as_good_as_impossible():
    values_found = (
        Value("offset_deg", 2.0, 0.25, "deg", low=1.8, high=9.0),
        Value("speed", 3.0, float("nan"), "m/s", "monday"),
        Value("from_deg", 355.0, 10.0, "deg", period=360.0),
    )
    common = {"evidence": 9.0, "equations": ("N",), "fingerprint": "", "source": "", "label": ""}
    causes = [
        Cause("rudder_offset", probability=0.98765, parameters=values_found, intervals={"r1": [(1.26, 3.0)]}, **common),
        Cause(
            "gps_lever_arm",
            probability=1.1e-4,
            parameters=(),
            intervals=None,
            **common | {"equations": LeverArm.equations},
        ),
        Cause("log_scale", probability=0.9e-4, parameters=(), intervals=None, **common),
    ]
    rmse = {"pos": 1.234567, "psi": float("nan")}
    d = unspecific(causes=causes, verdict="mismatch", next_run={"repeat": "r1"}, rmse=lambda _: rmse)
    told = answers.answer(d)
    first, second = told["effects"]
    assert first["parameters"] == {
        "offset_deg": [-2.0, 0.25, "deg"], "speed (monday)": [3.0, None, "m/s"], "from_deg": [355.0, 10.0, "deg"]
    }  # fmt: skip
    ends = {"offset_deg": [-2.49, -1.8], "speed (monday)": None, "from_deg": [335.4, 14.6]}
    assert first["intervals_95"] == ends, "within what is possible, and round the compass"
    assert (first["probability"], first["intervals"], second["intervals"]) == (0.9877, {"r1": [[1.3, 3.0]]}, "all")
    assert (second["name"], told["model"], told["next_run"]) == ("gps_lever_arm", ["unknown"], {"repeat": "r1"})
    assert second["equation"] == ["sensor:x_north", "sensor:y_east", "sensor:u", "sensor:v"], "columns of the cases"
    assert told["heldout_rmse_before"] == {"pos": 1.2346, "psi": None}
    d.verdict = "none"
    assert answers.answer(d)["model"] == []


def test_headings_of_predictions_are_written_within_a_turn_and_their_bands_beside_them(tmp_path):
    table = pd.DataFrame({"t": [0.0, 1.0], "psi": [725.0, -10.0], "psi_low": [719.0, -12.0], "psi_high": [731.0, 2.0]})
    proof = SimpleNamespace(run="r1", before=table[["t", "psi"]], after=table)
    d = unspecific(proofs=[proof], forecasts=[])
    answers.write_answer(d, tmp_path)
    written = pd.read_csv(tmp_path / "predictions" / "after" / "r1.csv")
    assert written.to_numpy() == approx(np.array([[0.0, 5.0, -1.0, 11.0], [1.0, 350.0, 348.0, 362.0]]))
    assert (tmp_path / "predictions" / "before" / "r1.csv").exists() and (tmp_path / "answer.json").exists()


# Planned runs --------------------------------------------------------------------------------------------------------


def test_coefficients_of_which_the_fitted_runs_show_nothing_keep_their_usual_scatter(monkeypatch):
    """Of three coefficients, two of them correlated, one combination is seen: the draws have none of it."""
    root = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 2.0]])
    seen = root @ np.array([[0.6], [0.8], [0.0]])
    monkeypatch.setattr(forecast, "Corrections", lambda dynamics: SimpleNamespace(names=()))
    data_set = SimpleNamespace(dynamics=None, rotation=seen, coefficient_prior=SimpleNamespace(root=lambda names: root))
    drawn = forecast.unseen_scatter(data_set, 2, 20001, np.random.default_rng(0))
    whitened = np.linalg.solve(root, drawn[1:].T)
    assert (drawn[0] == 0.0).all() and np.abs(np.linalg.solve(root, seen).T @ whitened).max() < 1e-12
    assert np.array([[0.8, -0.6, 0.0], [0.0, 0.0, 1.0]]) @ np.cov(whitened) @ np.array([
        [0.8, 0.0],
        [-0.6, 0.0],
        [0.0, 1.0],
    ]) == approx(COEFFICIENT_SD_LEVELS[2] ** 2 * np.eye(2), abs=3e-5)


def test_planned_runs_are_predicted_with_bands_and_prove_nothing(monkeypatch):
    columns = ["t", "x", "y", "psi", "u", "v", "r", "u_log"]
    table = pd.DataFrame(1.0, index=range(3), columns=columns)
    run = SimpleNamespace(name="plan", meta={"kind": "zigzag"})
    known = SimpleNamespace(rows=lambda runs: [0])
    asked, drawn = [], [table + k for k in range(3)]
    monkeypatch.setattr(forecast, "known_of", lambda data_set, chosen: known)
    monkeypatch.setattr(forecast, "predict", lambda dynamics, h, runs, *more: asked.append((dynamics, more)) or [table])
    monkeypatch.setattr(forecast, "drawn_tables", lambda known, there, runs, warmup: [drawn])
    monkeypatch.setattr(forecast, "_noise", lambda known: dict.fromkeys(forecast.COLUMNS, 0.0))
    monkeypatch.setattr(forecast, "recorded", lambda run, warmup: table.copy())
    chosen = SimpleNamespace(names=(), hypothesis=Hypothesis((), ()))
    question = SimpleNamespace(dynamics="calm", case=SimpleNamespace(planned=[run], warmup=40.0))
    (made,) = forecast.forecasts(question, None, chosen)
    assert asked == [("calm", (40.0,))] and made.before is table
    assert (made.after.x == 1.0).all() and made.after.x_low.between(2.0, 2.1).all(), "the first is the most likely one"
    assert np.isnan(list(made.rmse_after.values())).all() and made.recorded["t"].notna().all()
    question.case.planned = []
    assert forecast.forecasts(question, None, chosen) == []


def test_a_rival_is_fitted_again_within_three_of_its_spreads_but_for_times_of_events(monkeypatch):
    rival = Hypothesis((SideForce(SHIP),), (values(SideForce(SHIP)),))
    monkeypatch.setattr(advise, "hypothesis_columns", lambda data_set, rival: None)
    monkeypatch.setattr(advise, "_shared", lambda *_: np.eye(1))
    _, sd = advise._grams(SimpleNamespace(combinations=2), [None], rival, (0, 2))
    shared = [s for f, s in zip(rival.unknowns(), rival.prior_sds(), strict=True) if not f.parameter.per_run]
    assert sd == approx([0.03, 0.03, *(3 * np.array(shared))])
