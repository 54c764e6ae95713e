"""What a diagnosis adds at its end: a network on top, shaded times, noise; and of which ship a manifest may be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from searches import fitted
from trials import SHIP

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis import diagnose
from manoeuvre_nn.diagnosis.manifest import adapted
from manoeuvre_nn.diagnosis.result import Residual
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.estimation.hypothesis import Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")
CHANNELS = ("x", "y", "vn", "ve", "psi", "r", "u_log", "shaft")


@pytest.mark.parametrize("after, evidence, proved, helped", [
    (0.9, 1.0, True, True), (1.1, 1.0, True, False), (0.9, -1.0, True, False), (0.9, 1.0, False, False)
])  # fmt: skip
def test_a_network_on_top_must_bring_free_runs_nearer_and_make_held_out_runs_likelier(
    monkeypatch, after, evidence, proved, helped
):
    chosen, with_it = fitted(5.0, "current"), fitted(9.0, "current", "log_scale")
    monkeypatch.setattr(diagnose, "refined", lambda data_set, j: data_set)
    monkeypatch.setattr(diagnose, "MarginalLikelihood", lambda data_set: data_set)
    monkeypatch.setattr(diagnose, "with_remainder", lambda likelihood, j, progress: with_it)
    monkeypatch.setattr(diagnose, "in_held_out_runs", lambda question, j: SimpleNamespace(
        hypothesis=None, evidence=evidence if j is with_it else 0.0
    ))  # fmt: skip
    monkeypatch.setattr(diagnose, "prove", lambda question, j, there, proofs: ["after"] if proved else [])
    monkeypatch.setattr(diagnose, "error_after", lambda question, proofs: after if proofs == ["after"] else 1.0)
    monkeypatch.setattr(diagnose, "unit_of_error", lambda question: "L")
    tried = SimpleNamespace(likelihood=SimpleNamespace(data_set=None))
    found, proofs, (check,) = diagnose._with_network(None, tried, (chosen, ["before"], []), lambda _: None)
    assert (found, proofs) == ((with_it, ["after"]) if helped else (chosen, ["before"]))
    assert check.passed is helped and ("no held-out run" in check.text) is not proved


def test_the_times_of_an_event_are_shaded_in_the_runs_that_had_it_and_in_others_what_is_missing():
    flat = np.zeros((3, 3))
    runs = [Residual(name, np.arange(3.0), flat, flat, flat, [(1.0, 2.0)]) for name in ("r1", "r2", "r3")]
    events = SimpleNamespace(intervals={"r1": [(0.0, 1.0)], "r2": []})
    shown = diagnose._shaded(runs, [events, SimpleNamespace(intervals=None)])
    assert [r.windows for r in shown] == [[(0.0, 1.0)], [(1.0, 2.0)], [(1.0, 2.0)]]


def test_weights_of_a_network_are_told_by_their_names_and_of_effects_there_are_none():
    network = Remainder(SHIP)
    weights = np.linspace(-1.0, 1.0, len(network.declared))
    both = fitted(0.0, "current")
    assert diagnose._network(both) == {}
    both = replace(both, hypothesis=both.hypothesis.joined(Hypothesis((network,), (weights[None],))))
    told = diagnose._network(both)
    assert list(told) == [p.name for p in Remainder.declared] and list(told.values()) == approx(weights, rel=1e-5)


def test_the_largest_error_over_its_noise_is_told_of_channels_whose_noise_is_known():
    proofs = [SimpleNamespace(rmse_after={"pos": 6.0, "psi": 0.4, "u": 9.0, "r": np.nan, "v": 7.0})]
    noise = {"pos": 2.0, "psi": 0.1, "u": 0.0, "r": 0.1, "v": np.nan}
    assert diagnose._over_noise(proofs, noise) == "; RMS errors are up to 4 times the measurement noise (psi)"
    assert diagnose._over_noise(proofs, {"u": 0.0}) == "" == diagnose._over_noise([], noise)


def test_noise_is_the_root_mean_square_over_the_runs_that_sensed_a_channel():
    """Of channels with 1, 2, ... 8 times as much, once and seven times: 5 times in all. Positions in both axes."""

    def run(size: float, *derived: str) -> SimpleNamespace:
        line = SimpleNamespace(run=SimpleNamespace(derived=derived), states=SimpleNamespace(channels=CHANNELS))
        return SimpleNamespace(linearised=line, sample_noise=size * np.arange(1.0, 9.0))

    told = diagnose._noise(SimpleNamespace(runs=[run(1.0, "vn", "ve"), run(7.0, "ve")]))
    assert (told["pos"], told["u_log"], told["u"]) == approx((5 * np.sqrt(5.0), 35.0, 21.0)) and np.isnan(told["v"])
    assert (told["psi"], told["r"]) == approx((np.degrees(25.0), np.degrees(30.0)))
    assert diagnose._noise(SimpleNamespace(runs=[run(1.0)]))["v"] == approx(4.0)


@pytest.mark.parametrize("key, own", [("beam_m", "beam"), ("length_m", "length"), ("draft_m", "draught")])
@pytest.mark.parametrize("share, hers", [(0.979, False), (0.981, True), (1.019, True), (1.021, False)])
def test_a_manifest_is_of_this_ship_if_her_sizes_are_the_same_to_two_per_cent(key, own, share, hers):
    manifest = {"particulars": {key: share * getattr(SHIP.particulars, own)}}
    if hers:
        assert getattr(adapted(SHIP, manifest).particulars, own) == getattr(SHIP.particulars, own)
    else:
        with pytest.raises(InputError, match="another ship"):
            adapted(SHIP, manifest)


@pytest.mark.parametrize("share, sails", [(1.95, True), (2.05, False)])
def test_nobody_approaches_at_more_than_twice_the_speed_that_a_ship_was_identified_at(share, sails):
    manifest = {"particulars": {"approach_speed_m_s": share * SHIP.particulars.speed}}
    if sails:
        assert adapted(SHIP, manifest).particulars.speed == approx(share * SHIP.particulars.speed)
    else:
        with pytest.raises(InputError, match="below twice that"):
            adapted(SHIP, manifest)
