"""What is marked on a track: ships to scale with their rudder, where it was laid over, winds and currents."""

from collections.abc import Mapping
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import LEAST_RUDDER
from manoeuvre_nn.report.chart import Arrow, Curve, Mark, along
from manoeuvre_nn.report.style import COLOURS

STARBOARD, PORT = "#00694A", "#B3261E"
"""Colours of the ship's sides, as its lights have them."""
WIND, CURRENT = "#56616E", COLOURS[1]
BREADTH = 0.16
"""B/L of a ship of which no beam is known [-]."""
BLADE = 0.08
"""Length of the rudder's blade over L, about four times a usual one [-]."""
MAX_RUDDER_MARKS = 8
"""A helm that is moved more often is not marked."""

Track = Float[np.ndarray, "_ 2"]
"""Places (east, north)."""


def ships(
    run: Recording,
    track: Track,
    times: Float[np.ndarray, " k"],
    dimensions: tuple[float, float],
    style: Mapping[str, Any],
) -> Curve:
    """Outlines of the ship at some times.

    Args:
        run: The run, with heading and rudder.
        track: Where it was (east, north).
        times: When [s]; times after its end are left out.
        dimensions: Length and beam, in the unit of the track.
        style: Of its curve.

    Returns:
        One filled curve.
    """
    shapes = [np.empty((0, 2))]
    for time in times[times <= run.time[-1] + 1e-9]:
        *place, psi, delta = (np.interp(time, run.time, column) for column in (*track.T, run["psi"], run["delta"]))
        shape = np.array(place) + ship_shape(psi, delta, *dimensions)
        if np.isfinite(shape).all():  # not in a gap
            shapes += [shape, np.full((1, 2), np.nan)]
    look = {"facecolor": style["color"], "alpha": 0.35, "edgecolor": style["color"], "linewidth": 0.8}
    return along(np.concatenate(shapes), look, filled=True)


def ship_shape(psi: float, delta: float = 0.0, length: float = 1.0, beam: float = BREADTH) -> Track:
    """Corners of a ship with its rudder, seen from above.

    Args:
        psi: Heading [rad].
        delta: Rudder angle, positive to starboard [rad]: the blade points there, longer than it is, to be seen.
        length: L.
        beam: B.

    Returns:
        Corners (east, north) from midship; the bow is the third.
    """
    blade = (-0.5 - BLADE * np.cos(delta), BLADE * length / beam * np.sin(delta))
    corners = [(-0.5, -0.5), (0.25, -0.5), (0.5, 0.0), (0.25, 0.5), (-0.5, 0.5), (-0.5, 0.0), blade, (-0.5, 0.0)]
    ahead, abeam = np.array(corners).T * [[length], [beam]]
    cos, sin = np.cos(psi), np.sin(psi)
    return np.stack([ahead * sin + abeam * cos, ahead * cos - abeam * sin], axis=-1)


def rudder_marks(run: Recording, track: Track) -> list[Mark]:
    """Where the rudder was laid over to a side: a triangle of its light's colour, and the angle that it went to."""
    delta = np.nan_to_num(run["delta"])
    side = np.where(np.abs(delta) > max(0.5 * np.abs(delta).max(), LEAST_RUDDER), np.sign(delta), 0.0)
    over = np.flatnonzero(side)
    starts = over[np.flatnonzero(np.diff(side[over], prepend=0.0))]
    if len(starts) > MAX_RUDDER_MARKS:
        return []
    marks = []
    for start, stop in pairwise([*starts.tolist(), len(delta)]):
        symbol, name, colour = (">", "starboard", STARBOARD) if side[start] > 0 else ("<", "port", PORT)
        angle = np.abs(delta[start:stop][side[start:stop] == side[start]]).max() / DEGREE
        east, north = track[start].tolist()
        place = _outside(float(run["psi"][start]), side[start])
        marks.append(Mark(east, north, f"δ {angle:.0f}° {name}", symbol, colour, place))
    return marks


def _outside(psi: float, side: float) -> str:
    """Where a word stands off the track: above or below, on the outer side of the turn, if the ship heads across."""
    east, north = -side * np.cos(psi), side * np.sin(psi)
    # To the left it would stand on the axis of a narrow panel.
    return f"{'bottom' if north < 0 else 'top'} {'center' if abs(east) < np.sin(pi / 4) - 1e-9 else 'right'}"


def recorded_wind(run: Recording) -> list[Arrow]:
    """The mean of a recorded wind, where there is one."""
    if not {"wind_speed", "wind_from"} <= set(run.channels):
        return []
    mean = complex(np.nanmean(run["wind_speed"] * np.exp(1j * run["wind_from"])))
    return [] if np.isnan(mean) else [_wind(abs(mean), float(np.angle(mean)) / DEGREE, ", recorded mean")]


def effect_arrows(effects: Mapping[str, Mapping[str, Any]], how: str = "") -> list[Arrow]:
    """Winds and currents among effects, which are known by what gives their direction.

    Args:
        effects: Name of an effect -> its parameters.
        how: What is written after each, such as where it is known from.

    Returns:
        An arrow each, the way that air or water goes.
    """
    arrows = []
    for values in effects.values():
        if "from_deg" in values and values.get("speed"):
            arrows.append(_wind(values["speed"], values["from_deg"], how))
        elif "toward_deg" in values and values.get("speed"):
            toward = values["toward_deg"] + (180.0 if values["speed"] < 0 else 0.0)
            words = f"current {abs(values['speed']):.3g} m/s towards {toward % 360:.0f}°{how}"
            arrows.append(Arrow(words, toward * DEGREE, CURRENT))
    return arrows


def _wind(speed: float, from_deg: float, how: str) -> Arrow:
    """A wind, which is named by where it comes from."""
    return Arrow(f"wind {speed:.3g} m/s from {from_deg % 360:.0f}°{how}", from_deg * DEGREE + pi, WIND)
