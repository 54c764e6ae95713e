"""How strong an effect is called, when a ship leaves her range, and the sizes that can be drawn."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from pytest import approx

from studies.concealed_trial import strength
from studies.concealed_trial.drawing import CasePlan, _drawn
from studies.concealed_trial.effects import KINDS, UNMODELLED, kind_of
from studies.concealed_trial.helm import Run
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.strength import DRIFT, SIGMAS, WARMUP, deviation, draw_effect, in_range, strength_of
from studies.concealed_trial.truth import ConcealedEffect

SHIPS = trial_ships()


def test_a_currents_strength_is_the_drift_of_the_calm_water_track_over_the_length():
    """Both tracks part by V t from the warm-up at 40 s on, whatever the ship does."""
    ship = SHIPS["great_lakes_bulker"]
    runs = [Run("a", "fit", "zz10", "port", 30.0, 100), Run("b", "fit", "tc20", "starboard", 200.0, 70)]
    found = deviation(ship, ConcealedEffect("current", {"speed": 0.8, "toward_deg": 77.0}), runs)
    squares = [np.mean((0.8 * np.arange(duration - 40 + 1)) ** 2) for duration in (100, 70)]
    assert found == approx(sqrt(np.mean(squares)) / 217.627, rel=1e-6) and WARMUP == 40


@pytest.mark.parametrize("at_end", [True, False])
def test_a_ship_leaves_her_range_beyond_the_stated_speeds_drift_and_rate(at_end):
    ship = SHIPS["mariner"]
    runs = [Run("a", "fit", "zz10", "port", 0.0, 5)]

    def stays(u=0.9, v=0.0, r=0.0, second=5 if at_end else 2):
        states = np.zeros((9, 9, 1))
        states[:, 3] = ship.speed
        states[second, 3:6, 0] = [u * ship.speed, v * u * ship.speed, r * ship.speed / ship.length]
        return in_range(ship, states, runs)

    assert stays(0.21) and stays(1.69) and stays(v=0.79) and stays(v=-0.79) and stays(r=1.99) and stays(r=-1.99)
    assert not any([stays(0.19), stays(1.71), stays(v=0.81), stays(v=-0.81), stays(r=2.01), stays(r=-2.01)])
    assert not stays(np.nan) and stays(0.0, second=6), "what is past the end of a run does not count"


def test_strengths_are_the_ranges_of_the_page_and_meet_at_their_geometric_means():
    assert DRIFT == {"weak": (0.15, 0.5), "moderate": (0.6, 1.1), "strong": (1.4, 2.5), "extreme": (3.0, 8.0)}
    assert SIGMAS == {"weak": (3.0, 5.0), "moderate": (8.0, 15.0), "strong": (20.0, 40.0), "extreme": (60.0, 300.0)}
    for edges, sensor in (((0.3**0.5, 1.54**0.5, 7.5**0.5), False), ((40**0.5, 300**0.5, 2400**0.5), True)):
        names = [strength_of(e * side, sensor) for e in edges for side in (0.999, 1.001)]
        assert names == ["weak", "moderate", "moderate", "strong", "strong", "extreme"]


# Largest sizes that are possible at sea, by the page and effects.py: backlash 20 deg, delay 30 s, current 4 m/s, wind
# 40 m/s, h/T 1.2 (zeta 5), a compass 30 deg, a log 60 %, an antenna 170 m from midship, half of a ship's displacement.
BOUNDS = {
    "wind_steady": (2, 40), "wind_gusty": (2, 40), "wind_onset": (2, 40), "wave_drift": (0.7, 14),
    "current": (0.02, 4), "shallow_water": (0.05, 5), "rudder_offset": (0.05, 10), "rudder_backlash": (0.3, 20),
    "rudder_slow": (0.05, 20), "rudder_delay": (0.2, 30), "rudder_area_loss": (0.01, 0.8),
    "propeller_side_force": (1e-4, 0.03), "propeller_pitch_error": (0.01, 0.6), "power_limit": (0.03, 1),
    "hull_fouling": (0.01, 2), "ice_resistance": (0.01, 1), "displacement_change": (0.01, 0.45),
    "trim_change": (0.05, 5), "roll_coupling": (5e-4, 0.3), "side_force": (5e-4, 0.1), "bow_thruster": (2e-4, 0.06),
    "heading_bias": (0.2, 30), "rate_bias": (0.03, 3), "log_scale": (0.01, 0.6), "gps_lever_arm": (1.5, 170),
    "cubic_by_heading": (0.003, 3), "lopsided_turn": (2e-4, 0.15), "beat": (2e-4, 0.1), "turn_drag": (5e-4, 0.3),
    "by_speed": (0.001, 0.3), "striped_water": (2e-4, 0.15), "damped_drift": (0.002, 1.5), "sway_beat": (2e-4, 0.3),
    "late_turn": (2e-4, 0.1), "growing_push": (2e-4, 0.1), "growing_drag": (2e-4, 0.1), "random_push": (5e-4, 0.3),
    "random_moment": (2e-4, 0.1), "rudder_hole": (0.05, 0.9), "weak_to_port": (0.02, 0.6),
    "compass_two_beats": (0.3, 25), "log_by_heading": (0.02, 0.6), "position_runs_away": (5e-6, 3e-3),
    "rate_scale": (0.05, 0.9),
}  # fmt: skip
EXTRAS = {
    "gustiness": (0.12, 0.22), "lever": (-0.25, 0.25), "angle": (0.0, 360.0), "sign": (-1.0, 1.0),
    "stripes_deg": (0.0, 180.0), "spacing": (4.0, 9.0), "lag_s": (20.0, 120.0), "tau_s": (10.0, 120.0),
    "chance": (0.0, 9999.0), "beat": (25.0, 90.0), "sway_beat": (50.0, 240.0),
}  # fmt: skip


def test_the_catalogue_draws_within_what_is_possible_at_sea():
    found = {k.detail or k.name: (k.low, k.high) for k in (*KINDS, *UNMODELLED)}
    assert found == BOUNDS
    for kind in (*KINDS, *UNMODELLED):
        assert kind_of(kind.name, kind.detail) is kind
        for name, span in kind.extras.items():
            assert span == EXTRAS[kind.detail if name == "period_s" else name], (kind, name)


SIZED = {
    "shallow_water": (2.0, {}, {"depth_m": 8.138 * 1.5}), "rudder_slow": (1.5, {}, {"rate_deg_s": 1.0}),
    "displacement_change": (0.2, {"sign": -1.0}, {"factor": 0.8}), "log_scale": (0.1, {"sign": 1.0}, {"factor": 1.1}),
    "wind_gusty": (10.0, {"angle": 33.0, "gustiness": 0.2}, {"speed": 10.0, "from_deg": 33.0, "gust_sd": 2.0}),
    "side_force": (0.01, {"sign": -1.0, "lever": 0.2},
                   {"force_kN": -0.01 * 0.5 * 1.025 * 152.4 * 8.138 * 7.614**2, "lever_m": 30.48}),
    "ice_resistance": (0.3, {}, {"force_kN": 105.03}), "rudder_offset": (2.0, {"sign": -1.0}, {"offset_deg": -2.0}),
    "gps_lever_arm": (60.0, {"angle": 10.0}, {"dx_m": 60 * cos(radians(10)), "dy_m": 60 * sin(radians(10))}),
    "wave_drift": (3.0, {"angle": 12.0}, {"Hs": 3.0, "from_deg": 12.0}),
    "current": (0.7, {"angle": 12.0}, {"speed": 0.7, "toward_deg": 12.0}),
}  # fmt: skip


@pytest.mark.parametrize("name", SIZED)
def test_one_number_sets_the_size_of_an_effect(name):
    size, extras, parameters = SIZED[name]
    assert kind_of(name).make(SHIPS["mariner"], size, extras) == approx(parameters)


def test_an_antenna_stays_on_board_and_stripes_are_counted_in_lengths():
    long = kind_of("gps_lever_arm").make(SHIPS["mariner"], 170.0, {"angle": 130.0})
    assert long == approx({"dx_m": -152.4 / 2, "dy_m": 21.763 / 2})
    striped = kind_of("unknown", "striped_water").make(SHIPS["mariner"], 0.1, {"stripes_deg": 20.0, "spacing": 5.0})
    assert striped == approx({"a": 0.1, "stripes_deg": 20.0, "spacing_m": 762.0})
    signed = kind_of("unknown", "late_turn").make(SHIPS["mariner"], 0.1, {"sign": -1.0, "lag_s": 50.0})
    assert signed == {"a": -0.1, "lag_s": 50.0}
    beats = kind_of("unknown", "compass_two_beats").make(SHIPS["mariner"], 2.0, {"angle": 44.0})
    assert beats == {"a": 2.0, "direction_deg": 44.0}


@pytest.mark.parametrize("share", [1.0, 0.49])
def test_a_size_is_sought_that_drifts_by_a_share_of_what_its_strength_wants(monkeypatch, share):
    """Of a drift that grows as the size; within a tenth of what is wanted."""
    monkeypatch.setattr(strength, "deviation", lambda ship, effect, runs: 0.4 * effect.parameters["speed"])
    rng = np.random.default_rng(3)
    measures = [draw_effect(rng, SHIPS["mariner"], kind_of("current"), "moderate", (), share)[1] for _ in range(60)]
    assert min(measures) >= share * 0.6 / 1.11 and max(measures) <= share * 1.1 * 1.11
    assert np.mean(measures) == approx(share * 0.85, rel=0.1)


def test_each_further_attempt_wants_seven_tenths_of_the_size():
    """Where a ship is thrown out of her range: .343 of 8 to 15 standard deviations at the fourth."""
    plan = CasePlan("mariner", (kind_of("heading_bias"),), ("moderate",))
    measures = [_drawn(5, index, 3, plan, 1.0).measures[0] for index in range(60)]
    assert 0.343 * 8 <= min(measures) < 0.343 * 8.7 and 0.343 * 14.3 < max(measures) <= 0.343 * 15
