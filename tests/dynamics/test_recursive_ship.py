"""A ship that moves by a recursive network: dimensionless steps, closed loop, resampling there and back."""

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.course import TimeTable, course_of, start_speed
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.recursive import RecursiveShip, force_constants, joined_model, track_of
from manoeuvre_nn.network.perceptron import wang_network
from manoeuvre_nn.network.recursive import ForceSettings, RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner()
LENGTH, SPEED = SHIP.particulars.length, 7.0
FREEDOM = ("u", "v", "p", "r")


def recording(side=1.0, duration=200.0, speed=SPEED, **changes):
    """A smooth turn with roll, slower and slower; the mirror image with side -1."""
    t = np.arange(0.0, duration + 1e-9)
    turn = 0.5 * (1 + np.tanh((t - 60) / 15))
    u, v, r = speed * (1 - 0.3 * turn), -side * 0.12 * speed * turn, side * 0.011 * turn
    p = side * 0.01 * np.sin(0.3 * t)
    phi, psi = side * 0.01 / 0.3 * (1 - np.cos(0.3 * t)), np.concatenate([[0], np.cumsum((r[1:] + r[:-1]) / 2)])
    north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    x, y = (np.concatenate([[0], np.cumsum((c[1:] + c[:-1]) / 2)]) for c in (north, east))
    delta = side * 0.4 * np.clip((t - 40) / 10, 0, 1)
    n = np.full_like(t, 1.4)
    channels = dict(u=u, v=v, p=p, r=r, phi=phi, psi=psi, x=x, y=y, delta=delta, n=n)
    return Recording("turn", t, {**channels, **changes}, meta={})


def boat(seed=0, **settings):
    network = RecursiveNetwork(RecursiveSettings(**{"hidden": (9, 8), **settings}), seed=seed, dtype=torch.float64)
    return RecursiveShip(SHIP, network)


def fitted(recordings, **settings):
    """A ship whose network is scaled to recordings, its course and their steps."""
    model = boat(**settings)
    course = course_of(recordings, SHIP, model.network.settings.velocities, step=0.09, wind=model.network.settings.wind)
    steps = model.recorded(course)
    rows, k = (g.flatten() for g in torch.meshgrid(*map(torch.arange, steps.time.shape), indexing="ij"))
    start = steps.start(rows, k, 7)
    seen = model.network.join((steps.forces[rows, k], *start.forces), (start.velocities, start.before))
    model.network.scale_to(seen, start.velocities)
    return model, course, steps


def test_a_table_is_linear_between_samples_and_held_beyond_them():
    table = TimeTable(torch.tensor([[[0.0], [2.0], [3.0]], [[5.0], [5.0], [7.0]]]), torch.tensor([1.0, 0.5]))
    found = table.rows(torch.tensor([1, 0, 0])).at(torch.tensor([[0.75, 9.0], [0.5, 1.5], [-1.0, 2.0]]))
    assert found[..., 0].tolist() == [[6.0, 7.0], [1.0, 2.5], [0.0, 3.0]]


def test_steps_are_the_same_share_of_the_time_in_which_the_ship_sails_her_length():
    run = recording()
    course = course_of([run], SHIP, FREEDOM, step=0.09)
    seconds = course.steps(0.09)[0].numpy() * LENGTH / start_speed(run, SHIP)
    speed = np.interp(seconds, run.time, np.hypot(run["u"], run["v"]))
    assert np.diff(seconds) == pytest.approx(0.09 * LENGTH / speed[:-1], rel=1e-3)
    assert np.diff(seconds)[-1] > 1.3 * np.diff(seconds)[0]
    assert seconds[-1] + 0.09 * LENGTH / speed[-1] >= run.duration > seconds[-1]


def test_slow_runs_are_dimensionless_by_their_own_speed_and_runs_from_rest_by_the_ships():
    own = SHIP.particulars.speed
    assert start_speed(recording(speed=0.15 * own), SHIP) == pytest.approx(0.15 * own, rel=1e-3)
    assert start_speed(recording(speed=1e-3 * own), SHIP) == own


