"""Forces, waves and gates by a second route: the source's words worked out in another way than the shelf does."""

import cmath
from math import cos, exp, inf, pi, radians, sin, sqrt, tanh

import numpy as np
import pytest
import torch
from fleet import ship_named
from pytest import approx
from scipy.integrate import quad
from shelf import at, made, recorded

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.wind import COEFFICIENTS, TANKER_BLOCK
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.effect.roll import RollCoupling

NONE = torch.zeros(1, 0, dtype=torch.float64)
# Blendermann 1994, Table 4, as reprinted by Fossen 2011, Table 8.3: CD_t, CD_lAF from ahead and astern, d.
BLENDERMANN = {
    "car_carrier": (0.95, 0.55, 0.60, 0.80), "cargo_loaded": (0.85, 0.65, 0.55, 0.40),
    "container_loaded": (0.90, 0.55, 0.55, 0.40), "ferry": (0.90, 0.45, 0.50, 0.80),
    "gas_carrier": (0.70, 0.60, 0.65, 0.50), "research": (0.85, 0.55, 0.65, 0.60),
    "tanker_ballast": (0.70, 0.75, 0.55, 0.40), "tanker_loaded": (0.70, 0.90, 0.55, 0.40),
}  # fmt: skip
AREAS = (330.0, 1500.0, -20.0, 222.5)
"""A_F, A_L [m^2], s_L, L_oa [m] of the bulk carrier."""
FORM = {"load": 1.3, "cx": 0.8, "cx3": 0.2, "cy3": -0.15, "cn": 1.4, "cn_shift": 0.05, "still_air": 0.6}


def blendermann(air: complex, kind: str, form: dict[str, float]) -> np.ndarray:
    """X, Y, N of air that comes out of a direction of the ship's axes: forward + 1j starboard [m/s]."""
    side, bow, stern, cross = BLENDERMANN[kind]
    frontal, lateral, centre, overall = AREAS
    angle = -cmath.phase(air)  # from port is positive
    drag = (bow if cos(angle) > 0 else stern) * frontal / lateral
    den = 1 - cross / 2 * (1 - drag / side) * sin(2 * angle) ** 2
    q = 1.225 / 2 * abs(air) ** 2 * lateral
    surge = -q * drag * (cos(angle) + form["cx3"] * cos(3 * angle)) / den
    sway = q * side * (sin(angle) + form["cy3"] * sin(3 * angle)) / den
    arm = form["cn"] * (centre - 0.18 * overall * (abs(angle) - pi / 2)) + form["cn_shift"] * overall
    return form["load"] * np.array([form["cx"] * surge, sway, sway * arm])


@pytest.mark.parametrize("kind, heading, blows_from", [
    ("car_carrier", 200.0, 320.0), ("cargo_loaded", 20.0, 160.0), ("container_loaded", 111.0, 40.0),
    ("ferry", 300.0, 170.0), ("gas_carrier", 75.0, 90.0), ("research", 5.0, 310.0), ("tanker_ballast", 260.0, 30.0),
    ("tanker_loaded", 140.0, 10.0),
])  # fmt: skip
def test_a_wind_has_blendermanns_loads_in_the_air_that_the_ship_meets(kind, heading, blows_from):
    """The air's velocity as a complex number north + 1j east, turned into the ship's axes."""
    assert COEFFICIENTS == BLENDERMANN and TANKER_BLOCK == 0.75
    turn, moving = cmath.exp(-1j * radians(heading)), 4.1 - 0.7j
    air = moving + 13.0 * cmath.exp(1j * radians(blows_from)) * turn
    expected = blendermann(air, kind, FORM) - FORM["still_air"] * blendermann(moving, kind, FORM)
    wind = made("wind_steady", "great_lakes_bulker", speed=13.0, from_deg=blows_from, **FORM, kind=kind)
    s = at("great_lakes_bulker", 4.1, -0.7, psi=radians(heading))
    # The step of CD_lAF at beam wind is smoothed: the quarters are within a thousandth.
    assert wind.force(s)[0].tolist() == approx(expected.tolist(), rel=2e-3)
    assert float(wind.heeling(s)) == approx(expected[1] * AREAS[1] / AREAS[3] / 2, rel=2e-3)


