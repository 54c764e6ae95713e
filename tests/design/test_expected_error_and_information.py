"""What to sail next: members that sail and learn from one another, and what columns tell about coefficients."""

from dataclasses import replace
from functools import cache
from math import atan, log, tan

import numpy as np
import pytest
import torch
import yaml
from fleet import unchecked

from manoeuvre_nn.core.channels import MOTION
from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Stability
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.design import expected_error
from manoeuvre_nn.design.candidates import CandidateRun, ExpectedGain, remark, sail
from manoeuvre_nn.design.expected_error import DesignEffort, disagreements, prospects
from manoeuvre_nn.design.expected_information import _columns, information
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.members import sail_members
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.network.perceptron import wang_network
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.ensemble import train_ensemble

FIRST = zigzag(35.0, duration=150.0)
CANDIDATES = [FIRST, zigzag(10.0, duration=200.0)]
TARGETS = [zigzag(20.0, duration=150.0), turning_circle(10.0, duration=200.0)]
EFFORT = DesignEffort(truths=2, others=3, samples=100)


@cache
def recorded() -> Tuples:
    with unchecked():
        return to_tuples(roll_out(CalmWater(mariner()), [FIRST]), clarke_part(mariner()))


@cache
def ensemble() -> IdentifiedShip:
    """Four members that were trained for a few steps."""
    with unchecked():
        return train_ensemble(
            clarke_part(mariner()), HullRudder(HullRudderSettings(6, 4)), recorded(), Stops(epochs=12)
        )


made: dict[tuple[object, ...], list[CandidateRun]] = {}


def sailed(model: IdentifiedShip, manoeuvres, interval: float | None = None) -> list[CandidateRun]:
    """What :func:`.sail` gives, once for the same weights: most tests ask for the same few runs of the ensemble."""
    asked = *((k, w.numpy().tobytes()) for k, w in model.state_dict().items()), repr(manoeuvres), interval
    if asked not in made:
        made[asked] = sail(model, manoeuvres, interval)
    return made[asked]


@pytest.fixture(autouse=True)
def sailed_once(monkeypatch) -> None:
    monkeypatch.setattr(expected_error, "sail", sailed)


@cache
def advised() -> ExpectedGain:
    """What the second candidate is expected to tell."""
    with unchecked():
        return prospects(ensemble(), recorded(), CANDIDATES[1:], TARGETS, effort=EFFORT)[0]


def with_weights(model: IdentifiedShip, inside, outside) -> IdentifiedShip:
    return IdentifiedShip(model.known, model.network.with_weights(inside, outside), model.scaling)


def alike(model: IdentifiedShip) -> IdentifiedShip:
    """Members that are all the first one."""
    network = model.network
    same = [w.detach()[:1].repeat(4, 1, 1) for w in (network.input_weights, network.output_weights)]
    return with_weights(model, *same)


def run_of(ended=(torch.inf, torch.inf)) -> CandidateRun:
    """Two members that turn steadily at 7 m/s and 1 deg/s."""
    states = torch.zeros(2, 5, 6, dtype=torch.float64)
    states[..., 0], states[..., 2] = 7.0, 1.0 * DEGREE
    times, rudders = torch.arange(5, dtype=torch.float64), torch.zeros(2, 5, dtype=torch.float64)
    return CandidateRun(zigzag(20.0), times, states, rudders, torch.tensor(ended, dtype=torch.float64))


def test_members_sail_coarsely_where_they_sail_in_fine_steps():
    model, targets = ensemble(), [replace(m, duration=100.0) for m in TARGETS]
    with unchecked():
        coarse, fine = sail(model, targets), sail_members(model, targets)
    for run, others in zip(coarse, fine, strict=True):
        for track, other in zip(run.tracks.numpy(), others, strict=True):
            there = other.resampled(run.times.numpy())
            assert abs(there["x"] - track[:, 0]).max() < 0.02 * 152.4
            assert abs(there["y"] - track[:, 1]).max() < 0.02 * 152.4


def test_a_run_is_as_long_as_its_manoeuvre_and_keeps_its_place():
    fast = [replace(m, speed=speed) for m, speed in zip(TARGETS * 2, (None, 5.0, None, 5.0), strict=True)]
    with unchecked():
        runs = sail(ensemble(), fast)
    assert [r.manoeuvre for r in runs] == fast
    for run in runs:
        step = 152.4 / (run.manoeuvre.speed or 7.614) / 8  # eight in the time in which she sails her length
        assert run.times.diff().tolist() == pytest.approx([step] * (len(run.times) - 1))
        assert run.manoeuvre.duration - step < run.seconds <= run.manoeuvre.duration
    assert runs[1].states[0, 0, 0] == 5.0


def test_a_model_without_members_is_its_own_single_one():
    known = clarke_part(mariner())
    model = IdentifiedShip(known, wang_network(3).double(), ensemble().scaling)
    with unchecked():
        (run,) = sail(model, TARGETS[:1])
    assert run.states.shape[0] == 1


