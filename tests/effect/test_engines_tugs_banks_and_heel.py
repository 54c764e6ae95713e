from math import exp, pi, radians, sqrt

import pytest
import torch
from fleet import ship_named
from shelf import DEEP, at, made, recorded, situation

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel

NONE = torch.zeros(1, 0, dtype=torch.float64)


@pytest.mark.parametrize("ship", DEEP)
def test_the_propellers_side_force_acts_near_the_stern_with_the_square_of_the_shaft_speed(ship):
    effect = made("propeller_side_force", ship, force_kN=40.0)
    force = effect.force(at(ship, 5.0, shaft=0.5))[0].tolist()
    assert force == pytest.approx([0.0, 10e3, -0.48 * ship_named(ship).particulars.length * 10e3])
    assert float(effect.acceleration(at(ship, 5.0), NONE)[0, 2]) < 0  # the stern to starboard, the bow to port


@pytest.mark.parametrize("ship", [s for s in DEEP if s != "esso_190k"])
def test_on_the_approach_thrust_is_the_resistance(ship):
    p = ship_named(ship).particulars
    effect = made("propeller_pitch_error", ship, fraction=0.2)
    assert float(effect.force(at(ship, p.speed))[0, 0]) == pytest.approx(0.2 * p.calm_resistance)
    half = effect.force(at(ship, 0.5 * p.speed, shaft=0.8))[0, 0]
    assert float(half) == pytest.approx(0.2 * p.calm_resistance * (2 * 0.64 - 0.8 * 0.5))


@pytest.mark.parametrize("time, share", [(50.0, 0.0), (100.0, 0.5), (150.0, 1.0), (200.0, 0.5), (250.0, 0.0)])
def test_a_loss_of_thrust_is_that_of_a_slower_shaft_for_a_while(time, share):
    """``T = R0 [(1 + s) n^2 - s n u/U0]`` with s = 1, at U0: from 1 to 2 n^2 - n; with a recorded .9, from .72 on."""
    p = ship_named("mariner").particulars
    effect = made("thrust_loss", "mariner", rpm_loss=0.4, start_s=100.0, end_s=200.0, ramp_s=5.0)
    assert p.thrust_slope == 1.0
    for shaft in (1.0, 0.9):
        n = shaft * (1 - 0.4 * share)
        lost = p.calm_resistance * ((2 * n**2 - n) - (2 * shaft**2 - shaft))
        expected = ship_named("mariner").acceleration_from_si(torch.tensor([lost, 0.0, 0.0], dtype=torch.float64))
        found = effect.acceleration(at("mariner", p.speed, time=time, shaft=shaft), NONE)[0]
        assert found.tolist() == pytest.approx(expected.tolist(), rel=1e-6, abs=1e-9)
    lasting = made("thrust_loss", "mariner", rpm_loss=0.4, start_s=100.0)
    late, full = (lasting.acceleration(at("mariner", p.speed, time=t), NONE)[0, 0] for t in (5000.0, 150.0))
    assert float(late) == pytest.approx(float(full)) and float(full) < 0


def test_a_tanker_that_loses_thrust_steers_worse():
    """Her rudder lies in the race: what is lost is what another shaft speed makes of the whole ship."""
    tanker, s = ship_named("esso_190k"), at("esso_190k", 7.0, time=500.0, delta=0.3)
    effect = made("thrust_loss", "esso_190k", rpm_loss=0.25, start_s=100.0)
    expected = tanker.acceleration_from_force(tanker.shaft_force(s.nu, s.delta, 0.75 * s.shaft))
    found = effect.acceleration(s, NONE)
    assert torch.allclose(found, expected, rtol=1e-6) and float(found[0, 2]) < 0 < float(found[0, 1])


def test_the_tankers_pitch_error_is_a_share_of_its_own_thrust():
    ship = ship_named("esso_190k")
    s = at(ship, ship.self_propulsion, 1e-12)
    hull = -0.0377 * ship.self_propulsion**2 / 304.8  # Xuu u^2 / L, which thrust balances
    change = made("propeller_pitch_error", ship, fraction=0.1).acceleration(s, NONE)
    assert float(change[0, 0]) == pytest.approx(-0.1 * hull / 1.05, rel=2e-4)
    # Its side force and moment are shares YT and NT of gT, of which 1 - t pushes ahead (Table 1, with m22 and m33).
    assert float(change[0, 1]) == pytest.approx(-0.1 * hull / 0.78 * 0.04 / 2.02, rel=1e-3)
    assert float(change[0, 2]) == pytest.approx(-0.1 * hull / 0.78 * -0.02 / 0.1232 / 304.8, rel=1e-3)


