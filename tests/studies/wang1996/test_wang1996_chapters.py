"""Wang 1996, chapters 2 to 5.2 and appendix A, done again in the quick form."""

import re
from functools import cache
from math import isfinite

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from tiers import mainly

from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.steepest_descent import RateSchedule
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ComputingEffort
from studies.wang1996 import chapter3 as wang1996_chapter3
from studies.wang1996 import chapter4 as wang1996_chapter4
from studies.wang1996 import chapter5 as wang1996_chapter5
from studies.wang1996.networks import case, flown, published
from studies.wang1996.trainings import BEST_START, STARTS, Slopes, levenberg_marquardt

EFFORT = ComputingEffort(quick=True, starts=2)
SHORT = RateSchedule((0.02,), (100,), 0.0)


@cache
def of(name):
    with unchecked():
        return case(name)


def trials(ship, whole=wang1996_chapter3.trials):
    """Of the corrected ship a spiral of short holds stands for that of long ones, of which only a table tells."""
    with pytest.MonkeyPatch.context() as patch:
        if ship.coefficients != ship_named("mariner").coefficients:
            patch.setattr(wang1996_chapter3, "spiral", lambda *angle, **more: spiral(*angle, **more | {"hold": 60.0}))
        return whole(ship)


@cache
def done(module):
    with unchecked(), pytest.MonkeyPatch.context() as patch:
        plans = {k: p.__class__(p.label, p.scaling, SHORT, 30) for k, p in wang1996_chapter4.plans(EFFORT).items()}
        patch.setattr(wang1996_chapter4, "plans", lambda effort: plans)
        patch.setattr(wang1996_chapter3, "trials", trials)
        return module.chapter(EFFORT, lambda text: None)


def figures(section):
    """Numbers of the figures that the captions name, ranges spelt out."""
    found = set()
    for plot in section.plots:
        for first, last in re.findall(r"Fig(?:ure)?s? [\dA]\.(\d+)(?:-[\dA]\.(\d+))?", plot.caption):
            found |= set(range(int(first), int(last or first) + 1))
        found |= {int(n) for n in re.findall(r" and [\dA]\.(\d+)", plot.caption)}
        for last in re.findall(r" and ([\dA])\.(\d+)-[\dA]\.(\d+)", plot.caption):
            found |= set(range(int(last[1]), int(last[2]) + 1))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("module", [wang1996_chapter3, wang1996_chapter4])
def test_every_claim_that_fails_says_why(module):
    for claim in done(module).claims:
        if claim.verdict != "holds":
            assert claim.why, claim


@pytest.mark.slow
@pytest.mark.parametrize(("module", "numbers"), [(wang1996_chapter3, range(2, 13)), (wang1996_chapter4, range(1, 18))])
def test_every_figure_is_drawn_again(module, numbers):
    assert set(numbers) <= figures(done(module))
    for plot in done(module).plots:
        for line in (line for panel in plot.panels for line in panel.lines):
            assert len(line.x) == len(line.y) and np.isfinite(line.y).all()


@pytest.mark.parametrize(
    ("ship", "chapter", "tables", "count"),
    mainly(
        1,
        [
            ("mariner", "3", ("Table 3.1", "Table 3.2"), 6 + 26 + 5),
            ("great_lakes_bulker", "A", ("Table A.1", "Table A.2"), 6 + 21 + 3),
        ],
    ),
)
def test_the_tables_of_both_ships_are_those_that_are_simulated(ship, chapter, tables, count):
    printed = read_claims("wang1996", chapter).at(*tables)
    claims = printed.beside({"table": wang1996_chapter3.ship_values(of(ship).ship)})
    assert len(claims) == count
    assert {c.verdict for c in claims} == {"holds"}


@pytest.mark.parametrize(
    ("ship", "chapter", "tables"),
    mainly(
        1,
        [
            ("mariner", "4", ("Table 4.1", "Eq 4.18")),
            ("great_lakes_bulker", "A", ("Table A.3", "Table A.4", "Table A.5", "Eq")),
        ],
    ),
)
def test_the_estimated_coefficients_are_the_printed_ones_but_for_equation_4_18(ship, chapter, tables):
    printed = read_claims("wang1996", chapter).at(*tables)
    claims = printed.beside(wang1996_chapter4.estimate_values(of(ship).known))
    assert len(claims) == 14 and [c.what for c in claims if c.verdict != "holds"] == ["X_dd = -2 Y_d"]
    assert max(abs(c.difference) for c in claims[:-1]) < 2e-5


@pytest.mark.parametrize(
    ("ship", "chapter", "tables"),
    mainly(1, [("mariner", "4", "Tables 4.2 and 4.3"), ("great_lakes_bulker", "A", "Tables A.6 and A.7")]),
)
def test_the_published_weights_hold_when_reordered_and_not_as_labelled(ship, chapter, tables):
    claims = read_claims("wang1996", chapter).at(tables).beside(wang1996_chapter4.weight_values(of(ship)))
    assert [c.verdict for c in claims] == ["does not hold", "holds"] * 3
    assert all(c.ours > 100 for c in claims[::2])


