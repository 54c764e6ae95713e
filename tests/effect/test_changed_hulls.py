import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from shelf import DEEP, at, made, situation

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.depth import depth_factors
from manoeuvre_nn.estimation.changed_coefficients import change_of_coefficients
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.ship.esso_190k import PARTICULARS, esso_190k
from manoeuvre_nn.ship.taylor import TaylorShip


def total(effect, s):
    """Accelerations with the effect."""
    return s.nudot + effect.acceleration(s, s.nu.new_zeros(len(s.psi), 0))


@pytest.mark.parametrize("ratio", [1.2, 1.5, 4.0, 8.0])
def test_shallow_water_under_the_tanker_is_the_tanker_in_shallow_water(ratio):
    s, depth = situation("esso_190k", n=8), ratio * PARTICULARS.draught
    expected = esso_190k(depth=depth).acceleration(s.nu, s.delta)
    torch.testing.assert_close(total(made("shallow_water", "esso_190k", depth_m=depth), s), expected, rtol=1e-7, atol=0)


def test_at_its_kink_the_tankers_curve_is_rounded_by_little():
    s, depth = situation("esso_190k", n=8), PARTICULARS.draught * (1 + 1 / 0.8)
    expected = esso_190k(depth=depth).acceleration(s.nu, s.delta)
    found = total(made("shallow_water", "esso_190k", depth_m=depth), s)
    assert 0.0 < float((found - expected).abs().max()) < 0.01 * float(expected.abs().max())


def test_the_shaft_speed_is_seen_by_the_terms_of_depth():
    s, depth = situation("esso_190k"), 1.3 * PARTICULARS.draught
    s = s.with_(shaft=0.7 * s.shaft)
    deep, shallow = esso_190k(), esso_190k(depth=depth)

    def turning(ship: Ship):
        force = ship.force(s.nu, s.delta) + ship.shaft_force(s.nu, s.delta, s.shaft)
        return ship.acceleration_from_force(force)

    s = s.with_(nudot=turning(deep))
    torch.testing.assert_close(total(made("shallow_water", "esso_190k", depth_m=depth), s), turning(shallow))


@pytest.mark.parametrize("ship", DEEP)
@pytest.mark.parametrize("name", ["shallow_water", "squat"])
def test_the_effect_of_the_bottom_fades_with_depth(ship, name):
    s, draught = situation(ship), ship_named(ship).particulars.draught
    sizes = [
        float((total(made(name, ship, depth_m=r * draught), s) - s.nudot).abs().sum()) for r in (1.3, 2, 5, 12, 24)
    ]
    assert sizes[1:] == sorted(sizes[1:], reverse=True) and sizes[-1] < 0.1 * max(sizes[:2])


def test_depth_factors_have_the_published_values_at_one_and_a_half_draughts():
    bulker = ship_named("great_lakes_bulker").particulars
    f = {k: float(v) for k, v in depth_factors(bulker, torch.tensor(1 / 1.5, dtype=torch.float64)).items()}
    # By hand: K0 1.224, K1 .0730, K2 .0684, B1/T 3.142; Kijima's powers 1.028, 1.092 and .9685.
    assert f["Nr"] == pytest.approx((1.564 + 2.231) / 2, rel=2e-3)
    assert f["Nv"] == pytest.approx((2.129 + 2.653) / 2, rel=2e-3)
    assert f["Yv"] == pytest.approx((1.846 + 2.428) / 2, rel=2e-3)
    assert f["Yvdot"] == pytest.approx(1.224 + 0.0730 * 3.142 * 2 / 3 + 0.0684 * 3.142**2 * 8 / 15, rel=2e-3)


@pytest.mark.parametrize("ship", DEEP)
def test_form_parameters_scale_the_changes_of_depth(ship):
    s = situation(ship)
    none = made("shallow_water", ship, surge=0.0, sway=0.0, yaw=0.0)
    torch.testing.assert_close(total(none, s), s.nudot, rtol=1e-12, atol=1e-15)
    half, full = (made("shallow_water", ship, surge=k).change(s)[0] for k in (0.5, 1.0))
    torch.testing.assert_close(half[:, 0], 0.5 * full[:, 0])
    torch.testing.assert_close(half[:, 1:], full[:, 1:])


def test_a_ship_in_shallow_water_is_not_put_there_again():
    with pytest.raises(InputError, match="write ship.depth=inf"):
        made("shallow_water", "esso_190k_shallow")


