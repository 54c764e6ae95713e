"""Wang 1996, section 7.1: the sea, and what its pressure does to the hull."""

from dataclasses import replace
from math import pi

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import FRESH_WATER, GRAVITY
from manoeuvre_nn.reproduction.section import Claim, Line, Panel, Plot, compared
from manoeuvre_nn.reproduction.wang1996_sway_yaw import COMPONENTS, SEA, hull, sea, to_heading
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.seakeeping.spectra import significant_height
from manoeuvre_nn.seakeeping.wang_offsets import wang_hull
from manoeuvre_nn.ship.taylor import TaylorShip

FREQUENCY, AMPLITUDE, ANGLE_DEG = 0.65, 0.503, 45.0
"""Component whose force Figs 7.3 and 7.4 show [rad/s, m, deg]: Wang 1996, section 7.1.2."""
LOST = "a curve; its values are lost in the scan"


def force_amplitudes(ship: TaylorShip, angles_deg: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "angles 2"]:
    """Amplitudes of the component's sway force and yaw moment.

    Args:
        ship: The Mariner.
        angles_deg: delta of the chapter [deg].

    Returns:
        Sway force [N] and yaw moment [N m].
    """
    immersed, rho = hull(ship), ship.particulars.rho
    answers = [sway_and_yaw(immersed, np.array([FREQUENCY]), to_heading(a), rho)[:, 0] for a in angles_deg.tolist()]
    return AMPLITUDE * np.abs(np.stack(answers))


def spectrum_claims() -> list[Claim]:
    """Section 7.1.1: height, period, amplitudes and length of the waves.

    Returns:
        The claims.
    """
    waves, length = sea(1), GRAVITY * SEA.period**2 / (2 * pi)
    at = int(np.argmin(np.abs(waves.frequency - FREQUENCY)))
    period = 2 * pi * SEA.moment(0) / SEA.moment(1)
    components = significant_height(waves.moment(0))
    where = "Section 7.1.1"
    return [
        compared(where, "significant height of the spectrum", SEA.height, significant_height(SEA.moment(0)),
                 within=0.005, unit="m"),
        compared(where, "mean period of the spectrum", SEA.period, period, within=0.005, unit="s"),
        compared(where, f"significant height of {COMPONENTS} waves", SEA.height, components, within=0.01,
                 direction=True, why="the band from .3 to 1.25 rad/s leaves the short waves out", unit="m"),
        compared(where, "amplitude at .65 rad/s", AMPLITUDE, float(waves.amplitude[at]), within=5e-4, unit="m"),
        compared("Eq 7.9", "wave length at the mean period", 156.0, length, within=0.5, unit="m"),
    ]  # fmt: skip


def force_claims(ship: TaylorShip) -> list[Claim]:
    """Section 7.1.2: hull, convention and wave forces.

    Args:
        ship: The Mariner.

    Returns:
        The claims.
    """
    p, immersed = ship.particulars, hull(ship)
    head = float(encounter_frequency(np.array(FREQUENCY), to_heading(0.0), p.speed))
    (force, moment), (beam_force, _) = force_amplitudes(ship, np.array([ANGLE_DEG, 90.0]))
    largest = int(np.argmax(force_amplitudes(ship, np.arange(181.0))[:, 0]))
    shortest = 2 * pi * GRAVITY / sea(1).frequency[-1] ** 2
    fresh = FRESH_WATER / p.rho
    water = f"sea water is taken, which the text does not name; in fresh water it is {fresh * force / 1e6:.2f} MN"
    where = "Tables 7.1, 7.2"
    return [
        compared(where, "largest breadth, beside Table 3.1", p.beam, 2 * float(wang_hull().half_breadths.max()),
                 relative=0.01, why="the offsets are those of a beamier ship", unit="m"),
        compared(where, "displaced volume, beside Table 3.1", p.block * p.length * p.beam * p.draught, immersed.volume,
                 relative=0.01, why="the offsets are those of a beamier and finer ship", unit="m^3"),
        Claim("Eqs 7.10-7.14", "meaning of the angle", "between the heading and the direction the waves run to",
              f"at 0 deg a wave of .65 rad/s is met at {head:.3f} rad/s: it comes from ahead", "does not hold",
              "the equations give the angle that the waves come from"),
        Claim("Section 7.1.2", "waves long enough for the Froude-Krylov force", "mean length 156 m",
              f"{156 / p.length:.2f} L; the shortest wave is {shortest / p.length:.2f} L", "not comparable",
              "no bound is given; waves of a quarter of the length are not long"),
        Claim("Fig 7.3", "sway force, 45 deg", LOST, force / 1e6, "not comparable", water, "MN"),
        Claim("Fig 7.4", "yaw moment, 45 deg", LOST, moment / 1e6, "not comparable",
              f"in fresh water {fresh * moment / 1e6:.1f} MN m", "MN m"),
        Claim("Fig 7.5", "largest sway force over the angle", LOST, beam_force / 1e6, "not comparable",
              f"at {largest} deg; in fresh water {fresh * beam_force / 1e6:.2f} MN", "MN"),
    ]  # fmt: skip