@pytest.mark.parametrize("ship", DEEP)
def test_an_engine_at_its_limit_starts_steady_and_lags(ship):
    speed = ship_named(ship).particulars.speed
    effect = made("power_limit", ship, rpm_slope=0.4, lag_s=10.0)
    slow = at(ship, 0.5 * speed)
    start = effect.memory_at_start(slow)
    assert float(start) == pytest.approx(0.8) and float(effect.memory_rate(slow, start)) == pytest.approx(0.0)
    assert float(effect.memory_rate(slow, start + 0.1)) == pytest.approx(-0.01)
    assert float(effect.memory_at_start(at(ship, speed))) == pytest.approx(1.0)
    assert float(effect.shaft(slow, start)) == pytest.approx(0.8)


@pytest.mark.parametrize("ship", DEEP)
def test_less_shaft_speed_is_what_the_ship_itself_makes_of_it(ship):
    hull, s = ship_named(ship), situation(ship)
    affected = Vessel(CalmWater(hull), [made("power_limit", ship)]).model
    state = torch.cat([s.nu, torch.stack([s.x, s.y, s.psi, 0 * s.x + 0.7], dim=-1)], dim=-1)
    force = hull.force(s.nu, s.delta) + hull.shaft_force(s.nu, s.delta, 0 * s.x + 0.7)
    expected = hull.acceleration_from_force(force)
    torch.testing.assert_close(affected(state, Inputs(s.delta, time=s.time))[:, :3], expected)


def test_the_tachometer_shows_the_shaft():
    s = situation("mariner").with_(shaft=torch.full((4,), 0.8, dtype=torch.float64))
    true = recorded(s) | {"shaft_recorded": torch.ones(4, dtype=torch.float64)}
    assert made("power_limit", "mariner").record(true, s)["shaft_recorded"].tolist() == [0.8] * 4


@pytest.mark.parametrize("ship", DEEP)
def test_fouling_grows_with_the_square_of_the_speed_and_ice_does_not(ship):
    p = ship_named(ship).particulars
    fouling, ice = made("hull_fouling", ship, added_resistance=0.3), made("ice_resistance", ship, force_kN=90.0)
    for share in (1.0, 0.5, -0.3):
        s = at(ship, share * p.speed)
        sign = 1.0 if share > 0 else -1.0
        force = fouling.force(s)[0].tolist()
        assert force == pytest.approx([-0.3 * p.calm_resistance * share**2 * sign, 0.0, 0.0])
        assert ice.force(s)[0].tolist() == pytest.approx([-90e3 * sign, 0.0, 0.0])


@pytest.mark.parametrize("time", [30.0, 100.0, 150.0, 200.0, 260.0])
def test_a_side_force_acts_in_its_interval(time):
    effect = made("side_force", "mariner", force_kN=50.0, lever_m=-20.0, start_s=100.0, end_s=200.0, ramp_s=20.0)
    share = {30.0: 0.0, 100.0: 0.5, 150.0: 1.0, 200.0: 0.5, 260.0: 0.0}[time]
    force = effect.force(at("mariner", 5.0, time=time))[0].tolist()
    assert force == pytest.approx([0.0, 50e3 * share, -20.0 * 50e3 * share], abs=1e-3)


def test_the_gate_has_the_stated_slope():
    effect = made("side_force", "mariner", force_kN=1.0, start_s=100.0, end_s=200.0, ramp_s=20.0)
    early, late = (float(effect.force(at("mariner", 5.0, time=t))[0, 1]) for t in (99.99, 100.01))
    assert (late - early) / 0.02 == pytest.approx(1000.0 / 20.0, rel=1e-3)


