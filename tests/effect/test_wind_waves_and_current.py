from math import cos, pi, radians, sin

import pytest
import torch
from fleet import ship_named
from shelf import DEEP, at, made, recorded, situation

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.wind import COEFFICIENTS
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind

AIR = 1.225


def state_of(s: Situation) -> torch.Tensor:
    return torch.cat([s.nu, torch.stack([s.x, s.y, s.psi], dim=-1)], dim=-1)


@pytest.mark.parametrize("ship", DEEP)
def test_a_current_shifts_the_track_and_nothing_else(ship):
    s, calm = situation(ship), CalmWater(ship_named(ship))
    moving = Vessel(calm, [made("current", ship, speed=0.8, toward_deg=120.0)]).model
    change = moving(state_of(s), Inputs(s.delta, time=s.time)) - calm(state_of(s), Inputs(s.delta))
    expected = torch.zeros(4, 6, dtype=torch.float64)
    expected[:, 3], expected[:, 4] = 0.8 * cos(radians(120)), 0.8 * sin(radians(120))
    torch.testing.assert_close(change, expected, rtol=0.0, atol=1e-12)


def test_a_tide_changes_the_current_evenly():
    effect = made("tidal_current", "mariner", speed=0.5, toward_deg=0.0, change=-0.6)
    north = [float(effect.stream(at("mariner", 5.0, time=t))[0, 0]) for t in (0.0, 1800.0, 3600.0)]
    assert north == pytest.approx([0.5, 0.2, -0.1])


# CD_t, CD_lAF from ahead and astern of a loaded cargo ship; the Mariner's areas, centroid and length over all.
SIDE, BOW, STERN, CROSS, FRONT, LATERAL, CENTRE, OVERALL = 0.85, 0.65, 0.55, 0.40, 420.0, 1650.0, -4.0, 158.0
Q = 0.5 * AIR * 10.0**2


@pytest.mark.parametrize(
    ("blows_from", "expected"),
    [
        (0.0, [-BOW * Q * FRONT, 0.0, 0.0]),
        (180.0, [STERN * Q * FRONT, 0.0, 0.0]),
        (90.0, [0.0, -SIDE * Q * LATERAL, -SIDE * Q * LATERAL * CENTRE]),
        (270.0, [0.0, SIDE * Q * LATERAL, SIDE * Q * LATERAL * CENTRE]),
    ],
)
def test_wind_on_a_stopped_ship_has_blendermanns_values(blows_from, expected):
    force = made("wind_steady", "mariner", speed=10.0, from_deg=blows_from).force(at("mariner", 0.0))
    assert force[0].tolist() == pytest.approx(expected, rel=1e-7, abs=1e-4 * Q)


def test_wind_from_the_quarter_is_blendermanns_formula_written_out():
    g = radians(50.0)  # from port: positive
    den = 1 - 0.5 * CROSS * (1 - BOW * FRONT / LATERAL / SIDE) * sin(2 * g) ** 2
    sway = SIDE * sin(g) / den * Q * LATERAL
    expected = [-BOW * cos(g) / den * Q * FRONT, sway, sway * (CENTRE / OVERALL - 0.18 * (g - pi / 2)) * OVERALL]
    force = made("wind_steady", "mariner", speed=10.0, from_deg=340.0).force(at("mariner", 0.0, psi=radians(30)))
    assert force[0].tolist() == pytest.approx(expected, rel=1e-4)  # the smooth step of CD_lAF


def test_the_wind_of_the_ships_own_speed_is_in_its_resistance():
    force = made("wind_steady", "mariner", speed=10.0, from_deg=0.0).force(at("mariner", 5.0))
    assert float(force[0, 0]) == pytest.approx(-0.5 * AIR * BOW * FRONT * (15.0**2 - 5.0**2), rel=1e-7)
    bare = made("wind_steady", "mariner", speed=10.0, from_deg=0.0, still_air=0.0).force(at("mariner", 5.0))
    assert float(bare[0, 0]) == pytest.approx(-0.5 * AIR * BOW * FRONT * 15.0**2, rel=1e-7)


def test_form_parameters_multiply_the_published_curves():
    s = situation("mariner")
    plain = made("wind_steady", "mariner", speed=12.0, from_deg=70.0).force(s)
    formed = made("wind_steady", "mariner", speed=12.0, from_deg=70.0, cx=0.5, load=1.2, cn=2.0).force(s)
    shifted = made("wind_steady", "mariner", speed=12.0, from_deg=70.0, cn_shift=0.1).force(s)
    torch.testing.assert_close(formed, plain * torch.tensor([0.6, 1.2, 2.4]))
    torch.testing.assert_close(shifted[:, 2] - plain[:, 2], 0.1 * OVERALL * plain[:, 1])