def spectrum_plot() -> Plot:
    """Fig 7.1.

    Returns:
        The figure.
    """
    frequency, waves = np.linspace(0.2, 2.0, 181), sea(1)
    lines = [
        Line("ITTC spectrum", frequency, SEA.density(frequency)),
        Line("components", waves.frequency, SEA.density(waves.frequency), role="other", points=True),
    ]
    panel = Panel("wave frequency [rad/s]", "S [m^2 s]", lines)
    return Plot("figure_7_1", "Fig 7.1: ITTC spectrum, 5 m and 10 s, with the 20 waves of the random sea", [panel])


def history_plots(ship: TaylorShip) -> list[Plot]:
    """Figs 7.3 and 7.4.

    Args:
        ship: The Mariner.

    Returns:
        The figures.
    """
    time, heading, p = np.linspace(0, 60, 601), to_heading(ANGLE_DEG), ship.particulars
    one = replace(sea(1), frequency=np.array([FREQUENCY]), amplitude=np.array([AMPLITUDE]), phase=np.zeros((1, 1)))
    transfer = sway_and_yaw(hull(ship), one.frequency, heading, p.rho)
    met = encounter_frequency(one.frequency, heading, p.speed)
    names = [
        ("figure_7_3", "Fig 7.3: wave force", "sway force [MN]"),
        ("figure_7_4", "Fig 7.4: wave moment", "yaw moment [MN m]"),
    ]
    plots = []
    for (name, what, label), h in zip(names, transfer, strict=True):
        lines = [Line("", time, one.record(time, h, met)[0] / 1e6)]
        plots.append(Plot(name, f"{what} of a wave of .503 m and .65 rad/s, 45 deg", [Panel("time [s]", label, lines)]))
    return plots


def amplitude_plots(ship: TaylorShip) -> list[Plot]:
    """Figs 7.5 and 7.6.

    Args:
        ship: The Mariner.

    Returns:
        The figures.
    """
    angles = np.linspace(0, 180, 181)
    amplitudes = force_amplitudes(ship, angles) / 1e6
    names = [
        ("figure_7_5", "Fig 7.5: sway force", "amplitude [MN]"),
        ("figure_7_6", "Fig 7.6: yaw moment", "amplitude [MN m]"),
    ]
    return [
        Plot(name, f"{what} over the direction that the waves come from, .503 m and .65 rad/s",
             [Panel("angle [deg]", label, [Line("", angles, column)])])
        for (name, what, label), column in zip(names, amplitudes.T, strict=True)
    ]  # fmt: skip


def offsets_plot(ship: TaylorShip) -> Plot:
    """Tables 7.1 and 7.2, as a body plan below the 40-ft waterline.

    Args:
        ship: The Mariner.

    Returns:
        The figure.
    """
    table = wang_hull(ship.particulars.length)
    lines = [
        Line("", half if x > 0 else -half, table.waterlines, role="reference")
        for x, half in zip(table.stations, table.half_breadths, strict=True)
    ]
    panel = Panel("half-breadth, fore body right [m]", "height above the base line [m]", lines, equal=True)
    return Plot("tables_7_1_and_7_2", "Tables 7.1 and 7.2: body plan of the offsets", [panel])


def force_table(ship: TaylorShip) -> list[dict[str, float]]:
    """Amplitudes of the component's force and moment over the angle.

    Args:
        ship: The Mariner.

    Returns:
        Rows.
    """
    angles = np.arange(0.0, 181.0, 15.0)
    rows = force_amplitudes(ship, angles) / 1e6
    return [
        {"angle [deg]": float(a), "sway force [MN]": float(y), "yaw moment [MN m]": float(n)}
        for a, (y, n) in zip(angles, rows, strict=True)
    ]
