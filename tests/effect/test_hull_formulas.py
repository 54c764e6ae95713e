"""Changed hulls by a second route: the Mariner's equations written out with changed numbers, and solved."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import torch
from fleet import ship_named
from pytest import approx
from shelf import at, made

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.effect.common import TIGHT_TURN, typical
from manoeuvre_nn.effect.depth import RESISTANCE, depth_factors
from manoeuvre_nn.ship.esso_190k import COEFFICIENTS as TANKER
from manoeuvre_nn.ship.known import no_part

U, V, R, D = 6.1, -0.62, 0.0113, -0.21
LENGTH, DRAUGHT, SPEED = 152.4, 8.138, 7.614
FORCE = 0.5 * 1025 * LENGTH * DRAUGHT * SPEED**2
MASS = 16_274e3 / (0.5 * 1025 * LENGTH**2 * DRAUGHT)
GYRATION = MASS * 0.25**2


def mariner(
    delta: float = D, u: float = U, v: float = V, r: float = R, share: float = 1.0, **changes: float
) -> np.ndarray:
    """Accelerations of the Mariner by Wang's Table 3.2 (rudder to port), parts of it times a factor.

    Args:
        delta: Rudder angle, positive to starboard [rad].
        u: Forward speed [m/s].
        v: Sway velocity [m/s].
        r: Yaw rate [rad/s].
        share: What the nonlinear terms of the hull have of the change of the linear ones.
        changes: Factors on the hydrodynamic parts ``Xvr Yv Yr Nv Nr``, on added masses ``ax ay az`` and on ``mass``;
            ``X``, an addition in surge.
    """
    f = {**dict.fromkeys(("Xvr", "Yv", "Yr", "Nv", "Nr", "ax", "ay", "az", "mass"), 1.0), "X": 0.0, **changes}
    sway3, yaw3 = (1 + share * (f[name] - 1) for name in ("Yv", "Nv"))
    a, b, q, d = u / SPEED - 1, v / SPEED, r * LENGTH / SPEED, -delta
    m = MASS
    surge = -0.0253 * a + 0.01896 * a * a / 2 - 0.01302 * a**3 / 6 - 0.378 * b * b / 2 + 0.01272 * q * q / 2
    surge += -0.04 * d * d / 2 + 0.0196 * b * d + ((0.168 - m) * f["Xvr"] + m * f["mass"]) * b * q + f["X"]
    sway = -0.0008 - 0.244 * b * f["Yv"] + (-10.212 * b**3 / 6 + 6.46 * q * b * b / 2) * sway3 - 0.0016 * b * d * d / 2
    sway += ((-0.105 + m) * f["Yr"] - m * f["mass"]) * q + 0.0586 * d - 0.0585 * d**3 / 6 + 0.5 * d * b * b / 2
    yaw = 0.00059 - 0.0555 * b * f["Nv"] + (2.07 * b**3 / 6 - 2.316 * q * b * b / 2) * yaw3 + 0.00528 * b * d * d / 2
    yaw += -0.03747 * q * f["Nr"] - 0.0293 * d + 0.02892 * d**3 / 6 - 0.2064 * d * b * b / 2
    inertia = np.array([[0.177, 0, 0], [0, 0.327, 0.00077], [0, -0.00221, 0.0175]])
    for k, (own, added) in enumerate(((m, f["ax"]), (m, f["ay"]), (GYRATION, f["az"]))):
        inertia[k, k] = own * f["mass"] + (inertia[k, k] - own) * added
    return np.linalg.solve(inertia, [surge, sway, yaw]) * SPEED**2 / LENGTH / [1, 1, LENGTH]


def acting(name: str, **values: float) -> np.ndarray:
    """Accelerations of the package's Mariner with an effect."""
    ship = ship_named("mariner_corrected")
    s = at(ship, U, V, R, delta=D)
    return (s.nudot + made(name, ship, **values).acceleration(s, torch.zeros(1, 0, dtype=torch.float64)))[0].numpy()


def test_the_mariner_written_out_is_that_of_the_package():
    s = at("mariner_corrected", U, V, R, delta=D)
    assert mariner() == approx(s.nudot[0].numpy(), rel=1e-12)
    assert MASS == approx(0.168, rel=1e-3)