def test_resampled_to_steps_and_back_a_recording_is_itself():
    run = recording()
    model, course, steps = fitted([run])
    unit = LENGTH / start_speed(run, SHIP)
    seconds = steps.time[0].numpy() * unit
    for k, name in enumerate(FREEDOM):
        scale = start_speed(run, SHIP) if name in "uv" else 1 / unit
        inside = run.time[run.time <= seconds[-1]]
        back = CubicSpline(seconds, steps.velocities[0, :, k].numpy() * scale, axis=0)(inside)
        assert np.abs(back - run[name][: len(inside)]).max() < 1e-2 * np.ptp(run[name])
    track = track_of(steps.velocities, steps.angles[..., -1], steps.time)[0].numpy() * LENGTH
    assert np.hypot(*(track[-1] - [np.interp(seconds[-1], run.time, run[k]) for k in ("x", "y")])) < 0.002 * LENGTH
    assert steps.angles[0, :, 0].numpy() == pytest.approx(np.interp(seconds, run.time, run["phi"]), abs=2e-3)


def test_past_values_before_the_start_are_those_of_the_start():
    _, _, steps = fitted([recording()])
    start = steps.start(torch.tensor([0, 0]), torch.tensor([0, 3]), 7)
    assert all(torch.equal(past[0], steps.forces[0, 0]) for past in start.forces)
    for past, k in zip(start.forces, (2, 1, 0, 0, 0, 0, 0), strict=True):
        assert torch.equal(past[1], steps.forces[0, k])
    assert torch.equal(start.before[0], start.velocities[0])


@pytest.mark.parametrize("freedom", [3, 4])
def test_the_loop_is_the_network_fed_by_hand(freedom):
    model, course, steps = fitted([recording()], freedom=freedom)
    zero = torch.zeros(1, dtype=torch.long)
    start, look = steps.start(zero, zero, 7), course.controls.rows(zero)
    made = model.unroll(start, look.at, course.speed, 3)
    velocities, before, angles, time, past = start
    froude = model.froude(course.speed)
    for k in range(3):
        past = (model.forces(velocities, angles, look.at(time), froude), *past)
        new = model.network(model.network.join(past, (velocities, before)))
        step = 0.09 / velocities[0, :2].norm()
        turned = 0.5 * (velocities + new)[:, 2:]
        velocities, before, angles, time = new, velocities, angles + step * turned, time + step
        assert torch.allclose(made.velocities[:, k + 1], velocities) and torch.allclose(made.angles[:, k + 1], angles)
        assert torch.allclose(made.time[:, k + 1], time)


def test_a_ship_that_has_nearly_stopped_goes_on_by_steps_of_at_most_twenty_times_the_length():
    model, course, steps = fitted([recording()])
    zero = torch.zeros(2, dtype=torch.long)
    start, share = steps.start(zero, zero, 7), torch.tensor([[0.06], [1e-3]], dtype=torch.float64)
    slow = start._replace(velocities=start.velocities * share / start.velocities[:, :2].norm(dim=1, keepdim=True))
    made = model.unroll(slow, course.controls.rows(zero).at, course.speed[zero], 1)
    assert made.time.diff(dim=1)[:, 0].tolist() == pytest.approx([0.09 / 0.06, 20 * 0.09])


def test_a_network_that_predicts_velocities_goes_from_step_to_step_and_one_that_gives_forces_is_integrated():
    network, known, scaling = boat().network, clarke_part(SHIP), Scaling(torch.zeros(4), torch.ones(4), torch.ones(3))
    stepping = joined_model(SHIP, known, network, scaling)
    assert isinstance(stepping, RecursiveShip) and stepping.network is network
    assert isinstance(joined_model(SHIP, known, wang_network(3), scaling), IdentifiedShip)


def test_constants_of_the_forces_are_the_ships_over_powers_of_her_length():
    ship, water = SHIP.particulars, SHIP.particulars.rho
    made, air = force_constants(ship, ForceSettings()), ship.above_water
    lengths = [made.diameter, made.gm, made.wind_areas.lateral_centre, made.wind_areas.length_overall]
    assert [LENGTH * c for c in lengths] == pytest.approx([
        0.55 * ship.draught,
        ship.heeling.gm,
        air.lateral_centre,
        air.length_overall,
    ])
    areas = [2 * made.rudder_area, made.wind_areas.frontal, made.wind_areas.lateral]
    assert [LENGTH**2 * c for c in areas] == pytest.approx([
        ship.rudder_area_ratio * LENGTH * ship.draught,
        air.frontal,
        air.lateral,
    ])
    assert LENGTH**3 * made.volume == pytest.approx(ship.mass / water) and made.water == water