def test_a_full_ship_is_taken_for_a_tanker_unless_told():
    assert SteadyWind(ship_named("esso_190k")).coefficients == COEFFICIENTS["tanker_loaded"]
    assert SteadyWind(ship_named("esso_190k"), kind="ferry").coefficients == COEFFICIENTS["ferry"]
    with pytest.raises(InputError, match="choose one of"):
        SteadyWind(ship_named("mariner"), kind="yacht")


def test_a_wind_sets_in_at_its_time():
    steady, onset = (
        made("wind_steady", "mariner", speed=9.0),
        made("wind_onset", "mariner", speed=9.0, start_s=50.0, ramp_s=1.0),
    )
    half = made("wind_steady", "mariner", speed=4.5)
    before, then, after = (at("mariner", 6.0, time=t) for t in (40.0, 50.0, 60.0))
    assert float(onset.force(before).abs().max()) < 1e-3
    torch.testing.assert_close(onset.force(then), half.force(then))
    torch.testing.assert_close(onset.force(after), steady.force(after))


def gusts(seed: int, time: torch.Tensor) -> torch.Tensor:
    """Speeds read off head-wind forces of a stopped ship."""
    n = len(time)
    effect = GustyWind(ship_named("mariner"), seed=seed, speed=10.0, from_deg=0.0, gust_sd=1.5, gust_time_s=30.0)
    zero = torch.zeros(n, dtype=torch.float64)
    s = Situation(torch.zeros(n, 3, dtype=torch.float64), torch.zeros(n, 3, dtype=torch.float64), zero, zero, zero,
                  zero, zero + 1, time)  # fmt: skip
    return (effect.force(s)[:, 0] / (-0.5 * AIR * BOW * FRONT)).sqrt()


def test_gusts_are_a_seeded_markov_process_about_the_mean():
    time = torch.arange(0.0, 12000.0, 5.0, dtype=torch.float64)
    speed = gusts(3, time)
    assert float(speed.mean()) == pytest.approx(10.0, abs=0.3) and float(speed.std()) == pytest.approx(1.5, rel=0.12)
    about = speed - speed.mean()
    assert float((about[6:] * about[:-6]).mean() / about.var()) == pytest.approx(0.37, abs=0.1)  # 30 s apart: 1/e
    assert torch.equal(speed, gusts(3, time)) and float((speed - gusts(4, time)).abs().max()) > 1.0


def test_wave_drift_is_the_stated_formula():
    p, a = ship_named("mariner").particulars, radians(70.0 - 25.0)
    q = 1025.0 * 9.81 * p.length * 3.0**2 / 16
    effect = made("wave_drift", "mariner", Hs=3.0, from_deg=70.0)
    force = effect.force(at("mariner", 6.0, 0.5, 0.01, psi=radians(25.0)))[0].tolist()
    assert force == pytest.approx([-0.08 * q * cos(a), -0.35 * q * sin(a) ** 2, -0.03 * q * p.length * sin(2 * a)])
    port = made("wave_drift", "mariner", Hs=3.0, from_deg=340.0).force(at("mariner", 3.0, psi=radians(25.0)))
    assert port[0].tolist() == pytest.approx([force[0], -force[1], -force[2]])


def sailing(angle: float, n: int = 4001, step: float = 0.25) -> Situation:
    """A straight course at 7 m/s."""
    time, zero = step * torch.arange(n, dtype=torch.float64), torch.zeros(n, dtype=torch.float64)
    nu = torch.tensor([7.0, 0.0, 0.0], dtype=torch.float64).expand(n, 3)
    x, y = 7.0 * time * cos(angle), 7.0 * time * sin(angle)
    return Situation(nu, 0 * nu, x, y, zero + angle, zero, zero + 1, time)


@pytest.mark.parametrize("blows_from", [20.0, 75.0, 160.0])
def test_wave_frequency_motion_has_no_mean_and_rates_that_are_its_derivatives(blows_from):
    s = sailing(radians(40.0), step=0.05)
    true = recorded(s)
    wavy = made("first_order_waves", "mariner", Hs=3.0, period_s=9.0, from_deg=blows_from).record(true, s)
    added = {k: wavy[k] - true[k] for k in true}
    for place, rate in (("psi", "r"), ("x", "vn"), ("y", "ve")):
        slope = (added[place][2:] - added[place][:-2]) / 0.1
        size = float(added[rate].abs().max())
        torch.testing.assert_close(slope, added[rate][1:-1], rtol=0.0, atol=0.01 * size)
        assert abs(float(added[rate].mean())) < 0.06 * size
    assert float(added["delta"].abs().max()) == 0.0


def test_in_long_beam_waves_the_ship_moves_with_the_water():
    s = sailing(0.0)
    effect = made("first_order_waves", "mariner", Hs=3.0, period_s=12.0, from_deg=90.0)
    added = effect.record(recorded(s), s)
    assert float((added["y"] - s.y).std()) == pytest.approx(3.0 / 4, rel=0.1)
    assert float(added["psi"].abs().max()) < 1e-12
