"""Runs whose shaft turned at another speed than the model's: what drives it, and what is no sign of an engine."""

import numpy as np
import pytest
import torch
from fleet import SHIPS, ship_named
from pytest import approx
from trials import CALM, SHIP, run_of, sailed

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.repair import predict
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linearised_run import Rate
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.recording.preparation import measured, with_own_shafts
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg, esso_osaka_model
from manoeuvre_nn.ship.known import clarke_inertia_part

pytestmark = pytest.mark.usefixtures("unchecked_types")
N = MEASURED.index("shaft_recorded")
WARMUP = 40.0
U0 = SHIP.particulars.speed


def number(value):
    return torch.tensor(value, dtype=torch.float64)


def series(surge=("u u", "n n"), values=(-0.02, 0.02)) -> IdentifiedShip:
    """A series that keeps u = n."""
    known = clarke_inertia_part(esso_osaka_model())
    network = Series(SeriesSettings(surge, ("v", "d n n")))
    with torch.no_grad():
        network.coefficients[0, 0, [network.terms.index(t) for t in surge]] = number(values)
        network.coefficients[0, 1:, network.terms.index("d n n")] = number([0.03, -0.01])
    return IdentifiedShip(known, network, Scaling(torch.zeros(4), torch.ones(4), torch.ones(3))).double()


def run(ratio: float):
    """A straight run with the shaft at another speed throughout."""
    made = run_of(sailed([straight(240.0)])[0])
    return made.with_channels(shaft=np.full(len(made), ratio))


def test_a_series_feels_the_shaft_through_its_own_n_and_nothing_else():
    model = series()
    nu, delta = number([[1.2 * 0.4, 0.0, 0.0]]), number(0.0)
    assert float(Rate(model)(nu, delta, number([1.2])).detach().abs().max()) < 1e-9
    rudder = [Rate(model)(nu, number(0.2), number([n]))[0, 2].detach() for n in (1.2, 2.4)]
    assert float(rudder[1] / rudder[0]) == approx(4.0)


def test_a_ship_without_such_a_network_keeps_its_own_rule_for_the_shaft():
    nu, delta = number([[U0, 0.0, 0.0]]), number([0.0])
    extra = SHIP.acceleration_from_force(SHIP.shaft_force(nu, delta, number([1.2])))
    rate = Rate(CALM)(nu, delta, number([1.2]))
    assert extra[0, 0] > 0 and (rate - calm_accelerations(CALM, nu, delta)).numpy() == approx(extra.numpy())


def test_a_free_run_is_driven_by_the_recorded_shaft_speed():
    (nominal,), (faster,) = (predict(CALM, Hypothesis((), ()), [run(ratio)], WARMUP) for ratio in (1.0, 1.2))
    assert nominal["u"].iloc[-1] == approx(U0, rel=0.01) and faster["u"].iloc[-1] > 1.08 * U0
    u, v, r = faster[["u", "v", "r"]].iloc[-1]
    end = number([[u, v, r * DEGREE]])
    slope = faster["u"].diff().iloc[-1]
    assert float(Rate(CALM)(end, number(0.0), number([1.2]))[0, 0]) == approx(slope, rel=0.05)


def test_runs_that_are_predicted_together_keep_their_own_shaft_speeds():
    together = predict(CALM, Hypothesis((), ()), [run(0.8), run(1.2)], WARMUP)
    for one, ratio in zip(together, (0.8, 1.2), strict=True):
        assert one["u"].to_numpy() == approx(predict(CALM, Hypothesis((), ()), [run(ratio)], WARMUP)[0]["u"].to_numpy())


def test_corrections_of_a_network_are_shares_of_its_forces_at_the_recorded_shaft_speed():
    model = series()
    nu, delta, n = number([0.4, 0.0, 0.0]), number(0.2), number(1.5)
    names = Corrections(model).names
    shares = number([1.0 if name == "Nrudder" else 0.0 for name in names])
    with torch.no_grad():
        rudder = calm_accelerations(model, nu, delta, n) - calm_accelerations(model, nu, number(0.0), n)
        added = calm_accelerations(Calibrated(model, shares), nu, delta, n) - calm_accelerations(model, nu, delta, n)
        row = Corrections(model)(nu, delta, n)[names.index("Nrudder")]
    of_yaw = model.hull.force_from_acceleration(rudder)[2]
    assert model.hull.force_from_acceleration(added).numpy() == approx([0.0, 0.0, float(of_yaw)])
    assert of_yaw == approx(-0.01 * 0.2 * 1.5**2) and row.numpy() == approx(added.numpy())


@pytest.mark.parametrize("n", [None, 1.2])
@pytest.mark.parametrize("name", [name for name in SHIPS if ship_named(name).table is not None])
def test_a_ship_with_corrections_moves_by_one_table_as_by_all_of_them_together(name, n):
    model, g = CalmWater(ship_named(name)), torch.Generator().manual_seed(3)
    corrections, rows = Corrections(model), 5
    units = model.hull.velocity_units * model.hull.velocity_units.new_tensor([1.0, 0.1, 0.2])
    ahead = units * number([1.0, 0.0, 0.0])
    nu = ahead + 0.3 * units * torch.randn(rows, 3, generator=g, dtype=torch.float64)
    delta = 0.3 * torch.randn(rows, generator=g, dtype=torch.float64)
    shaft = None if n is None else torch.full_like(delta, n)
    for own in ((), (rows,)):
        shares = 0.1 * torch.randn(*own, len(corrections.names), generator=g, dtype=torch.float64)
        corrected = Calibrated(model, shares)
        assert corrections.accelerations(shares) is not None
        added = calm_accelerations(corrected, nu, delta, shaft) - calm_accelerations(model, nu, delta, shaft)
        torch.testing.assert_close(added, corrections.together(nu, delta, shares, shaft), rtol=1e-9, atol=1e-12)


def test_a_shaft_ordered_otherwise_from_the_start_says_nothing_of_the_engine():
    falling, other = run(1.0), run(1.3)
    falling = falling.with_channels(shaft=np.linspace(1.0, 0.7, len(falling)))
    assert np.isfinite(measured(with_own_shafts([falling])[0])[:, N]).all()
    kept = with_own_shafts([falling, other])
    assert all(np.isnan(measured(r)[:, N]).all() and np.isfinite(measured(r)[:, :7]).all() for r in kept)
    assert kept[1]["shaft"] == approx(1.3)


def test_recorded_shaft_speeds_are_over_the_one_that_a_modular_ship_keeps_its_speed_with():
    ship = esso_osaka_mmg()
    nu, delta = number([ship.particulars.speed, 0.0, 0.0]), number(0.0)
    assert ship.particulars.rpm == approx(60 * ship.shaft)
    assert float(ship.force_at(nu, delta, number(ship.particulars.rpm / 60))[0]) == approx(0.0, abs=1e-12)
