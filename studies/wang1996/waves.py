"""Wang 1996, section 7.1: the sea, and what its pressure does to the hull."""

from dataclasses import replace
from math import pi

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import FRESH_WATER, GRAVITY
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.seakeeping.spectra import significant_height
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.section import Line, Panel, Plot
from studies.wang1996.offsets import wang_hull
from studies.wang1996.sway_yaw import COMPONENTS, PERIOD, SEA, hull, sea, to_heading

FREQUENCY, AMPLITUDE, ANGLE_DEG = 0.65, 0.503, 45.0
"""Component whose force Figs 7.3 and 7.4 show [rad/s, m, deg]: Wang 1996, section 7.1.2."""


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


def spectrum_values() -> dict[str, float]:
    """Section 7.1.1: height, period, amplitudes and length of the waves.

    Returns:
        Quantities by name.
    """
    waves = sea(1)
    return {
        "height": significant_height(SEA.moment(0)),
        "period": 2 * pi * SEA.moment(0) / SEA.moment(1),
        "height_of_components": significant_height(waves.moment(0)),
        "components": COMPONENTS,
        "amplitude": float(waves.amplitude[int(np.argmin(np.abs(waves.frequency - FREQUENCY)))]),
        "wave_length": GRAVITY * PERIOD**2 / (2 * pi),
    }


def force_values(ship: TaylorShip) -> dict[str, float]:
    """Section 7.1.2: hull, convention and wave forces.

    Args:
        ship: The Mariner.

    Returns:
        Quantities by name; forces [MN] and moments [MN m] in sea water, with ``fresh`` in fresh water.
    """
    p, immersed = ship.particulars, hull(ship)
    (force, moment), (beam_force, _) = force_amplitudes(ship, np.array([ANGLE_DEG, 90.0])) / 1e6
    shortest = 2 * pi * GRAVITY / sea(1).frequency[-1] ** 2
    fresh = FRESH_WATER / p.rho
    return {
        "beam": p.beam,
        "breadth": 2 * float(wang_hull().half_breadths.max()),
        "block_volume": p.block * p.length * p.beam * p.draught,
        "volume": immersed.volume,
        "met_at_0_deg": float(encounter_frequency(np.array(FREQUENCY), to_heading(0.0), p.speed)),
        "mean_length": 156 / p.length,
        "shortest_length": float(shortest / p.length),
        "force": float(force),
        "fresh_force": float(fresh * force),
        "moment": float(moment),
        "fresh_moment": float(fresh * moment),
        "beam_force": float(beam_force),
        "fresh_beam_force": float(fresh * beam_force),
        "largest_at": int(np.argmax(force_amplitudes(ship, np.arange(181.0))[:, 0])),
    }


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