@pytest.mark.parametrize("ship", DEEP)
def test_squat_is_shallow_water_at_the_draught_under_way(ship):
    p = ship_named(ship).particulars
    depth = 1.3 * p.draught
    squat, plain = (made(n, ship, depth_m=depth) for n in ("squat", "shallow_water"))
    slow, fast = at(ship, 0.02 * p.speed, 1e-3), at(ship, 0.5 * p.speed, 0.1 * p.speed)
    still, everywhere = squat.change(slow)[1], plain.change(slow)[1]
    torch.testing.assert_close(still, everywhere.expand_as(still), rtol=1e-3, atol=1e-9)
    knots = 0.5 * p.speed * 3600 / 1852
    sinkage = p.block * (p.draught * p.block**0.85 / 7.04 / depth) ** 0.81 * knots**2.08 / 20
    assert 0.1 < sinkage < 0.6
    immersion = float(squat._immersion(fast)) * depth - p.draught
    assert 0.7 * sinkage < immersion < sinkage


def test_mass_alone_changes_inertia_and_centrifugal_terms():
    s = situation("esso_190k")
    u, v, r = s.nu.unbind(-1)
    found = total(made("displacement_change", "esso_190k", factor=1.1, hull_exponent=0.0), s)
    gyration = 0.25**2
    expected = [(1.05 * s.nudot[:, 0] + 0.1 * v * r) / 1.15, (2.02 * s.nudot[:, 1] - 0.1 * u * r) / 2.12]
    expected.append(0.1232 * s.nudot[:, 2] / (0.1232 + 0.1 * gyration))
    torch.testing.assert_close(found, torch.stack(expected, dim=-1))


@pytest.mark.parametrize("ship", DEEP)
def test_a_draught_is_a_displacement_with_all_hull_forces_as_its_square(ship):
    s = situation(ship)
    loading = total(made("loading", ship, draught_ratio=0.9), s)
    mass = total(made("displacement_change", ship, factor=0.9, hull_exponent=2.0), s)
    torch.testing.assert_close(loading[:, 1:], mass[:, 1:])
    assert bool((loading[:, 0] > mass[:, 0]).all())  # a lighter ship has less wetted surface


def test_trim_changes_the_four_linear_derivatives_as_stated():
    ship = ship_named("great_lakes_bulker")
    speed, t = ship.particulars.speed, 1.5 / ship.particulars.draught
    effect, mass = made("trim_change", ship, trim_m=1.5), ship.particulars.mass / ship.prime.mass
    drift = effect.change(at(ship, speed, 0.1 * speed))[0][0] / 0.1
    yaw = effect.change(at(ship, speed, 0.0, 0.1 * speed / ship.particulars.length))[0][0] / 0.1
    assert drift.tolist() == pytest.approx([0.0, 0.67 * t * -0.32535, -0.27 * t * -0.32535])
    assert yaw.tolist() == pytest.approx([0.0, 0.80 * t * (mass - 0.162), 0.30 * t * -0.04433])


def slowest(ship: str, trim: float) -> float:
    """Largest real part of the roots of sway and yaw on a straight course [1/s]."""
    speed = ship_named(ship).particulars.speed

    def rates(lateral):
        nu = torch.cat([lateral.new_tensor([speed]), lateral])[None]
        zero = torch.zeros(1, dtype=torch.float64)
        s = at(ship, speed).with_(nu=nu, nudot=ship_named(ship).acceleration(nu, zero))
        return total(made("trim_change", ship, trim_m=trim), s)[0, 1:]

    matrix = torch.autograd.functional.jacobian(rates, torch.full((2,), 1e-9, dtype=torch.float64))
    return float(torch.linalg.eigvals(matrix).real.max())


@pytest.mark.parametrize("ship", DEEP)
def test_trim_by_the_stern_makes_every_ship_steadier(ship):
    assert slowest(ship, 1.0) < slowest(ship, 0.0) < slowest(ship, -1.0)


def test_parts_of_a_series_add_up_to_its_forces_but_for_rudder_and_resistance():
    s = situation("great_lakes_bulker")
    ship = ship_named("great_lakes_bulker")
    loaded = made("loading", ship)
    tables = loaded.series.of_drift, loaded.series.of_yaw, loaded.series.of_mass
    drift, yaw, inertial = (loaded.force_of(s, table) for table in tables)
    whole = ship.force(s.nu, torch.zeros_like(s.delta))
    torch.testing.assert_close((drift + yaw + inertial)[:, 1:], whole[:, 1:])
    mass, units = ship.particulars.mass / ship.prime.mass, ship.velocity_units
    assert mass == pytest.approx(0.1913, rel=1e-3)
    q = s.r / units[2]
    torch.testing.assert_close(inertial[:, 1], -mass * q)


@pytest.mark.parametrize("ship", DEEP)
def test_a_ship_of_twice_the_inertia_is_moved_half_as_much_by_the_same_force(ship):
    """Masses and added masses doubled; what else moves her is as in :class:`DisplacementChange`."""
    s, heavy = situation(ship), made("displacement_change", ship, factor=2.0, hull_exponent=1.0)
    nudot = s.nu.new_tensor([0.02, -0.01, 3e-4]).expand(s.nu.shape)
    inertia = ship_named(ship).inertia
    off_diagonal = float((inertia - torch.diag(inertia.diagonal())).abs().max()) > 0
    found = heavy.with_changed_inertia(s, nudot)
    torch.testing.assert_close(found[:, 0], 0.5 * nudot[:, 0])
    if not off_diagonal:
        torch.testing.assert_close(found, 0.5 * nudot)
    twice = inertia + torch.diag(inertia.diagonal())
    units = ship_named(ship).acceleration_units
    by_hand = torch.linalg.solve(twice, inertia @ (nudot[0] / units)) * units
    torch.testing.assert_close(found[0], by_hand)


