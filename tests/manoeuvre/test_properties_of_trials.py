"""Whatever settings a trial and an effect have: they are refused in one line, or the ship sails and stays finite."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from hypothesis import given
from hypothesis import strategies as st

from manoeuvre_nn.commands.config import named_manoeuvres
from manoeuvre_nn.commands.groups import option, options
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker

SHIP = great_lakes_bulker()
TRIALS = {
    "zigzag": ("rudder_deg", "heading_deg", "first", "executes"), "turning_circle": ("rudder_deg", "side", "duration"),
    "random": ("rudder_deg", "shortest_period", "seed"), "spiral": ("rudder_deg", "step_deg", "hold", "first"),
    "pull_out": ("rudder_deg", "side", "turn_deg", "coast"), "straight": ("duration", "name"),
}  # fmt: skip
values = st.one_of(
    st.floats(0.5, 60.0), st.integers(1, 40), st.sampled_from(["starboard", "port"]), st.none(),
    st.sampled_from([-1, 0, True, "", "x", "../up", [], {}, [1.0], float("nan"), float("inf"), 1e300, 10**30, 1e-300]),
)  # fmt: skip
EFFECTS = [name for name in options("effect") if name not in {"formula", "remainder", "roll_coupling"}]


@given(st.data())
def test_a_trial_is_refused_in_one_line_or_sailed(data):
    kind = data.draw(st.sampled_from(sorted(TRIALS)))
    changed = data.draw(st.dictionaries(st.sampled_from(TRIALS[kind]), values, min_size=1, max_size=2))
    try:
        with unchecked():  # a whole number is a number, too
            (trial,) = named_manoeuvres([{kind: changed}], None)
        trial.check(SHIP.particulars)
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 500
        return
    assert trial.duration is None or 0 < trial.duration <= 1e6
    with unchecked():
        lasts = min(trial.duration_for(SHIP.particulars), 60.0)
        if lasts < 5.0:
            return
        (run,) = roll_out(CalmWater(SHIP), [replace(trial, duration=lasts)], step=2.0, interval=2.0)
    assert all(np.isfinite(run[k]).all() for k in ("u", "v", "r", "x", "y", "psi", "delta"))
    limit = changed.get("rudder_deg", 35.0)
    assert np.abs(run["delta"]).max() <= np.radians(limit) + 1e-9


@given(st.data())
def test_an_effect_has_the_value_that_is_said_or_is_refused_in_one_line(data):
    name = data.draw(st.sampled_from(EFFECTS))
    usual = option("effect", name)
    declared = build(usual, "effect", ship=SHIP).declared
    p = data.draw(st.sampled_from(declared))
    low, high = max(p.low, -1e4), min(p.high, 1e4)
    value = data.draw(st.one_of(st.floats(low, high), values))
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and (p.low <= value <= p.high or (p.per_run and value == float("inf"))):
        with unchecked():
            made = build({**usual, p.name: value}, "effect", ship=SHIP)
        assert float(made.value(p.name)) == pytest.approx(value)
    else:
        with unchecked(), pytest.raises(InputError) as refusal:
            build({**usual, p.name: value}, "effect", ship=SHIP)
        assert "\n" not in str(refusal.value) and p.name in str(refusal.value)