HULL = Particulars("hull", 100.0, 15.0, 5.0, 0.7, 6.0, 0.04, 0.6)
WIDE = replace(HULL, beam=20.0, draught=4.0)
# K0, K1 and K2 (up to B/T = 4) of Ankudinov et al. at h/T - 1 = .2 and 2, worked out by hand.
ANKUDINOV = {0.2: (1.775, 0.3156875, 0.17125), 2.0: (1.018002125, -0.015460103125, 0.017125)}


@pytest.mark.parametrize("gap", ANKUDINOV)
@pytest.mark.parametrize("ship", [HULL, WIDE], ids=["narrow", "wide"])
def test_factors_of_depth_are_those_of_the_two_sources_and_of_what_lies_between(gap, ship):
    k0, k1, k2 = ANKUDINOV[gap]
    immersion, flat = torch.tensor(1 / (1 + gap), dtype=torch.float64), ship.beam / ship.draught
    k2 *= 4 / max(4.0, flat)
    full = ship.block * flat * (1 + ship.beam / ship.length) ** 2
    nr = k0 + k1 * full / 2 + k2 * full**2 / 3
    other = {"Yv": 1.5 * nr - 0.5, "Nv": k0 + k1 * full + k2 * full**2, "Nr": nr}
    deeper = 1 + 1 / gap  # h / (h - T)
    powers = {"Yv": 0.4 * 0.7 * flat, "Nv": 0.425 * 0.7 * flat, "Nr": 1.5 - 14.28 * ship.draught / 100.0}
    kijima = {name: deeper**q - 1 / (1 + gap) for name, q in powers.items()}
    for source in (0.0, 1.0, 0.3):
        found = depth_factors(ship, immersion, source)
        for name in powers:
            assert float(found[name]) == approx((1 - source) * kijima[name] + source * other[name], rel=1e-9), name
        assert float(found["Yvdot"]) == approx(k0 + 2 / 3 * k1 * full + 8 / 15 * k2 * full**2, rel=1e-9)
        assert float(found["Nrdot"]) == approx(k0 + 8 / 15 * k1 * full + 40 / 105 * k2 * full**2, rel=1e-9)


@pytest.mark.parametrize("ratio, source", [(1.3, 0.2), (2.2, 0.9)])
def test_the_mariner_in_shallow_water_has_her_terms_times_these_factors(ratio, source):
    p = ship_named("mariner_corrected").particulars
    f = {k: float(v) for k, v in depth_factors(p, torch.tensor(1 / ratio, dtype=torch.float64), source).items()}
    form = {"surge": 0.7, "sway": 1.2, "yaw": 0.9, "nonlinear": 0.4}

    def part(name: str, of: str) -> float:
        return 1 + form[of] * (f[name] - 1)

    drag = -0.7 * 0.16 / (ratio - 1) * 350.1e3 * (U / SPEED) ** 2 / FORCE
    expected = mariner(
        share=0.4, Xvr=part("Yvdot", "surge"), Yv=part("Yv", "sway"), Yr=part("Nr", "sway"), Nv=part("Nv", "yaw"),
        Nr=part("Nr", "yaw"), ax=part("Yvdot", "surge"), ay=part("Yvdot", "sway"), az=part("Nrdot", "yaw"), X=drag,
    )  # fmt: skip
    found = acting("shallow_water", depth_m=ratio * DRAUGHT, source=source, **form)
    assert found == approx(expected, rel=1e-9)
    assert RESISTANCE == approx(TANKER["Xuuz"] / TANKER["Xuu"], rel=0.02)


@pytest.mark.parametrize("ratio, speed", [(15.0, 6.0), (1.5, 3.0)])
def test_a_ship_squats_by_barrass_formula_less_what_the_room_under_her_takes_off(ratio, speed):
    """``C_B S^.81 V^2.08 / 20`` with the ship's section over that of water 7.04 B / C_B^.85 wide."""
    p = ship_named("great_lakes_bulker").particulars
    depth, knots = ratio * 8.1, speed * 3600 / 1852
    blockage = 23.005 * 8.1 / (7.04 * 23.005 / 0.905**0.85 * depth)
    sinkage = 1.4 * 0.905 * blockage**0.81 * knots**2.08 / 20
    squat = made("squat", "great_lakes_bulker", depth_m=depth, sinkage=1.4)
    found = float(squat._immersion(at("great_lakes_bulker", speed))) * depth - p.draught
    room = (depth - 8.1) / 2
    assert found == approx(room * -np.expm1(-sinkage / room), rel=1e-6)
    fast = float(squat._immersion(at("great_lakes_bulker", 60.0))) * depth - p.draught
    assert fast <= room * (1 + 1e-12), "half of the clearance is left"