def test_near_beam_wind_the_drag_from_ahead_goes_over_into_that_from_astern():
    """A ship at rest, the cosine of the wind's angle .05: 1/(1 + 1/e) of the step is done."""
    side, bow, stern, cross = BLENDERMANN["tanker_loaded"]
    angle, share = np.arccos(0.05), 1 / (1 + exp(-1))
    drag = share * bow + (1 - share) * stern
    den = 1 - cross / 2 * (1 - drag * AREAS[0] / AREAS[1] / side) * sin(2 * angle) ** 2
    wind = made("wind_steady", "great_lakes_bulker", speed=9.0, from_deg=float(np.degrees(angle)))
    assert float(wind.force(at("great_lakes_bulker", 0.0))[0, 0]) == approx(
        -0.5 * 1.225 * 81.0 * AREAS[0] * drag * 0.05 / den
    )


def test_every_row_that_is_drawn_has_gusts_of_its_own_of_the_same_size():
    values = dict(speed=8.0, from_deg=70.0, gust_sd=2.0, gust_time_s=25.0, gust_across=0.6)
    drawn = made("wind_gusty", "mariner", **values).drawn(4000, torch.Generator().manual_seed(1))
    first, then = (drawn._speed(at("mariner", 5.0, 0.4, psi=2.0, time=time)) - 8.0 for time in (0.0, 25.0))
    assert float(first.std()) == approx(2.0, rel=0.1) and len(set(first.tolist())) > 3900
    assert float(torch.corrcoef(torch.stack([first, then]))[0, 1]) == approx(exp(-1), abs=0.06)
    alone = made("wind_steady", "mariner")
    assert alone.drawn(3, torch.Generator()) is alone


def test_gusts_across_the_wind_come_from_its_right():
    """At any time the wind is a steady one from the sum of both vectors."""
    values = dict(speed=8.0, from_deg=70.0, gust_sd=2.0, gust_time_s=25.0, gust_across=0.6)
    gusty = made("wind_gusty", "mariner", seed=5, **values)
    swings, gusts = [], []
    for time in (10.0, 111.0, 1234.5):
        s = at("mariner", 5.0, 0.4, psi=2.0, time=time)
        along, across = float(gusty._speed(s)), float(gusty._swing(s))
        true = cmath.rect(1.0, radians(70.0)) * (along + 1j * across)
        angle = float(np.degrees(cmath.phase(true))) % 360
        steady = made("wind_steady", "mariner", speed=abs(true), from_deg=angle)
        torch.testing.assert_close(gusty.force(s), steady.force(s))
        later = s.with_(time=s.time + 600.0 * 25.0)
        torch.testing.assert_close(gusty.force(later), gusty.force(s), rtol=1e-6, atol=1e-6)  # it repeats
        gusts, swings = [*gusts, (along - 8.0) / 2.0], [*swings, across / 1.2]
    assert max(map(abs, (*gusts, *swings))) < 4.0 and len({round(abs(g), 6) for g in (*gusts, *swings)}) == 6


def test_gusts_and_swings_are_two_independent_markov_processes_of_unit_size():
    gusty = made("wind_gusty", "mariner", seed=1)
    step = 0.02  # of a correlation time, over 600 of them
    for series in (gusty.gusts.numpy(), gusty.swings.numpy()):
        assert len(series) == 30_001
        assert series.std() == approx(1.0, abs=0.08) and abs(series.mean()) < 0.15  # sd .041 and .058
        for lag in (1, 25, 50, 100):
            found = np.mean(series[lag:] * series[:-lag]) / np.mean(series**2)
            assert found == approx(exp(-step * lag), abs=0.002 if lag == 1 else 0.1)
    assert abs(np.corrcoef(gusty.gusts, gusty.swings)[0, 1]) < 0.15


PERIOD, HEIGHT = 9.0, 3.0


def sea(blows_from: float, components: int = 3):
    return made("first_order_waves", "mariner", Hs=HEIGHT, period_s=PERIOD, from_deg=blows_from, seed=2,
                components=components)  # fmt: skip


