"""Heave and pitch of a ship with speed in regular waves: zero-speed potentials and the speed terms of strip theory."""

import numpy as np
from jaxtyping import Complex, Float

from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency
from manoeuvre_nn.seakeeping.radiation import Radiation

MIN_ENCOUNTER = 1e-3
"""Least frequency of encounter [rad/s]: forces are finite where the waves keep up with the ship, 1/w is not."""


def heave_and_pitch(
    radiation: Radiation, frequency: Float[np.ndarray, " waves"], speed: float, heading: float
) -> Complex[np.ndarray, "waves 2"]:
    """Transfer functions of heave and pitch at any speed and heading; the ship is free to surge.

    ``[-w^2 M - T + C] x = F`` at the frequency of encounter w, with T of :func:`radiated_forces`, F of
    :func:`wave_forces`. Where the ship overtakes the waves w is below 0: the same equations with -w and the complex
    conjugate of the wave.

    Args:
        radiation: Potentials at zero speed.
        frequency: Wave frequencies [rad/s].
        speed: Speed U [m/s].
        heading: Direction that the waves run to, off the bow [rad]: 0 following, pi head sea.

    Returns:
        Heave up [m/m] and pitch bow up [rad/m]: complex amplitudes H of ``Re[H exp(i w t)]`` with a crest of 1 m at
        the centre of gravity at time 0.

    Source:
        Salvesen, Tuck & Faltinsen 1970, "Ship motions and sea loads", Trans. SNAME 78, without end terms.
    """
    hull, encounter = radiation.hull, encounter_frequency(frequency, heading, speed)
    met = np.maximum(np.abs(encounter), MIN_ENCOUNTER)
    inertia = met[:, None, None] ** 2 * hull.mass
    impedance = hull.restoring - inertia - radiated_forces(radiation, met, speed)
    forces = wave_forces(radiation, frequency, speed, heading)
    answer = np.linalg.solve(impedance, forces[:, :, None])[:, 1:, 0]
    return np.where(encounter[:, None] < 0, answer.conj(), answer) * [1.0, -1.0]


def radiated_forces(
    radiation: Radiation, encounter: Float[np.ndarray, " waves"], speed: float
) -> Complex[np.ndarray, "waves 3 3"]:
    """Forces of the water on a ship that moves by 1 m or 1 rad in surge, heave and pitch.

    At zero speed ``T = w^2 A - i w B``. The steady flow is taken to pass the hull undisturbed, so that pitch adds U
    times the potential of heave; with q = U/(i w)::

        T_j5 = T_j5 + q T_j3,  T_5j = T_5j - q T_3j  for j = 1, 3;  T_55 = T_55 + q (T_53 - T_35) - q^2 T_33

    Args:
        radiation: Potentials at zero speed.
        encounter: Frequencies of encounter w [rad/s], above 0.
        speed: Speed U [m/s].

    Returns:
        T, rows the forces [N, N, N m]; pitch bow down.

    Source:
        Salvesen, Tuck & Faltinsen 1970, coefficients without end terms; integrals over the hull take the place of those
        over strips.
    """
    w, q = encounter[:, None, None], (speed / (1j * encounter))[:, None]
    forces = w**2 * radiation.forces_at(encounter)
    # first the column, then the row: so the last diagonal element gets its three terms
    forces[:, :, 2] += q * forces[:, :, 1]
    forces[:, 2, :] -= q * forces[:, 1, :]
    return np.asarray(forces)


def wave_forces(
    radiation: Radiation, frequency: Float[np.ndarray, " waves"], speed: float, heading: float
) -> Complex[np.ndarray, "waves 3"]:
    """Forces of waves of 1 m on the ship: Froude-Krylov, and diffraction by Haskind's relation.

    The wave ``p = rho g e^(k z - i k (x cos m + y sin m))`` has the potential ``phi_0 = i p/(rho w_0)``. Diffraction
    needs no potential of its own, and pitch adds the same term of speed as in :func:`radiated_forces`::

        F_j^D = - i w rho int phi_j dphi_0/dn dS,  F_5^D = F_5^D - q F_3^D

    Args:
        radiation: Potentials at zero speed.
        frequency: Wave frequencies w_0 [rad/s].
        speed: Speed [m/s].
        heading: Direction m that the waves run to, off the bow [rad].

    Returns:
        Surge, heave [N/m] and pitch, bow down [N m/m]; of the conjugate wave where the ship overtakes it.

    Source:
        Salvesen, Tuck & Faltinsen 1970, exciting forces without end terms.
    """
    hull, k = radiation.hull, (frequency**2 / GRAVITY)[:, None]
    encounter = encounter_frequency(frequency, heading, speed)
    met, overtaken = np.maximum(np.abs(encounter), MIN_ENCOUNTER), encounter < 0
    x, y, z = (hull.centre - [hull.buoyancy[0], 0.0, 0.0]).T
    # sections of a long cylinder have no normal ahead: their surge mode is 0
    (normal_x, normal_z, _), normal_y = radiation.modes, hull.directed_area[:, 1]
    along, across = np.cos(heading), np.sin(heading)
    # port and starboard are added: e^(-i a) + e^(i a) = 2 cos a
    wave, side = 2 * np.exp(k * (z - 1j * along * x)), k * across * y
    pressure = hull.rho * GRAVITY * wave * np.cos(side)
    # k (n_z - i n_x cos m - i n_y sin m) e^(k z - i k (..)) times i g/w_0
    flow = np.cos(side) * (normal_z - 1j * along * normal_x) - np.sin(side) * across * normal_y
    flow = 1j * GRAVITY * k / frequency[:, None] * wave * flow
    pressure[overtaken], flow[overtaken] = pressure[overtaken].conj(), flow[overtaken].conj()
    diffracted = -1j * met[:, None] * hull.rho * radiation.work_on(flow, met)
    diffracted[:, 2] -= speed / (1j * met) * diffracted[:, 1]
    return np.asarray(diffracted - pressure @ hull.modes.T)
