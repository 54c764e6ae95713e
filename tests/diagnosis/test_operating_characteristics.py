"""False alarms, power and every decision over a stored set of generated cases: see :mod:`weighed_cases`."""

import json
from collections import Counter

import numpy as np
import pytest
from weighed_cases import GROUPS, STORED, decision_of, told

from manoeuvre_nn.diagnosis import decision, search

pytestmark = pytest.mark.usefixtures("unchecked_types")
CASES = json.loads(STORED.read_text())
PLATEAU = {"MIN_CALM", "MIN_GAIN_OF_SECOND", "MAX_PROCESS_OF_FITTED_MODEL"}
"""Thresholds a tenth beside which no case of the set lies: what is decided does not hang on their last digit. Cases at
either side are made up in ``test_thresholds``."""


def of(kind: str) -> list[dict]:
    return [case for case in CASES if case["kind"] == kind]


def test_every_case_is_decided_as_it_was():
    assert [told(decision_of(case)) for case in CASES] == [case["decided"] for case in CASES]


def test_nothing_is_found_where_nothing_acts_and_what_acts_is_found_where_it_is_strong():
    assert Counter(case["kind"] for case in CASES) == GROUPS
    for case in of("clean"):
        d = case["decided"]
        assert not d["named"] and not d["strange"] and not d["claims"] and d["none"] >= 0.6
    for case in [*of("strong"), *of("pair")]:
        d = case["decided"]
        assert d["named"] and set(d["best"].split(" + ")) == set(case["acts"]) and d["claims"][0] == d["best"]
        assert all(d["likely"][name] > 0.95 for name in case["acts"]) and d["none"] < 0.01
    for case in of("unknown"):
        assert case["decided"]["strange"] and case["decided"]["unknown"] > 0.5 and case["decided"]["none"] <= 0.4


def test_weak_effects_are_named_in_most_cases_and_a_wrong_name_leaves_the_right_one_open():
    seen = [case for case in of("weak") if case["decided"]["named"]]
    assert len(seen) == 11 and len(of("weak")) == 12
    wrong = [case for case in seen if case["decided"]["best"] != case["acts"][0]]
    assert [case["acts"][0] for case in wrong] == ["log_scale"], "beside a current along the track"
    (likely,) = (case["decided"]["likely"] for case in wrong)
    assert likely["current"] < 0.75 and likely["log_scale"] > 0.25


@pytest.mark.parametrize("change", [0.9, 1.1])
@pytest.mark.parametrize(
    "name",
    ["PRIOR_NONE", "PRIOR_UNKNOWN", "PRIOR_OF_SIZE", "MIN_GAIN_OF_UNKNOWN", *sorted(PLATEAU)],
)
def test_a_threshold_moved_by_a_tenth_is_seen_or_the_set_does_not_hang_on_it(monkeypatch, name, change):
    for module in (decision, search):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, (change * np.array(getattr(module, name))).tolist())
    changed = [c for c in CASES if told(decision_of(c)) != c["decided"]]
    assert bool(changed) is (name not in PLATEAU)
