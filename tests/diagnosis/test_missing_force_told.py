from dataclasses import replace

import numpy as np

from manoeuvre_nn.core.units import three_digits
from manoeuvre_nn.diagnosis.locate import when_missing
from manoeuvre_nn.diagnosis.result import Cause, Residual, Value
from manoeuvre_nn.diagnosis.words import summary_sentence

NOTHING = np.zeros((101, 3))
RUN = Residual("r01", np.arange(101.0), NOTHING, NOTHING, NOTHING, [])


def test_windows_that_touch_are_told_as_one_and_end_with_the_run():
    first = replace(RUN, windows=[(30.0, 40.0), (0.0, 20.0), (20.0, 25.0), (38.0, 50.0)])
    second = replace(RUN, run="r02", windows=[(95.0, 1e9)])
    said = "It was located in 25% of the time: r01 0 to 25 s, r01 30 to 50 s, r02 95 to 100 s."
    assert when_missing([first, second]) == said


def test_large_forces_are_no_powers_of_ten():
    assert [three_digits(v) for v in (4741.0, -50.26, 0.01234, 0.0)] == ["4740", "-50.3", "0.0123", "0"]


def test_values_are_told_campaign_by_campaign():
    speeds = [Value("speed", v, 0.4, "m/s", day) for day, v in (("friday", 12.0), ("monday", 0.06))]
    directions = [Value("from_deg", v, 2.0, "deg", day) for day, v in (("friday", 359.0), ("monday", 20.0))]
    wind = Cause("wind_steady", "a steady wind", 0.99, 50.0, ("X",), (*speeds, *directions), None, "", "")
    said = summary_sentence([wind], ["wind_steady"], [], True)
    days = "friday: speed 12 m/s, from 359 deg; monday: speed 0.06 m/s, from 20 deg"
    assert said == f"The recordings show a steady wind ({days})."
