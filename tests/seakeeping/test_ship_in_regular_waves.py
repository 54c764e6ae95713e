"""Heave and pitch of a ship with speed in regular waves, by strips and by the boundary element method."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY, KNOT
from manoeuvre_nn.seakeeping.form import S175, HullForm
from manoeuvre_nn.seakeeping.motions import heave_and_pitch, radiated_forces, wave_forces
from manoeuvre_nn.seakeeping.panels import panelled
from manoeuvre_nn.seakeeping.radiation import radiate
from manoeuvre_nn.seakeeping.strips import radiate_strips

BALANCED = HullForm(175.0, 25.4, 9.5, 0.6, 0.75, 0.97, 0.0, 0.0, 0.25, 9.5)
"""Fore and after body alike."""
FORMS = {"S-175": S175, "balanced": BALANCED}
COARSE = np.array([0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0])
WAVE = np.array([0.3, 0.45, 0.6, 0.75])


@cache
def radiation(method, name="S-175"):
    if method == "strips":
        return radiate_strips(panelled(FORMS[name], 9.5, 28, 10), COARSE)
    pytest.importorskip("capytaine")
    return radiate(panelled(FORMS[name], 9.5, 18, 4), COARSE)


methods = pytest.mark.parametrize("method", ["strips", "panels"])
SYMMETRY = {"strips": 1e-9, "panels": 0.015}
"""Share of the response by which a coarse mesh may break a symmetry: panels that are not quite plane do."""


@methods
@pytest.mark.parametrize("heading", [0.0, 0.7, 2.4, np.pi])
@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_on_long_waves_the_ship_follows_surface_and_slope(method, heading, speed):
    frequency = 0.02
    heave, pitch = heave_and_pitch(radiation(method), np.array([frequency]), speed, heading)[0]
    assert heave == approx(1.0, abs=3e-3)
    # crest at G at time 0: a quarter of a period later that of waves from astern is ahead and lifts the bow
    slope = -1j * frequency**2 / GRAVITY * np.cos(heading)
    assert pitch == approx(slope, abs=0.04 * abs(slope))
    assert pitch.imag == approx(slope.imag, rel=0.01)


@methods
def test_in_head_and_following_seas_at_rest_a_balanced_ship_moves_alike(method):
    ahead, astern = (heave_and_pitch(radiation(method, "balanced"), WAVE, 0.0, h) for h in (np.pi - 0.3, 0.3))
    assert np.all(np.abs(ahead - astern * [1.0, -1.0]) <= SYMMETRY[method] * np.abs(ahead))


@methods
def test_in_beam_seas_a_balanced_ship_does_not_pitch(method):
    heave, pitch = heave_and_pitch(radiation(method, "balanced"), WAVE, 0.0, np.pi / 2).T
    assert np.all(np.abs(pitch) <= SYMMETRY[method] * WAVE**2 / GRAVITY)
    assert np.abs(heave).min() > 0.1


@methods
def test_waves_from_port_and_starboard_do_the_same(method):
    one, other = (heave_and_pitch(radiation(method), WAVE, 8.0, h) for h in (2.0, -2.0))
    np.testing.assert_allclose(one, other)


@methods
def test_heave_acts_on_pitch_as_pitch_on_heave_at_zero_speed(method):
    r = radiation(method)
    scale = np.sqrt(r.added_mass[:, 1, 1] * r.added_mass[:, 2, 2])
    for matrix in (r.added_mass, r.damping / COARSE[:, None, None]):
        assert np.all(np.abs(matrix[:, 1, 2] - matrix[:, 2, 1]) < 0.02 * scale)
    balanced = radiation(method, "balanced").added_mass
    scale = np.sqrt(balanced[:, 1, 1] * balanced[:, 2, 2])
    assert np.all(np.abs(balanced[:, 1, 2]) <= SYMMETRY[method] * scale)


@methods
def test_damping_takes_energy_out_in_every_mode(method):
    damping = radiation(method).damping[2:11, 1:, 1:]
    assert np.linalg.eigvalsh(damping + damping.transpose(0, 2, 1)).min() > 0


@methods
def test_speed_couples_heave_and_pitch_as_the_source_says(method):
    # A35 - U B33/w^2, B35 + U A33, A53 + U B33/w^2, B53 - U A33, A55 + U^2 A33/w^2, B55 + U^2 B33/w^2
    r, speed = radiation(method), 9.0
    at = slice(3, 9)
    w, a, b = COARSE[at], r.added_mass[at, 1:, 1:].copy(), r.damping[at, 1:, 1:].copy()
    cross_a, cross_b = a[:, 0, 1] - a[:, 1, 0], b[:, 0, 1] - b[:, 1, 0]  # 0 but for the coarse panels
    a33, b33 = a[:, 0, 0].copy(), b[:, 0, 0].copy()
    a[:, 0, 1] -= speed * b33 / w**2
    b[:, 0, 1] += speed * a33
    a[:, 1, 0] += speed * b33 / w**2
    b[:, 1, 0] -= speed * a33
    a[:, 1, 1] += speed**2 * a33 / w**2 + speed / w**2 * cross_b
    b[:, 1, 1] += speed**2 * b33 / w**2 - speed * cross_a
    expected = w[:, None, None] ** 2 * a - 1j * w[:, None, None] * b
    np.testing.assert_allclose(radiated_forces(r, w, speed)[:, 1:, 1:], expected, rtol=1e-9)


def test_waves_radiated_to_all_sides_carry_off_the_work_of_the_damping():
    # Haskind and Newman: B_jj = w k/(4 pi rho g^2) int_0^2pi |X_j|^2 dbeta, at zero speed
    r = radiation("panels")
    for at in (5, 7):
        omega = COARSE[at : at + 1]
        forces = np.stack([wave_forces(r, omega, 0.0, h)[0] for h in np.linspace(0, np.pi, 91)])
        around = 2 * np.trapezoid(np.abs(forces) ** 2, np.linspace(0, np.pi, 91), axis=0)
        expected = omega**3 / (4 * np.pi * r.hull.rho * GRAVITY**3) * around
        np.testing.assert_allclose(np.diagonal(r.damping[at])[1:], expected[1:], rtol=0.05)


@pytest.mark.parametrize("heading", [0.6, np.pi])
def test_haskind_s_forces_are_those_of_the_diffraction_problem(heading):
    capytaine = pytest.importorskip("capytaine")
    r, omega = radiation("panels"), 0.6
    hull = r.hull
    mesh = capytaine.ReflectionSymmetricMesh(capytaine.Mesh(hull.vertices.reshape(-1, 3), hull.faces), plane="xOz")
    body = capytaine.FloatingBody(mesh=mesh, lid_mesh=mesh.generate_lid(z=0.0, faces_max_radius=3.0))
    x, _, z = (mesh.faces_centers - [hull.buoyancy[0], 0.0, hull.weight_depth]).T
    none = 0 * x
    body.dofs = {"heave": np.stack([none, none, none + 1], 1), "pitch": np.stack([z, none, -x], 1)}
    problem = capytaine.DiffractionProblem(
        body=body, omega=omega, wave_direction=heading, rho=hull.rho, g=GRAVITY, water_depth=np.inf
    )
    solved = capytaine.BEMSolver().solve(problem)
    direct = [solved.forces[m] + capytaine.bem.airy_waves.froude_krylov_force(problem)[m] for m in body.dofs]
    # phases there are about midship and time runs the other way
    direct = np.conj(np.array(direct) * np.exp(-1j * omega**2 / GRAVITY * hull.buoyancy[0] * np.cos(heading)))
    ours = wave_forces(r, np.array([omega]), 0.0, heading)[0, 1:]
    assert np.all(np.abs(ours - direct) < 0.02 * np.abs(direct))


@methods
def test_head_seas_at_speed_are_met_at_a_higher_frequency(method):
    # the same long waves shake the ship near its natural period only when it runs into them
    wave, speed = np.array([0.5]), 20 * KNOT
    ahead, rest, astern = (
        abs(heave_and_pitch(radiation(method), wave, u, h)[0, 0])
        for u, h in ((speed, np.pi), (0.0, np.pi), (speed, 0.0))
    )
    assert ahead > 1.5 * rest > 1.5 * astern


@methods
def test_the_answer_is_smooth_where_the_ship_begins_to_overtake_the_waves(method):
    speed = 20 * KNOT
    meeting = GRAVITY / speed  # encounter frequency 0 in following seas
    answer = heave_and_pitch(radiation(method), meeting * np.linspace(0.99, 1.01, 5), speed, 0.0)
    step = np.abs(answer[0] - answer[-1])
    assert step[0] < 0.012
    assert step[1] < 0.012 * meeting**2 / GRAVITY


# Pitch over wave slope by another strip theory: S-175, design waterline, VERES 4.02.3 (ShipX), heave and pitch of the
# file HYDRO/vessels_shipx/s175/s175.re1 of the MSS toolbox (Fossen & Perez, MIT licence). Its longest waves stand at
# 1.02: that much is a matter of its hull and weights.
VERES_WAVE = np.array([
    0.2094395,
    0.3141593,
    0.3926991,
    0.4487990,
    0.5026549,
    0.5463639,
    0.5983986,
    0.6283185,
    0.6981317,
])
VERES_PITCH = {
    (0.0, 180): [1.026, 1.004, 0.952, 0.885, 0.792, 0.694, 0.553, 0.463, 0.239],
    (20.0, 180): [1.044, 1.103, 1.159, 1.198, 1.206, 1.138, 0.700, 0.412, 0.079],
    (20.0, 0): [1.008, 0.925, 0.811, 0.700, 0.574, 0.463, 0.330, 0.257, 0.112],
}


@pytest.mark.parametrize("method, tolerance", [("strips", 0.05), ("panels", 0.11)])
@pytest.mark.parametrize("condition", VERES_PITCH)
def test_pitch_of_the_s175_is_that_of_an_independent_program(method, tolerance, condition):
    speed, heading = condition[0] * KNOT, np.deg2rad(float(condition[1]))
    pitch = np.abs(heave_and_pitch(radiation(method), VERES_WAVE, speed, heading)[:, 1])
    np.testing.assert_allclose(pitch * GRAVITY / VERES_WAVE**2, VERES_PITCH[condition], atol=tolerance)


def test_without_capytaine_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "capytaine", None)
    with pytest.raises(InputError, match=r"pip install 'manoeuvre-nn\[seakeeping\]'"):
        radiate(panelled(S175, 9.5, 8, 3), COARSE)


def test_capytaine_says_nothing_and_leaves_the_log_alone():
    pytest.importorskip("capytaine")
    program = """
import logging
import numpy as np
from manoeuvre_nn.seakeeping.form import S175
from manoeuvre_nn.seakeeping.panels import panelled
from manoeuvre_nn.seakeeping.radiation import radiate
radiate(panelled(S175, 9.5, 8, 3), np.array([0.5, 3.0]))
assert logging.getLogger().handlers == []
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