def test_the_waves_of_a_sea_have_equal_shares_of_bretschneiders_energy():
    """``S = 5/16 Hs^2 wp^4/w^5 exp(-5/4 (wp/w)^4)``: half of its share lies to either side of a component."""
    ratios, m0 = sea(0.0, 5).ratios.tolist(), HEIGHT**2 / 16

    def spectrum(w: float) -> float:
        return 5 / 16 * HEIGHT**2 * w**-5 * exp(-1.25 * w**-4)

    shares = [quad(spectrum, 0.2, ratio)[0] / m0 for ratio in ratios]
    assert shares == approx([0.1, 0.3, 0.5, 0.7, 0.9], abs=1e-6)
    phases = sea(0.0, 40).phases.numpy()
    assert 0 <= phases.min() < 0.5 and 5.8 < phases.max() < 2 * pi


def moved(effect, x: float, y: float, psi: float, time: float) -> np.ndarray:
    """Surge, sway, yaw: mean of the water's displacement over the length, and the line through it, by sums."""
    length, toward = 152.4, cmath.exp(1j * (radians(float(effect.value("from_deg"))) + pi))
    stations = np.linspace(-length / 2, length / 2, 4001)
    places = x + 1j * y + stations * cmath.exp(1j * psi)
    total = np.zeros(3)
    for ratio, phase in zip(effect.ratios.tolist(), effect.phases.tolist(), strict=True):
        omega, amplitude = 2 * pi / PERIOD * ratio, HEIGHT / 4 * sqrt(2 / len(effect.phases))
        along = (places * toward.conjugate()).real
        water = amplitude * np.sin(omega * time - omega**2 / 9.81 * along + phase) * toward * cmath.exp(-1j * psi)
        slope = 12 / length**3 * np.trapezoid(stations * water.imag, stations)  # of the line by least squares
        total += [np.trapezoid(water.real, stations) / length, np.trapezoid(water.imag, stations) / length, slope]
    return total


@pytest.mark.parametrize("blows_from, psi", [(35.0, 0.4), (130.0, 2.2), (250.0, 3.9), (91.0, 0.0)])
def test_a_ship_in_waves_goes_along_with_the_mean_of_the_water_over_her_length(blows_from, psi):
    effect, u, v, h = sea(blows_from), 6.0, -0.8, 1e-3

    def place(t: float) -> tuple[float, float, float, float]:
        return 40.0 + t * (u * cos(psi) - v * sin(psi)), -25.0 + t * (u * sin(psi) + v * cos(psi)), psi, 11.0 + t

    x, y, _, time = place(0.0)
    s = at("mariner", u, v, x=x, y=y, psi=psi, time=time)
    true = recorded(s)
    added = {k: float(c - true[k]) for k, c in effect.record(true, s).items()}
    surge, sway, yaw = moved(effect, x, y, psi, time)
    rates = (moved(effect, *place(h)) - moved(effect, *place(-h))) / (2 * h)
    assert added["psi"] == approx(yaw, rel=1e-4, abs=1e-9)
    assert complex(added["x"], added["y"]) == approx((surge + 1j * sway) * cmath.exp(1j * psi), rel=1e-4)
    assert (added["r"], added["u_log"]) == approx((rates[2], rates[0]), rel=1e-3, abs=1e-6)
    assert complex(added["vn"], added["ve"]) == approx((rates[0] + 1j * rates[1]) * cmath.exp(1j * psi), rel=1e-3)


@pytest.mark.parametrize("side, along", [("starboard", 25.0), ("port", 205.0), ("port", 310.0)])
def test_a_bank_draws_by_the_distance_of_the_ship_from_its_line(side, along):
    """The foot of the perpendicular on the line, which lies distance_m beside the origin."""
    p, right = ship_named("great_lakes_bulker").particulars, 1j if side == "starboard" else -1j
    ahead = cmath.exp(1j * radians(along))
    line, place = 180.0 * ahead * right, complex(300.0, -70.0)
    distance = ((line - place) * (ahead * right).conjugate()).real
    bank = made("bank", "great_lakes_bulker", side=side, strength=1.7, distance_m=180.0, along_deg=along, cn=0.7)
    force = bank.force(at("great_lakes_bulker", 4.2, 0.3, x=300.0, y=-70.0))[0].tolist()
    pull = 0.1 * 1.7 * p.rho * 4.2**2 * p.beam * p.draught * p.beam / 2 / distance * (1 if side == "starboard" else -1)
    assert force == approx([0.0, pull, -0.7 * 0.5 * p.length * pull])


