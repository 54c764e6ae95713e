"""Models that are driven by the recorded shaft speed and wind."""

import numpy as np
import pytest
import torch

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.members import replay_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.recorded_inputs import step_inputs
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.estimation.coefficient_forces import series_forces
from manoeuvre_nn.estimation.coefficient_priors import series_prior
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_model
from manoeuvre_nn.ship.known import clarke_inertia_part
from manoeuvre_nn.training.scalings import approach_scaling

SHIP = esso_osaka_model()
TERMS = {
    "surge": ["u u", "u n", "n n", "v r", "d d n n"], "lateral": ["u v", "u r", "d n n"],
    "wind_surge": ["wx |w|"], "wind_lateral": ["wy |w|", "wx wy"],
}  # fmt: skip


def model(members=1, values=None):
    known, series = clarke_inertia_part(SHIP), Series(SeriesSettings(**TERMS, members=members))
    mean, _ = series_prior(series.names, SHIP)
    count = len(mean)
    spread = 1e-9 * torch.eye(count, dtype=torch.float64) if members > 1 else torch.zeros(count, count).double()
    series.take(torch.as_tensor(mean if values is None else values), spread)
    return IdentifiedShip(known, series, approach_scaling(known))


def run(n=12.0, wind=0.0, origin=0.0, rudder=0.0, seconds=60.0):
    time = np.arange(0, seconds, 0.2)
    flat = np.zeros_like(time)
    channels = {"u": flat + 0.4, "v": flat, "r": flat, "x": 0.4 * time, "y": flat, "psi": flat, "delta": flat + rudder}
    driving = {"n": flat + n, "wind_speed": flat + wind, "wind_from": flat + origin}
    return Recording("run", time, {**channels, **driving}, meta={"kind": "straight"})


def test_at_the_nominal_shaft_speed_in_calm_the_ship_keeps_its_speed():
    (made,) = replay(model(), [run()])
    np.testing.assert_allclose(made["u"], 0.4, atol=5e-3)
    assert np.abs(made["v"]).max() < 1e-9


def test_a_faster_shaft_drives_a_faster_ship_and_rows_have_their_own():
    slow, fast, alone = (*replay(model(), [run(n=9.0), run(n=15.0)]), *replay(model(), [run(n=15.0)]))
    assert slow["u"][-1] < 0.38 < 0.42 < fast["u"][-1]
    np.testing.assert_allclose(fast["u"], alone["u"], atol=1e-12)
    assert "udot" in fast.channels and fast["udot"][1] > 0 > slow["udot"][1]


def test_wind_on_the_beam_pushes_to_leeward_and_mirrored_wind_to_the_other_side():
    starboard, port = replay(model(), [run(wind=3.0, origin=a, seconds=9.0) for a in (np.pi / 2, -np.pi / 2)])
    assert starboard["y"][-1] < -0.01
    np.testing.assert_allclose(starboard["y"], -port["y"], atol=1e-9)


@pytest.mark.slow
def test_members_are_driven_like_the_model():
    ((first, *others),) = replay_members(model(members=4), [run(n=15.0, wind=2.0, origin=1.0)])
    (made,) = replay(model(members=4), [run(n=15.0, wind=2.0, origin=1.0)])
    np.testing.assert_allclose(first["u"], made["u"], atol=1e-12)
    assert all(np.abs(o["u"] - made["u"]).max() > 1e-6 for o in others)


def test_inputs_of_a_step_within_a_sample_are_linear_there():
    columns = torch.arange(12.0, dtype=torch.float64).view(3, 2, 2)
    named = dict(zip(("delta", "shaft", "wind_north"), columns, strict=True))
    first, second = step_inputs(named, np.array([0.0, 0.5, 1.0]), interval=2.0, start=1.0)
    for inputs, share in zip((*first, *second), (0.0, 0.25, 0.5, 0.5, 0.75, 1.0), strict=True):
        given = inputs.given
        assert (given.pop("time") == 1.0 + 2.0 * share).all() and list(given) == ["delta", "shaft", "wind_north"]
        np.testing.assert_allclose(torch.stack(list(given.values())), columns[..., 0] + share, atol=1e-12)


def test_inputs_of_a_step_over_several_samples_have_the_mean_and_moments_of_their_broken_line():
    """Means of c, c s and c s^2 over each step of 3 and of 2 samples, by a sum over many points and by the parabola."""
    samples = np.array([0.3, 0.1, -0.4, -0.4, 0.2, 0.25])
    made = step_inputs({"delta": torch.tensor(samples)[None]}, np.array([0.0, 3.0, 5.0]), interval=2.0, start=10.0)
    for inputs, (begin, end) in zip(made, ((0, 3), (3, 5)), strict=True):
        assert [float(i.time[0]) for i in inputs] == [10 + 2 * begin, 10 + begin + end, 10 + 2 * end]
        s = (np.arange(300000) + 0.5) / 150000 - 1
        line = np.interp(0.5 * (begin + end) + 0.5 * (end - begin) * s, np.arange(6), samples)
        low, mid, high = (float(i.delta[0]) for i in inputs)
        parabola = mid + 0.5 * (high - low) * s + (0.5 * (high + low) - mid) * s**2
        for power in range(3):
            assert np.mean(line * s**power) == pytest.approx(np.mean(parabola * s**power), abs=1e-9)


def test_columns_times_coefficients_are_the_models_accelerations():
    made = model()
    rng = np.random.default_rng(0)
    values = rng.standard_normal(len(made.network.names))
    made, state = model(values=values), np.column_stack([rng.random((7, 3)), np.zeros((7, 2)), rng.random(7)])
    inputs = {k: rng.random(7) for k in ("delta", "n", "wind_north", "wind_east")}
    columns = series_forces(made).columns(state, inputs)
    scaled = {"delta": inputs["delta"], "shaft": inputs["n"]}
    scaled |= {k: 0.4 * inputs[k] for k in ("wind_north", "wind_east")}
    units = np.array([0.4, 0.4, 0.4 / 3, 3, 3, 1])
    si = torch.as_tensor(state * units)
    rate = made(si, Inputs(**{k: torch.as_tensor(v) for k, v in scaled.items()})).detach().numpy()
    scale = 0.4**2 / 3 * np.array([1, 1, 1 / 3])
    np.testing.assert_allclose(columns @ values * scale, rate[:, :3], rtol=1e-9)


def test_what_is_known_before_any_run_is_clarkes_on_the_approach():
    names = [(1, "u v"), (1, "n v"), (2, "d n n"), (2, "d u n"), (1, "u r"), (0, "u u"), (0, "u n"), (0, "n n")]
    mean, spread = series_prior(names, SHIP, relative=0.5, size=1e-9)
    d = clarke_derivatives(SHIP)
    assert mean[0] + mean[1] == pytest.approx(d["Yv"])
    assert mean[2] + mean[3] == pytest.approx(-d["Nd"])
    assert mean[4] == pytest.approx(d["Yr"] - 2 * SHIP.block * SHIP.beam / SHIP.length)
    assert mean[5:].sum() == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(spread, 0.5 * np.abs(mean), rtol=1e-6)