def as_the_first_made_it(model: IdentifiedShip) -> Tuples:
    """What was recorded, if the first member were the ship."""
    few = recorded()
    with torch.no_grad():
        x = model.scaling.inputs(few.inputs)
        forces = model.network.of(x, torch.zeros(len(x), dtype=torch.long))
    return replace(few, targets=model.scaling.restore(forces))


@pytest.mark.slow
def test_members_that_are_the_truth_expect_no_deviation_and_learn_nothing():
    model = alike(ensemble())
    with unchecked():
        found = prospects(model, as_the_first_made_it(model), CANDIDATES, TARGETS, effort=EFFORT)
    assert [(p.now < 1e-6, p.then < 1e-6) for p in found] == [(True, True)] * 2


@pytest.mark.slow
def test_a_manoeuvre_that_is_recorded_already_tells_less_than_another():
    with unchecked():
        same, other = prospects(ensemble(), recorded(), CANDIDATES, TARGETS, effort=EFFORT)
    assert abs(same.gain) < 0.25 * other.gain
    assert other.gain == pytest.approx(other.now - other.then)
    assert other.per_minute == pytest.approx(other.gain * 60 / other.seconds)
    assert other.now == pytest.approx(sum(pair[0] for pair in other.targets.values()) / 2)
    assert other.status == OK


@pytest.mark.slow
def test_members_that_have_the_truths_nodes_learn_the_truth():
    """Least squares finds its linear weights, wherever theirs were."""
    model, first = ensemble(), ensemble().network
    inside, outside = first.input_weights.detach()[:1].repeat(4, 1, 1), first.output_weights.detach()[:1]
    generator = torch.Generator().manual_seed(1)
    drawn = torch.randn(4, *outside.shape[1:], generator=generator, dtype=torch.float64)
    drawn[0], drawn[..., :6] = 0.0, 0.0  # the truth, and the columns of the nodes, which are nearly dependent
    family = with_weights(model, inside, outside + 0.02 * drawn)
    with unchecked():
        tracks = sailed(family, TARGETS)[1].tracks
        (found,) = prospects(
            family, as_the_first_made_it(family), CANDIDATES[1:], TARGETS, effort=DesignEffort(truths=1, others=3)
        )
    apart = float((tracks[1:].quantile(0.5, dim=0) - tracks[0]).norm(dim=-1).max()) / mariner().particulars.length
    assert apart > 0.02
    assert found.now < 0.3 * apart and found.then < 0.3 * apart


@pytest.mark.slow
def test_the_same_seed_gives_the_same_advice(monkeypatch):
    monkeypatch.setattr(expected_error, "sail", sail)  # each time anew
    with unchecked():
        again = prospects(ensemble(), recorded(), CANDIDATES[1:], TARGETS, effort=EFFORT)
    assert again == [advised()]


def test_members_disagree_only_where_they_differ():
    with unchecked():
        runs, others = sailed(ensemble(), TARGETS), sailed(alike(ensemble()), TARGETS)
    differ = disagreements(ensemble(), recorded(), runs)
    same = disagreements(alike(ensemble()), recorded(), others)
    largest = differ.groupby("manoeuvre", sort=False)["spread"].max()
    assert (largest > 0).all() and same["spread"].max() < 1e-9
    assert list(largest.index) == ["zz20", "tc10"]
    assert differ["delta"].iloc[-1] == pytest.approx(10 * DEGREE)
    assert 0.05 < differ["r"].iloc[-1] < 1.0  # a turn to starboard, in U0/L


def test_what_speaks_against_a_manoeuvre_is_told():
    ship = replace(mariner().particulars, stability=Stability(0.6, 8.4, 21.5))
    heel = atan(7.0 * DEGREE * (8.4 - 8.138 / 2) / (9.81 * 0.6)) / DEGREE
    assert heel < 12 and remark(run_of(), ship) == OK
    tender = replace(ship, stability=Stability(0.2, 8.4, 21.5))
    heel = atan(7.0 * DEGREE * (8.4 - 8.138 / 2) / (9.81 * 0.2)) / DEGREE
    assert heel > 12 and remark(run_of(), tender) == f"heels {heel:.0f} deg"
    for limit, words in ((11.8, OK), (12.2, "heels 12 deg")):
        gm = 7.0 * DEGREE * (8.4 - 8.138 / 2) / (9.81 * tan(limit * DEGREE))
        assert remark(run_of(), replace(ship, stability=Stability(gm, 8.4, 21.5))) == words
    assert remark(run_of((torch.inf, 3.0)), ship) == "1 of 2 members left the physical range at 3 s"