def test_a_ship_is_never_nearer_to_a_bank_than_half_her_beam():
    p = ship_named("mariner").particulars
    limit = 0.1 * p.rho * 36.0 * p.beam * p.draught
    bank = made("bank", "mariner", distance_m=20.0, along_deg=0.0)
    beyond, touching = (float(bank.force(at("mariner", 6.0, y=y))[0, 1]) for y in (300.0, 20.0 - p.beam / 2))
    assert beyond == approx(limit)
    # Where she would touch the distance is rounded up by 2 ln 2 m.
    assert touching == approx(limit * p.beam / 2 / (p.beam / 2 + 2 * np.log(2)))


TIMES = dict(start_s=100.0, end_s=160.0, start_2_s=230.0, end_2_s=260.0, start_3_s=300.0, end_3_s=inf, ramp_s=12.0)


def over(times: torch.Tensor) -> Situation:
    """A ship at rest at many times."""
    zero, three = torch.zeros_like(times), times.new_zeros(len(times), 3)
    return Situation(three, three, zero, zero, zero, zero, zero + 1, times)


def risen(time: float, start: float, ramp: float) -> float:
    """Mean over the ramp of a logistic step whose slope is one over the 2 s of rounding."""
    return quad(lambda t: 1 / (1 + exp(-4 / 2.0 * (time - start - t))), -ramp / 2, ramp / 2)[0] / ramp


@pytest.mark.parametrize(
    "time", [90.0, 94.5, 97.0, 104.0, 130.0, 163.0, 200.0, 231.0, 245.0, 263.0, 280.0, 302.0, 900.0]
)
def test_an_event_builds_up_as_the_mean_of_a_rounded_step_over_its_ramp(time):
    tug = made("tow", "mariner", force_kN=70.0, angle_deg=200.0, lever_m=-30.0, **TIMES)
    share = sum(risen(time, start, 12.0) for start in (100.0, 230.0, 300.0))
    share -= sum(risen(time, end, 12.0) for end in (160.0, 260.0))
    force = tug.force(at("mariner", 5.0, psi=0.3, time=time))[0].tolist()
    sway = 70e3 * share * sin(radians(200.0))
    assert force == approx([70e3 * share * cos(radians(200.0)), sway, -30.0 * sway], abs=1e-3)


def test_the_impulse_of_an_event_is_its_force_times_its_length_whatever_the_ramp():
    s = over(torch.arange(0.0, 600.0, 0.05, dtype=torch.float64))
    for ramp in (1.0, 9.0, 40.0):
        force = made("side_force", "mariner", force_kN=3.0, lever_m=7.0, start_s=200.0, end_s=310.0, ramp_s=ramp)
        impulse = force.force(s).sum(0) * 0.05
        assert impulse.tolist() == approx([0.0, 3e3 * 110.0, 7.0 * 3e3 * 110.0], rel=1e-6)
    assert (RAMP.null, RAMP.low) == (1.0, 1.0), "the least ramp is a step"


def test_an_interval_that_ends_before_it_starts_is_none():
    s = over(torch.arange(0.0, 400.0, 1.0, dtype=torch.float64))
    force = made("bow_thruster", "mariner", force_kN=9.0, start_s=200.0, end_s=150.0).force(s)
    assert float(force.abs().max()) == 0.0


def test_ice_fades_where_the_ship_hardly_moves():
    ice = made("ice_resistance", "mariner", force_kN=80.0)
    assert [float(ice.force(at("mariner", u))[0, 0]) for u in (0.1, -0.05)] == approx([
        -80e3 * tanh(1),
        80e3 * tanh(0.5),
    ])


