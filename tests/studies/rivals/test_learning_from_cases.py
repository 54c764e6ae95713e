from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from fleet import unchecked
from rival_runs import CALM, SHIP, case_with, sailed

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.answers import answer
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from studies.concealed_trial.rivals import examples, neural, posterior, simulated
from studies.concealed_trial.rivals.features import COUNT, features, mirrored
from studies.concealed_trial.rivals.mixed import MixedEffect, ScatteredShip
from studies.concealed_trial.rivals.neural_result import judge_by_network
from studies.concealed_trial.rivals.others import DrawnForce, others
from studies.concealed_trial.rivals.package import SHIPS, Corrections, shelf
from studies.concealed_trial.rivals.pilot import numbers, pilot, told_of, values_of
from studies.concealed_trial.rivals.result import Limits, diagnosis
from studies.concealed_trial.rivals.whitened import WhitenedRuns

FEW = (RudderOffset(SHIP), Current(SHIP))
OFFSET = (RudderOffset, (("offset_deg", 1.5),))


@pytest.fixture(autouse=True)
def quick():
    with unchecked():
        yield


@pytest.mark.parametrize("ship", SHIPS)
def test_parameters_come_back_from_their_numbers(ship):
    hull = SHIPS[ship]()
    for effect in shelf(hull):
        values = {p.name: p.starts[-1] for p in told_of(effect)}
        back = values_of(effect, numbers(effect, values)[None])
        assert {name: float(v[0]) for name, v in back.items()} == pytest.approx(values, rel=1e-6, abs=1e-9), effect.name


def test_rows_of_a_mixed_batch_move_as_each_effect_alone():
    effects = [RudderOffset(SHIP, offset_deg=2.0), SteadyWind(SHIP, speed=12.0, from_deg=60.0)]
    effects += [PowerLimit(SHIP, rpm_slope=0.4), Current(SHIP, speed=0.8, toward_deg=30.0)]
    times, trial = torch.arange(0.0, 61.0, 2.0).to(SHIP.inertia), zigzag(20.0, duration=60.0)
    blocks = [(slice(k, k + 1), e.at(e.values[None])) for k, e in enumerate(effects)]

    def states(vessel, rows):
        start = SHIP.inertia.new_zeros(rows, 6)
        start[:, 0] = SHIP.particulars.speed
        inputs = simulated.Inputs(start[:, 0] * 0, time=start[:, 0] * 0)
        with torch.no_grad():
            whole = vessel.model.start(start, inputs)
            return rollout(vessel, [trial] * rows, whole, times, step=2.0).states[..., :6]

    together = states(Vessel(CALM, [MixedEffect(SHIP, blocks)]), len(effects))
    for k, effect in enumerate(effects):
        torch.testing.assert_close(together[:, k], states(Vessel(CALM, [effect]), 1)[:, 0], rtol=1e-9, atol=1e-7)


def test_a_scattered_ship_without_errors_is_the_ship_and_rough_water_pushes_it():
    count = len(Corrections(CALM).names)
    state = SHIP.inertia.new_tensor([[7.0, 0.3, 0.01, 0.0, 0.0, 0.2]])
    inputs = simulated.Inputs(state[:, 0] * 0 + 0.1, time=state[:, 0] * 0 + 1.5)
    rough = state.new_zeros(1, 3, 3)
    exact = ScatteredShip(CALM, state.new_zeros(1, count), rough)(state, inputs)
    torch.testing.assert_close(exact, CALM(state, inputs))
    rough[0, 1] = state.new_tensor([0.01, 0.0, 0.0])
    pushed = ScatteredShip(CALM, state.new_zeros(1, count), rough)(state, inputs)
    assert float((pushed - exact)[0, 0]) == pytest.approx(0.01)


def test_cases_are_sailed_with_their_effects_and_what_left_the_range_is_left_out(monkeypatch):
    monkeypatch.setattr(simulated, "LENGTH", 7.0)
    cases = simulated.simulate_cases(SHIP, "mariner", 5, seed=2)
    assert 4 <= len(cases) <= 5
    known = {e.name for e in (*shelf(SHIP), *others(SHIP))}
    assert all(set(c.values) <= known and len(c.runs) in {2, 3} for c in cases)
    assert all(np.isfinite(run["psi"]).all() and run.time[-1] >= 140 for c in cases for run in c.runs)


def test_a_made_up_force_acts_in_the_equation_that_was_drawn():
    s = WhitenedRuns(CALM, sailed()[:1], at_samples=True).tracks[0].line.situation
    force = DrawnForce(SHIP, size=0.3, equation=1.0, first=3.0, second=0.0, time_s=30.0)
    pushed = force.acceleration(s, s.nu[..., :0])
    assert float(pushed[:, [0, 2]].abs().max()) == 0.0
    assert float(pushed[:, 1].abs().max()) > 0.0


def test_features_have_their_length_and_mirror_twice_to_themselves():
    found = features(WhitenedRuns(CALM, sailed(), at_samples=True))
    assert found.shape == (COUNT,)
    assert np.isfinite(found).all()
    assert mirrored(mirrored(found[None]))[0] == pytest.approx(found)