@pytest.mark.parametrize("whole", [True, False], ids=["own products", "Taylor series"])
def test_a_run_repeated_divides_standard_errors_by_the_root_of_two(whole):
    ship, known = mariner(), clarke_part(mariner())
    with unchecked():
        (run,) = sailed(ensemble(), [zigzag(20.0, duration=300.0)])
    path = run.states[..., :3].quantile(0.5, dim=0) / known.velocity_units
    inputs = torch.cat([path, run.rudders.quantile(0.5, dim=0)[:, None]], dim=-1)
    count = len(inputs)
    same = Tuples(inputs, torch.zeros(count, 3).double(), run.times, torch.zeros(count, dtype=torch.long))
    given = ship if whole else ship.particulars
    (found,), names = information(given, known, same, [run], float(run.times[1]))
    assert names == ("the ship's own products" if whole else "a third-order Taylor series")
    if whole:  # of the series some directions are below rounding
        assert found.gain == pytest.approx(0.5 * log(2), rel=1e-3)
        assert found.then / found.now == pytest.approx(0.5**0.5, rel=1e-3)
    assert 0.5**0.5 - 1e-6 < found.then / found.now <= 1.0
    counts = {e: columns.shape[1] for e, columns in _columns(given, known, same).items()}
    own = dict(zip("XYN", (ship.table != 0).sum(dim=0).tolist(), strict=True))
    assert (counts == own) is whole and set(found.targets) == set(counts)
    assert found.per_minute == pytest.approx(60 * found.gain / found.seconds)


@pytest.mark.slow
def test_what_sensors_make_of_a_candidate_is_what_is_learnt_from():
    """Each truth's run is handed to the recorder as the data were recorded, and noise costs gain."""
    seen, known = [], clarke_part(mariner())

    def recorder(noise: float):
        def record(run, seed):
            seen.append((run.name, seed, run.time[1], sorted(run.channels), run.meta["time_unit"]))
            slopes = {f"{k}dot": np.gradient(run[k], run.time) for k in ("u", "v", "r")}
            tuples = to_tuples([run.with_channels(**slopes)], known)
            stream = np.random.default_rng(seed)
            more = noise * tuples.targets.std(0) * torch.as_tensor(stream.standard_normal(tuples.targets.shape))
            return replace(tuples, targets=tuples.targets + more)

        return record

    def gain(noise: float) -> float:
        with unchecked():
            args = ensemble(), recorded(), CANDIDATES[1:], TARGETS
            return prospects(*args, record=recorder(noise), effort=replace(EFFORT, seed=3))[0].gain

    assert gain(0.0) > 0 > gain(30.0)
    assert seen[:2] == [("zz10", 3 * 1009 + k, 1.0, sorted(MOTION), mariner().particulars.time_unit) for k in (0, 3)]


def test_python_computes_as_much_as_the_command():
    assert DesignEffort() == DesignEffort(**yaml.safe_load((CONF / "excite.yaml").read_text())["effort"])


def test_wrong_settings_are_told():
    with pytest.raises(InputError, match="effort.others=1: expected 2 or more"):
        DesignEffort(others=1)
    single = IdentifiedShip(clarke_part(mariner()), wang_network(3).double(), ensemble().scaling)
    with pytest.raises(InputError, match="goal=accuracy asks the members of an ensemble"):
        prospects(single, recorded(), CANDIDATES, TARGETS)
    with pytest.raises(InputError, match="name at least one manoeuvre of each"):
        prospects(ensemble(), recorded(), [], TARGETS)
    with pytest.raises(InputError, match="names no manoeuvre"):
        information(mariner(), clarke_part(mariner()), recorded(), [], 1.0)


def test_a_track_that_is_lost_counts_as_five_lengths_however_far_it_goes(monkeypatch):
    before = []

    def far_off(model, manoeuvres, *interval):
        runs = sail(model, manoeuvres, *interval)
        before.append(runs)
        shift = torch.tensor([0.0, 0.0, 0.0, 1e5, 0.0, 0.0])  # of the truths' tracks, which are sailed first
        return [replace(run, states=run.states + shift) for run in runs] if len(before) == 1 else runs

    monkeypatch.setattr(expected_error, "sail", far_off)
    few = replace(EFFORT, truths=1, others=2, samples=50)
    with unchecked():
        (found,) = prospects(ensemble(), recorded(), [zigzag(10.0, duration=30.0)], [FIRST], effort=few)
    assert (found.now, found.then, found.gain) == (5.0, 5.0, 0.0)


def test_a_candidate_gets_no_credit_for_itself():
    candidates, targets = [zigzag(10.0, duration=120.0)], [replace(m, duration=100.0) for m in TARGETS]
    few = replace(EFFORT, truths=1, others=2, samples=50)
    with unchecked():
        (found,), (without,) = (
            prospects(ensemble(), recorded(), candidates, some, effort=few)
            for some in ([*targets, *candidates], targets)
        )
    assert found.then / found.now == pytest.approx(without.then / without.now, rel=1e-6)
    assert found.now == pytest.approx(sum(pair[0] for pair in found.targets.values()) / 3)
    assert set(found.targets) == {*without.targets, candidates[0].name}