@pytest.mark.parametrize(("given", "lever"), [({}, 0.4), ({"lever": 0.44}, 0.44)])
def test_a_bow_thruster_pushes_at_four_tenths_of_the_length_or_at_its_lever(given, lever):
    effect = made("bow_thruster", "mariner", force_kN=50.0, start_s=0.0, end_s=500.0, **given)
    force = effect.force(at("mariner", 5.0, time=100.0))[0].tolist()
    assert force == pytest.approx([0.0, 50e3, 50e3 * lever * 152.4])


def test_a_tow_pulls_in_its_direction_at_its_lever():
    effect = made("tow", "mariner", force_kN=100.0, angle_deg=30.0, lever_m=60.0, start_s=0.0, end_s=500.0)
    force = effect.force(at("mariner", 5.0, psi=1.0, time=100.0))[0].tolist()
    assert force == pytest.approx([100e3 * sqrt(0.75), 50e3, 60 * 50e3])


def test_a_bank_draws_the_ship_and_pushes_its_bow_away():
    beam, length, draught = 21.763, 152.4, 8.138
    bank = made("bank", "mariner", distance_m=150.0, along_deg=0.0)
    force = bank.force(at("mariner", 6.0))[0].tolist()
    pull = 0.1 * 1025 * 36 * beam * draught * beam / 300
    assert force == pytest.approx([0.0, pull, -0.5 * length * pull])
    other = made("bank", "mariner", side="port", distance_m=150.0, along_deg=0.0).force(at("mariner", 6.0))
    assert other[0].tolist() == pytest.approx([0.0, -pull, 0.5 * length * pull])
    slow = bank.force(at("mariner", 3.0))[0].tolist()
    assert slow == pytest.approx([c / 4 for c in force])


def test_a_bank_stays_in_its_place_or_follows():
    place, following = (
        made("bank", "mariner", distance_m=150.0, along_deg=0.0, follow=follow) for follow in (False, True)
    )
    nearer = at("mariner", 6.0, x=400.0, y=50.0)
    half = float(following.force(nearer)[0, 1])
    assert float(place.force(nearer)[0, 1]) == pytest.approx(1.5 * half, rel=1e-6)
    east = made("bank", "mariner", distance_m=150.0, along_deg=90.0).force(at("mariner", 6.0, x=-50.0, y=999.0))
    assert float(east[0, 1]) == pytest.approx(1.5 * half, rel=1e-6)


@pytest.mark.parametrize("ship", DEEP)
def test_a_ship_heels_out_of_its_turn_by_the_stated_angle(ship):
    p = ship_named(ship).particulars
    heel, effect = p.heeling, made("roll_coupling", ship, N_phi=0.01)
    s = at(ship, 0.8 * p.speed, 0.0, 0.4 * p.speed / p.length).with_(nudot=torch.zeros(1, 3, dtype=torch.float64))
    angle = -(heel.kg - p.draught / 2) / (9.81 * heel.gm) * 0.32 * p.speed**2 / p.length
    memory = torch.tensor([[angle, 0.0]], dtype=torch.float64)
    torch.testing.assert_close(effect.memory_rate(s, memory), torch.zeros(1, 2, dtype=torch.float64))
    assert radians(0.02) < abs(angle) < radians(20.0) and (angle < 0) == (heel.kg > p.draught / 2)
    unit = 0.5 * 1025 * p.length**2 * p.draught * p.speed**2
    expected = ship_named(ship).acceleration_from_si(torch.tensor([[0.0, 0.0, 0.01 * unit * angle]]).double())
    torch.testing.assert_close(effect.acceleration(s, memory), expected, rtol=1e-6, atol=1e-15)


def test_roll_rings_at_its_period_with_its_damping():
    heel, effect, s = ship_named("mariner").particulars.heeling, made("roll_coupling", "mariner"), at("mariner", 7.0)
    still = effect.memory_rate(s, torch.zeros(1, 2, dtype=torch.float64))[0]
    matrix = torch.stack([effect.memory_rate(s, row[None])[0] - still for row in torch.eye(2).double()], dim=-1)
    root = torch.linalg.eigvals(matrix)[0]
    assert abs(complex(root)) == pytest.approx(2 * pi / heel.roll_period)
    assert float(root.real) == pytest.approx(-0.08 * 2 * pi / heel.roll_period)
    assert exp(float(root.real) * heel.roll_period) < 1