@pytest.mark.parametrize("delta_deg, v, r", [(33.0, -0.9, 0.011), (-24.0, 0.5, -0.006), (18.0, 0.2, 0.003)])
def test_a_stalled_rudder_lacks_the_stated_share_at_its_angle_of_attack(delta_deg, v, r):
    ship, u, gamma = ship_named("mariner"), 6.3, 0.55
    s = at(ship, u, v, r, delta=radians(delta_deg))
    inflow = np.degrees(np.arctan((v - 152.4 / 2 * r) / u))
    lost = 0.35 / (1 + exp(-(abs(delta_deg + gamma * inflow) - 22.0) / 2.0))
    rudder = (s.nudot - ship.acceleration(s.nu, 0 * s.delta))[0].tolist()
    stall = made("rudder_stall", ship, angle_deg=22.0, loss=0.35, straightening=gamma)
    assert stall.acceleration(s, NONE)[0].tolist() == approx([0.0, -lost * rudder[1], -lost * rudder[2]])


@pytest.mark.parametrize("u, n", [(5.1, 1.25), (8.0, 0.6)])
def test_the_race_has_the_speed_that_momentum_theory_gives_it(u, n):
    """``V_inf^2 = V_A^2 + T / (rho A / 2)``: T = R/.8, V_A = .7 u, a propeller of .7 T."""
    ship = ship_named("great_lakes_bulker")
    p = ship.particulars
    disc = pi * (0.35 * p.draught) ** 2

    def square(speed: float, thrust: float) -> float:
        return (0.7 * speed) ** 2 + thrust / 0.8 / (0.5 * p.rho * disc)

    now = square(u, p.resistance * n * (2 * n - u / p.speed))
    s = at(ship, u, 0.3, delta=0.2, shaft=n)
    rudder = (s.nudot - ship.acceleration(s.nu, 0 * s.delta))[0]
    # The ship's own thrust at another shaft speed moves it ahead alone.
    found = made("slipstream", ship, share=0.8).acceleration(s, NONE)[0, 1:]
    expected = 0.8 * (now / square(p.speed, p.resistance) - 1) * rudder[1:]
    torch.testing.assert_close(found, expected)


def test_roll_has_the_equation_of_the_docstring_with_its_factors():
    """``phi'' + 2 (d zeta)(w0/p) phi' + (w0/p)^2 (phi - phi_s) = 0`` on the bulk carrier, written out."""
    roll = RollCoupling(ship_named("great_lakes_bulker"), N_phi=0.01, period=1.3, damping=2.2)
    s = at("great_lakes_bulker", 4.0, -0.5, 0.012).with_(nudot=torch.tensor([[0.01, -0.03, 1e-4]], dtype=torch.float64))
    omega, steady = 2 * pi / (11.2 * 1.3), -(7.6 - 8.1 / 2) * (4.0 * 0.012 - 0.03) / (9.81 * 2.5)
    expected = omega**2 * (steady - 0.05) - 2 * 0.08 * 2.2 * omega * 0.007
    rates = roll.memory_rate(s, torch.tensor([[0.05, 0.007]], dtype=torch.float64))[0].tolist()
    assert rates == approx([0.007, expected])


def test_the_equator_runs_with_the_speed_of_a_sidereal_day():
    gyro = made("gyro_speed_error", "mariner", factor=1.0)
    s = at("mariner", 6.0, 0.5, psi=0.7)
    error = float(gyro.record(recorded(s), s)["psi"] - s.psi)
    assert error == approx((6.0 * cos(0.7) - 0.5 * sin(0.7)) / (2 * pi * 6_378_137 / 86_164.1), rel=1e-4)


def test_a_situation_at_rest_has_no_force_of_the_ships_own_motion():
    """Bank, fouling and wind go with a square of a speed; none is left without it."""
    still = over(torch.zeros(1, dtype=torch.float64))
    for name, values in (("bank", {}), ("hull_fouling", {}), ("wind_steady", {"speed": 0.0})):
        assert float(made(name, "mariner", **values).force(still).abs().max()) < 1e-6