@pytest.mark.slow
def test_the_loop_of_the_spiral_is_the_published_one_and_gone_with_long_holds():
    section = done(wang1996_chapter3)
    drawn = next(c for c in section.claims if c.where == "Fig 3.12")
    meaning = next(c for c in section.claims if c.where == "Section 3.5")
    assert drawn.ours == "0.290 deg/s high, 3.25 deg wide"
    assert meaning.verdict == "does not hold"
    assert float(re.search(r"600-s holds ([\d.]+)", meaning.why)[1]) < 0.001
    assert "+0.0033" in meaning.why


def test_a_loop_between_two_known_branches_is_as_high_and_wide_as_they_are_apart():
    there, back = np.linspace(20, -20, 9), np.linspace(-20, 20, 9)[1:]
    rudder, rate = np.concatenate([there, back]), np.concatenate([0.1 * there + 0.3, 0.1 * back - 0.1])
    rate[8] = -2.0
    assert wang1996_chapter3.loop(rudder, rate) == pytest.approx((0.4, 4.0))


@pytest.mark.slow
def test_a_step_of_1_s_does_no_harm_where_crossings_are_located():
    with unchecked():
        rows = wang1996_chapter3.step_rows(of("mariner").ship, 100.0)
    located, coarse, fine = (float(row["dev [L]"]) for row in rows)
    assert located < 1e-3 < fine < coarse


@pytest.mark.parametrize("activation", ["sigmoid", "tanh"])
def test_gradients_by_formula_are_autograds(activation):
    network = Perceptron((3, 4, 5, 1), activation=activation, initial="symmetric", seed=2)
    generator = torch.Generator().manual_seed(3)
    x, y = (torch.randn(size, generator=generator, dtype=torch.float64) for size in ((9, 4), (3, 9)))
    loss = (network.rows(x)[..., 0] - y).square().sum() / 9
    expected = torch.autograd.grad(loss, list(network.parameters()))
    Slopes(network, x, y).set_gradients()
    for weights, gradient in zip(network.parameters(), expected, strict=True):
        torch.testing.assert_close(weights.grad, gradient, rtol=1e-12, atol=1e-14)


@cache
def sailed():
    """Networks of ours and the published ones in the zigzag and the turn."""
    with unchecked():
        networks = {"ours": levenberg_marquardt("mariner", BEST_START, EFFORT), "theirs": published(of("mariner"))}
        return flown(of("mariner"), networks, ["zz35", "tc25"])


@pytest.mark.slow
def test_levenberg_marquardt_fits_the_zigzag_many_times_closer_than_the_published_weights():
    ours, theirs = sailed()["ours"], sailed()["theirs"]
    assert ours.networks.errors.shape == (2, 3)
    assert (ours.networks.errors < 0.5 * theirs.networks.errors).all()
    assert ours.dev["zz35"].max() < theirs.dev["zz35"][0] <= 0.015
    assert theirs.dev["tc25"][0] == pytest.approx(0.087, abs=0.01)


@pytest.mark.slow
def test_the_middling_run_is_the_one_with_the_median_deviation():
    flight = sailed()["ours"]
    worse = int(np.argmax(flight.dev["tc25"]))
    assert flight.middle("tc25") is flight.runs["tc25"][worse]


@pytest.mark.slow
@pytest.mark.parametrize(("good", "verdict"), [(0.1, "holds"), (0.05, "holds in direction"), (0.001, "does not hold")])
def test_a_prediction_is_judged_by_its_deviation_and_every_verdict_says_why(good, verdict):
    flights = {"published": sailed()["theirs"]} | dict.fromkeys(STARTS, sailed()["ours"])
    found = wang1996_chapter5.generalization_values(flights, good) | {"good": good, "fair": 3 * good}
    claims = read_claims("wang1996", "5.2").at("Figs 5.8-5.11").beside(found)
    assert [c.verdict for c in claims if "published" in c.what] == [verdict]
    assert len(claims) == 1 + len(STARTS) and all(c.why for c in claims)


def test_a_sample_of_the_zigzag_is_mostly_at_full_rudder():
    (claim,) = read_claims("wang1996", "4").at("Section 4.4.1").beside(wang1996_chapter4.sample_values(of("mariner")))
    assert claim.ours == "73% at >= 34 deg"


@pytest.mark.slow
@pytest.mark.parametrize("module", [wang1996_chapter3, wang1996_chapter4])
def test_every_number_of_ours_is_a_number(module):
    assert all(isinstance(c.ours, str) or isfinite(c.ours) for c in done(module).claims)
