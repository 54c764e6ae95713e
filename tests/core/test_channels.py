"""Channels are declared once, and a recording says in a line what it is."""

import numpy as np

from manoeuvre_nn.core.channels import CHANNELS, DECLARED, MEASURED, MOTION, PERIODIC, UNITS
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.read.quantity import QUANTITY, units_of


def test_every_channel_is_declared_once_with_a_unit_that_files_may_have_too():
    assert len(CHANNELS) == len(DECLARED)
    assert {*MEASURED, *MOTION} <= set(CHANNELS) and set(QUANTITY) == set(CHANNELS) - {"t"}
    assert all(units_of(c.name)[c.unit] == 1.0 for c in DECLARED if c.name != "t")
    assert UNITS["psi_sd"] == "rad" and set(PERIODIC) >= {"psi", "cog", "wind_from"}


def test_a_recording_prints_in_one_line():
    time = np.arange(0.0, 50.0, 0.5)
    said = repr(Recording("zz20", time, {"psi": 0 * time, "n": 0 * time}, status="left the range"))
    assert said == ("<Recording zz20: 100 samples over 49.5 s, step 0.5 s; psi [rad], n [1/s], left the range>")


def test_the_step_is_the_usual_one_and_exact_where_samples_are_even():
    even = Recording("a", 0.3 * np.arange(1000), {})
    assert even.step == 0.3
    gap = np.delete(np.arange(0.0, 20.0), [1, 2])
    assert Recording("a", gap, {}).step == 1.0