def test_a_depth_of_hardly_more_than_the_draught_is_taken_as_1_02_draughts():
    shallow = made("shallow_water", "mariner")
    aground = shallow.at(torch.cat([torch.tensor([0.5 * DRAUGHT]).double(), shallow.values[1:]]))
    assert float(aground._immersion(at("mariner", 5.0))) == approx(1 / 1.02)
    assert [(p.low / DRAUGHT, p.high / DRAUGHT) for p in shallow.declared[:1]] == [approx((1.03, 50.0))]


@pytest.mark.parametrize("factor, exponent", [(1.35, 0.6), (0.7, 1.8)])
def test_another_mass_of_the_mariner_scales_her_mass_and_by_a_power_her_hull(factor, exponent):
    hull = factor**exponent
    expected = mariner(mass=factor, Xvr=hull, Yv=hull, Yr=hull, Nv=hull, Nr=hull, ax=hull, ay=hull, az=hull)
    found = acting("displacement_change", factor=factor, hull_exponent=exponent)
    assert found == approx(expected, rel=1e-9)


def test_another_draught_scales_mass_hull_and_the_sides_of_the_wetted_surface():
    k = 0.8
    side = 1.7 * LENGTH * DRAUGHT
    surface = side + 16_274e3 / 1025 / DRAUGHT  # Mumford: the bottom stays as it is
    drag = -350.1e3 * (k - 1) * side / surface * (U / SPEED) ** 2 / FORCE
    expected = mariner(mass=k, X=drag, **dict.fromkeys(("Xvr", "Yv", "Yr", "Nv", "Nr", "ax", "ay", "az"), k * k))
    assert acting("loading", draught_ratio=k) == approx(expected, rel=1e-9)


def test_less_rudder_area_is_less_of_every_term_with_the_rudder():
    full, none = mariner(), mariner(delta=0.0)
    assert acting("rudder_area_loss", fraction=0.35) == approx(full - 0.35 * (full - none), rel=1e-9)


def test_a_lost_area_changes_the_terms_with_the_rudder_and_none_of_a_ship_without_terms():
    ship = ship_named("mariner_corrected")
    lost = made("rudder_area_loss", ship, fraction=0.35).changed_terms()
    for term, shares in zip(ship.terms, lost, strict=True):
        torch.testing.assert_close(shares, -0.35 * torch.eye(3, dtype=torch.float64) * ("d" in term))
    assert made("rudder_area_loss", no_part(ship)).changed_terms() is None


def test_an_effect_that_is_taken_to_many_ships_keeps_the_terms_of_the_last_few():
    effect, hull = made("loading", "great_lakes_bulker"), ship_named("great_lakes_bulker")
    ships = [hull.on_approach(4.0 + 0.01 * k) for k in range(20)]
    sorted_of = [effect.aboard(ship).series for ship in ships]
    assert all(one.ship is ship for one, ship in zip(sorted_of, ships, strict=True))
    assert 1 <= len(effect._sorted) <= 16
    assert effect.aboard(ships[-1]).series is sorted_of[-1], "kept, not sorted anew"


def test_usual_accelerations_are_those_of_the_resistance_and_of_20_deg_of_rudder():
    """Formulas without a name weigh their terms by them."""
    turned = mariner(delta=np.radians(20), u=SPEED, v=0.0, r=0.0) - mariner(delta=0.0, u=SPEED, v=0.0, r=0.0)
    held_back = 350.1e3 / FORCE / 0.177 * SPEED**2 / LENGTH
    assert typical(ship_named("mariner_corrected")).tolist() == approx([held_back, *np.abs(turned[1:])])
    unknown = typical(no_part(ship_named("mariner_corrected")))
    usual = [0.06 * SPEED**2 / LENGTH, 0.5 * SPEED**2 / LENGTH**2]
    assert unknown.tolist() == approx([held_back, *usual])
    assert np.abs(turned[1:]) == approx(usual, rel=0.35), "about those of the Mariner"
    assert {k: round(v, 6) for k, v in TIGHT_TURN.items()} == {"u": 0.3, "v": 0.25, "r": 0.7, "d": 0.35}
    assert TIGHT_TURN["d"] == approx(20 * pi / 180, rel=0.01)