def test_gradients_of_the_unrolled_loop_are_those_of_its_differences():
    model, course, steps = fitted([recording()], hidden=(2, 2), past=2, symmetric=True, wind=False)
    at = torch.tensor([0, 0]), torch.tensor([0, 20])
    look = course.controls.rows(at[0])

    def outcome(*weights):
        for parameter, weight in zip(model.network.parameters(), weights, strict=True):
            parameter.data = weight.data
        saved = {name: w for (name, _), w in zip(model.named_parameters(), weights, strict=True)}
        call = torch.func.functional_call(_Unrolls(model), {f"model.{k}": w for k, w in saved.items()}, ())
        return call.velocities, call.angles, call.track

    class _Unrolls(torch.nn.Module):
        def __init__(self, inner):
            super().__init__()
            self.model = inner

        def forward(self):
            start = steps.start(*at, 2)
            return self.model.unroll(start, look.at, course.speed[at[0]], 3)

    weights = [w.detach().clone().requires_grad_() for w in model.network.parameters()]
    assert torch.autograd.gradcheck(outcome, weights, atol=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        {}, {"about_last": False}, {"symmetric": False}, {"biases": False}, {"wind": True}, {"freedom": 3},
        {"wind": True, "symmetric": False}, {"wind": True, "wind_nodes": True}, {"hidden": (6,)},
        {"past": 3, "past_thrust": 0},
    ],
    ids=str,
)  # fmt: skip
def test_the_gradient_by_the_adjoint_is_that_of_automatic_differentiation(settings):
    blown = recording(wind_speed=np.full(201, 15.0), wind_from=np.linspace(0.0, 1.0, 201))
    model, course, steps = fitted([blown, recording(-1.0)], **settings)
    if model.network.links is not None:
        model.network.links.data.fill_(0.3)
    rows, k = torch.tensor([0, 1, 0]), torch.tensor([0, 4, 33])
    start, look = steps.start(rows, k, model.network.settings.past), course.controls.rows(rows)

    def gradients(made):
        draw = torch.Generator().manual_seed(0)
        parts = made.velocities, made.angles, made.time, made.track
        total = sum((p * torch.randn(p.shape, generator=draw, dtype=p.dtype)).sum() for p in parts)
        return torch.autograd.grad(total, list(model.network.parameters()))

    passed, folded = [start], model.network.folded()
    for _ in range(12):
        controls = look.at(passed[-1].time)
        passed.append(model.advance(passed[-1], controls, model.froude(course.speed[rows]), folded))
    by_steps = gradients(model.joined(passed))
    for one, two in zip(gradients(model.unroll(start, look.at, course.speed[rows], 12)), by_steps, strict=True):
        assert torch.allclose(one, two, rtol=1e-9, atol=1e-11)


def test_the_mirrored_helm_gives_the_mirrored_run():
    model, course, steps = fitted([recording(1.0), recording(-1.0)])
    rows = torch.arange(2)
    made = model.unroll(steps.start(rows, 0 * rows, 7), course.controls.rows(rows).at, course.speed, 60)
    signs = model.network.output_signs
    assert torch.allclose(made.velocities[0], made.velocities[1] * signs, atol=1e-9)
    assert torch.allclose(made.track[0], made.track[1] * torch.tensor([1.0, -1.0]), atol=1e-9)


def test_both_sides_may_be_driven_apart():
    run = recording(delta_starboard=0.3 * np.ones(201), n_port=1.2 * np.ones(201))
    first = course_of([run], SHIP, FREEDOM, step=0.09).controls.values[0, 0]
    per = LENGTH / start_speed(run, SHIP)
    assert first.tolist() == pytest.approx([0.3, 0.0, 1.4 * per, 1.2 * per])


def test_the_wind_is_a_force_among_the_inputs():
    blown = recording(wind_speed=np.full(201, 15.0), wind_from=np.full(201, np.pi / 2))
    model, course, steps = fitted([blown, recording()], wind=True)
    k = [model.network.settings.columns.index(f"wind_{name}") for name in "XYN"]
    assert steps.forces[0, 0, k[1]] < 0  # from starboard
    assert steps.forces[1][:, k].abs().max() == 0.0


def test_a_recording_without_roll_needs_a_network_of_three_degrees_of_freedom():
    run = recording()
    flat = Recording("flat", run.time, {k: c for k, c in run.channels.items() if k not in {"p", "phi"}})
    with pytest.raises(InputError, match="network.freedom=3"):
        course_of([flat], SHIP, FREEDOM, step=0.09)
    assert course_of([flat], SHIP, ("u", "v", "r"), step=0.09).motion.values.shape[-1] == 6


def test_a_recursive_network_has_no_rate_of_state():
    with pytest.raises(InputError, match="step to step"):
        boat()(torch.zeros(1, 6), Inputs(torch.zeros(1)))