def test_a_first_estimate_of_an_offset_is_near_it():
    data = WhitenedRuns(CALM, sailed([RudderOffset(SHIP, offset_deg=1.5)]))
    effect = RudderOffset(SHIP)
    assert values_of(effect, pilot(data, effect)[None, :3])["offset_deg"][0] == pytest.approx(1.5, abs=0.3)


@cache
def small_world() -> examples.Examples:
    """Clean cases and cases with an offset, in many noises; first estimates a tenth off."""
    rng, listed, effect = np.random.default_rng(0), examples.names(), RudderOffset(SHIP)
    offset, found = listed.index("rudder_offset"), []
    for size in (0.0, 1.5, -1.5):
        runs = sailed([RudderOffset(SHIP, offset_deg=size)] if size else [], seed=100)
        data = WhitenedRuns(CALM, runs, at_samples=True)
        seen, first = features(data), pilot(data, effect)
        for _ in range(150):
            present = np.eye(len(listed))[offset] * bool(size)
            targets = np.full((len(listed), 3), np.nan)
            pilots = np.full((len(listed), 5), np.nan)
            if size:
                targets[offset] = numbers(effect, {"offset_deg": size * float(rng.uniform(0.4, 2.0))})
                first[:3] = targets[offset] + [0.1 * rng.standard_normal(), 0.0, 0.0]
                pilots[offset] = first
            found.append((seen + 0.8 * rng.standard_normal(len(seen)), present, targets, pilots))
    rows = rng.permutation(len(found))
    return examples.Examples(*(np.stack([found[k][j] for k in rows]) for j in range(4)))


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    pytest.importorskip("sbi")
    with unchecked(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(neural, "MEMBERS", 2)
        patch.setattr(neural, "MAX_EPOCHS", 6)
        patch.setattr(posterior, "MAX_EPOCHS", 15)
        patch.setattr(posterior, "RATE", 1e-2)
        patch.chdir(tmp_path_factory.mktemp("here"))
        made = neural.learn(small_world())
        assert list(Path.cwd().iterdir()) == []  # sbi keeps a log of its training, of which nothing stays
        return made


@pytest.mark.slow
def test_a_network_names_and_sizes_an_offset_that_it_has_not_seen(learnt):
    case = case_with(OFFSET)
    said = answer(diagnosis(case, judge_by_network(case, learnt, FEW), Limits(6.0, 3.0)))
    assert (said["verdict"], said["effects"][0]["name"], said["model"]) == (
        "mismatch", "rudder_offset", ["rudder_offset"],
    )  # fmt: skip
    value, error, _ = said["effects"][0]["parameters"]["offset_deg"]
    assert value == pytest.approx(-1.5, abs=0.5)
    assert error > 0
    assert said["heldout_rmse_after"]["pos"] < said["heldout_rmse_before"]["pos"]


@pytest.mark.slow
def test_a_network_says_none_of_a_clean_case(learnt):
    found = judge_by_network(case_with(), learnt, FEW)
    assert found.verdict(Limits(6.0, 3.0)) == "none"
    assert found.probabilities["rudder_offset"] < 0.5


@pytest.mark.slow
def test_where_unknown_is_most_probable_it_is_said(learnt):
    found = judge_by_network(case_with(OFFSET), learnt, FEW)
    strange = replace(found, rest=found.evidence.misfit)
    assert strange.verdict(Limits(6.0, found.evidence.misfit - 1.0)) == "unknown"


@pytest.mark.slow
def test_what_was_learnt_comes_back_from_its_file(learnt, tmp_path):
    neural.save(learnt, tmp_path / "model.pt")
    back = neural.load(tmp_path / "model.pt")
    some = small_world().features[:5]
    assert back.probabilities(some) == pytest.approx(learnt.probabilities(some))
    condition = np.zeros(5 + len(examples.names()))
    assert back.posteriors.drawn(condition) == pytest.approx(learnt.posteriors.drawn(condition))


def test_a_model_that_is_not_there_is_said_in_a_line(tmp_path):
    with pytest.raises(InputError, match="write method=neural train=10000"):
        neural.load(tmp_path / "none.pt")


def test_examples_of_another_seed_are_refused(tmp_path):
    path = tmp_path / "cases.npz"
    made = small_world()
    parts = {kind: getattr(made, kind) for kind in examples.KINDS}
    np.savez(path, head='{"world": "shelf", "seed": 1}', batches=1, **parts)
    assert len(examples.examples("shelf", 100, 1, path).features) == 100
    with pytest.raises(InputError, match="holds other examples"):
        examples.examples("shelf", 100, 2, path)


def test_the_referee_draws_examples_with_the_channels_that_rivals_need(monkeypatch):
    class Drawn(Exception):
        pass

    def draw(seed, index, plan):
        channels.append(plan.channels)
        raise Drawn

    channels = []
    monkeypatch.setattr(examples, "draw_case", draw)
    for batch in range(20):
        with pytest.raises(Drawn):
            next(examples._of_referee(3, batch))
    assert set(channels) == {"full"}
