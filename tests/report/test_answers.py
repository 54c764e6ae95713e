"""The answer in the form of the concealed cases: signs, places, digits, and what is left out."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from diagnosed import calm, cause, unknown, windy

from manoeuvre_nn.diagnosis.answers import answer, write_answer
from manoeuvre_nn.diagnosis.result import Nature, Value

BEATS = Nature(
    "periodic", ("N", "sensor:y"), Value("amplitude", 12.345678, 1.0, "MN m"), (Value("period", 50.0, 0.4, "s"),), 21.5
)


def told(name: str = "current", probability: float = 0.9, *values: Value, **other) -> dict:
    """What the answer says of one cause."""
    (effect,) = answer(replace(windy(), causes=[cause(name, name, probability, 1.0, *values, **other)]))["effects"]
    return effect


def test_a_rudder_offset_is_positive_to_port_there_and_its_interval_too():
    offset = Value("offset_deg", 1.0, 0.1, "deg", low=-2.0, high=1.1)
    effect = told("rudder_offset", 0.9, offset, Value("other_deg", 1.0, 0.1, "deg"))
    assert effect["parameters"] == {"offset_deg": [-1.0, 0.1, "deg"], "other_deg": [1.0, 0.1, "deg"]}
    assert effect["intervals_95"] == {"offset_deg": [-1.1, -0.804], "other_deg": [0.804, 1.196]}


def test_sensors_are_told_by_their_columns_and_equations_as_they_are():
    channels = ("X", "actuator:rudder", "sensor:x", "sensor:y", "sensor:vn", "sensor:ve", "sensor:psi")
    places = ["X", "actuator:rudder", "sensor:x_north", "sensor:y_east", "sensor:u", "sensor:v", "sensor:psi"]
    assert told(equations=channels)["equation"] == places


@pytest.mark.parametrize("probability, said", [(1.06e-4, 1e-4), (1e-4, 1e-4), (9.9e-5, None), (0.123456, 0.1235)])
def test_probabilities_of_a_ten_thousandth_and_more_are_told_to_four_places(probability, said):
    effects = answer(replace(windy(), causes=[cause("current", "", probability)]))["effects"]
    assert [e["probability"] for e in effects] == ([] if said is None else [said])


def test_times_are_told_to_a_tenth_of_a_second_and_what_always_acts_by_a_word():
    acting = {"r01": [(60.04, 400.06)], "r03": []}
    assert told(intervals=acting)["intervals"] == {"r01": [[60.0, 400.1]], "r03": []}
    assert told()["intervals"] == "all"


def test_values_have_five_digits_and_what_is_not_known_is_null():
    effect = told("current", 0.9, Value("speed", 1.2345678, np.nan, "m/s"), Value("b", np.inf, 1.0, "", campaign="May"))
    assert effect["parameters"] == {"speed": [1.2346, None, "m/s"], "b (May)": [None, 1.0, ""]}
    assert effect["intervals_95"]["speed"] is None


@pytest.mark.parametrize("refuted, predictable", [(False, True), (True, True), (False, False)])
def test_the_nature_of_something_unknown_is_told_with_what_can_be_foreseen(refuted, predictable):
    nature = replace(BEATS, refuted=refuted, predictable=predictable)
    assert told(nature=nature)["nature"] == {
        "kind": "periodic",
        "equation": ["N", "sensor:y_east"],
        "size": {"name": "amplitude", "value": [12.346, 1.0, "MN m"]},
        "scales": {"period": [50.0, 0.4, "s"]},
        "log_evidence": 21.5,
        "predictable": predictable and not refuted,
        "frame": None,
        "parity": None,
        "share_in_hard_helm": None,
    }
    shape = told(nature=replace(BEATS, frame="earth", parity="odd", regime=0.25))["nature"]
    assert (shape["frame"], shape["parity"], shape["share_in_hard_helm"]) == ("earth", "odd", 0.25)
    assert "nature" not in told()


def test_the_model_is_what_was_named_or_something_unknown_or_nothing():
    nameless = replace(unknown(), model=[])
    assert [answer(d)["model"] for d in (windy(), nameless, calm())] == [
        ["wind_steady", "rudder_offset"], ["unknown"], []
    ]  # fmt: skip


def test_headings_of_predictions_begin_a_turn_at_north_with_their_bands(tmp_path):
    d = windy()
    first = d.proofs[0]
    banded = first.after.assign(psi_low=first.after["psi"] - 1.0, psi_high=first.after["psi"] + 1.0)
    d = replace(d, proofs=[replace(first, after=banded)])
    write_answer(d, tmp_path)
    plain, bands = (pd.read_csv(tmp_path / "predictions" / when / "r02.csv") for when in ("before", "after"))
    assert banded["psi"].max() > 360 and list(plain) == list(first.before)
    np.testing.assert_allclose(plain["psi"], first.before["psi"] % 360, atol=1e-5)
    np.testing.assert_allclose(bands["psi"], banded["psi"] % 360, atol=1e-5)
    np.testing.assert_allclose(bands["psi"] - bands["psi_low"], 1.0, atol=2e-5)
    np.testing.assert_allclose(bands["psi_high"] - bands["psi"], 1.0, atol=2e-5)
    np.testing.assert_allclose(bands["x"], banded["x"], atol=1e-5)
    assert json.loads((tmp_path / "answer.json").read_text()) == json.loads(json.dumps(answer(d)))