CHANGING = [
    [("shallow_water", {"depth_m": 24.0})],
    [("displacement_change", {"factor": 1.6})],
    [("trim_change", {"trim_m": 2.0})],
    [("loading", {"draught_ratio": 0.7})],
    [("rudder_area_loss", {"fraction": 0.4})],
    [("displacement_change", {"factor": 0.6}), ("rudder_area_loss", {"fraction": 0.4})],
]


def accelerations(model, s, *rows):
    """Of a model in some situations, in each of so many rows of coefficients."""
    motion, delta = torch.cat([s.nu, 0 * s.nu], dim=-1), s.delta
    return model(motion.expand(*rows, *motion.shape), Inputs(delta.expand(*rows, *delta.shape)))[..., :3]


def named(effects) -> str:
    return "+".join(name for name, _ in effects)


@pytest.mark.parametrize("effects", CHANGING, ids=named)
@pytest.mark.parametrize("ship", ["mariner", "great_lakes_bulker"])
def test_effects_act_on_the_coefficients_as_they_are(ship, effects):
    """A published ship with corrections, and a ship that was built with these coefficients."""
    published = ship_named(ship)
    names = Corrections(CalmWater(published)).names
    errors = {name: 0.2 * np.cos(k) for k, name in enumerate(names) if "+" not in name and name[0] in "XYN"}

    def name_of(term: str) -> str:
        return "".join(sorted(term.strip("0"), key="uvrd".index)) or "0"

    scattered = {
        e: {t: c * (1 + errors[e + name_of(t)]) for t, c in of.items()} for e, of in published.coefficients.items()
    }
    real = TaylorShip(
        published.particulars, published._inertia_values, scattered, prime=published.prime, taylor=published.taylor,
        scaling=published.scaling, positive_rudder_turns_to=published.positive_rudder_turns_to,
    )  # fmt: skip
    s, shares = situation(published, n=20), published.inertia.new_tensor([errors.get(name, 0.0) for name in names])
    with unchecked():
        found = accelerations(
            Vessel(Calibrated(CalmWater(published), shares), [made(n, published, **v) for n, v in effects]).model, s
        )
        expected = accelerations(Vessel(CalmWater(real), [made(n, real, **v) for n, v in effects]).model, s)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("effects", CHANGING, ids=named)
@pytest.mark.parametrize("ship", DEEP)
def test_errors_of_coefficients_are_multiplied_as_the_terms_are(ship, effects):
    """Their columns, recombined, are the derivatives of the changed ship by her corrections."""
    calm = CalmWater(ship_named(ship))
    corrections, acting = Corrections(calm), [made(n, ship, **v) for n, v in effects]
    s, size = situation(ship, n=20), 1e-4
    with unchecked():
        columns = corrections(s.nu, s.delta).numpy()
        change = change_of_coefficients(corrections, acting, [e.values.numpy() for e in acting])
        shares = size * torch.eye(len(corrections.names), dtype=torch.float64)[:, None]
        models = (Vessel(Calibrated(calm, rows), acting).model for rows in (shares, -shares))
        sides = [accelerations(model, s, len(shares)).transpose(0, 1).numpy() for model in models]
    expected = (sides[0] - sides[1]) / (2 * size)
    found = np.einsum("nkj,ki->nij", columns, change + np.eye(len(change)))
    # Without off-diagonal inertia; with it a wrong Mv or Mr has another shape.
    whole = [k for k, name in enumerate(corrections.names) if name not in ("Mv", "Mr")]
    usual = np.sqrt((expected**2).mean(axis=(0, 1)))
    assert np.abs((found - expected) / usual)[:, whole].max() < 1e-6


def test_a_ships_terms_are_not_taken_for_those_of_another_that_has_its_id_now():
    effect, another = made("shallow_water", "esso_190k", depth_m=1.5 * PARTICULARS.draught), ship_named("mariner")
    effect._sorted[id(another)] = effect.series  # as where an effect comes back from another process
    assert effect.aboard(another).series.ship is another


def test_a_corrected_ship_has_the_corrections_that_its_model_has_now():
    ship = ship_named("mariner")
    names = Corrections(CalmWater(ship)).names
    model = Calibrated(CalmWater(ship), torch.zeros(len(names)))
    torch.testing.assert_close(model.corrected(ship).table, ship.table)
    model.load_state_dict({**model.state_dict(), "shares": torch.full((len(names),), 0.1)})
    assert (model.corrected(ship).table != ship.table).any()
