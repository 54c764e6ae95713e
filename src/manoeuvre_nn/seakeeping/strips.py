"""Waves that the sections of a heaving and pitching hull make, each as if it were part of a long cylinder."""

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import exp1

from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.panels import PanelledHull
from manoeuvre_nn.seakeeping.radiation import Radiation

LID_PANELS = 12
"""With 12 on half the breadth B the first irregular frequency is above w^2 B/(2 g) = 2.9, beyond what moves a ship."""
INSIDE = 1e-9
"""How far below its panel a point is taken, over the panel's length: the side on which the water is."""


def radiate_strips(hull: PanelledHull, frequency: Float[np.ndarray, " frequencies"]) -> Radiation:
    """Potentials of heave and pitch section by section.

    Pitch about G moves the section at x as heave by -x does; surge makes no waves.

    Args:
        hull: The hull.
        frequency: Frequencies [rad/s], rising and above 0.

    Returns:
        The potentials.

    Source:
        Salvesen, Tuck & Faltinsen 1970, strip theory.
    """
    middles = (hull.vertices[:-1, :, 1:] + hull.vertices[1:, :, 1:]) / 2
    potential = heaving_sections(middles[..., 0] + 1j * middles[..., 1], frequency)
    heave = potential.reshape(len(frequency), -1)
    lever = hull.buoyancy[0] - hull.centre[:, 0]
    up = hull.directed_area[:, 2]
    return Radiation(
        hull,
        np.stack([np.zeros_like(up), up, lever * up]),
        frequency,
        np.stack([np.zeros_like(heave), heave, lever * heave], axis=1),
    )


def heaving_sections(
    contour: Complex[np.ndarray, "sections points"], frequency: Float[np.ndarray, " frequencies"]
) -> Complex[np.ndarray, "frequencies sections panels"]:
    """Potential on symmetric sections that heave with unit velocity ``e^(i w t)`` on deep water.

    Sources on straight panels of the contour, with Green's function for ``nu = w^2/g``, Z = y + i z and a source at s::

        2 pi G = ln|Z - s| + ln|Z - s*| - 2 Re(K + ln a) + 2 pi i Re e^(-nu a),  a = i (Z - s*)
        K = e^(-nu a) (E_1(-nu a) + i pi sign Im(-nu a)),  the principal value of int_0^inf e^(-k a)/(k - nu) dk

    A lid on the water inside, through which nothing flows, suppresses irregular frequencies.

    Args:
        contour: Corners y + i z from keel to waterline on the side y > 0 [m].
        frequency: Frequencies [rad/s].

    Returns:
        Potential at the middles of the panels [m].

    Source:
        Frank 1967, "Oscillation of cylinders in or below the free surface of deep fluids"; Wehausen & Laitone 1960,
        section 13. The lid: Ohmatsu 1975.
    """
    lid = contour.real[:, -1:] * np.linspace(0.0, 1.0, LID_PANELS + 1)
    start = np.concatenate([contour[:, :-1], lid[:, :-1]], axis=1)
    end = np.concatenate([contour[:, 1:], lid[:, 1:]], axis=1)
    along, panels = end - start, contour.shape[1] - 1
    normal = -1j * along / np.abs(along)  # into the water: to the right of the way from keel to waterline
    point = (start + end) / 2 + INSIDE * np.abs(along) * normal
    steady = _logarithms(point, normal, start, end)
    velocity = np.where(np.arange(start.shape[1]) < panels, normal.imag, 0.0)[..., None]
    potential = np.empty((len(frequency), len(contour), panels), dtype=complex)
    for i, omega in enumerate(frequency.tolist()):
        value, slope = (s + w for s, w in zip(steady, _waves(point, normal, along, omega**2 / GRAVITY), strict=True))
        potential[i] = (value @ np.linalg.solve(slope, velocity))[:, :panels, 0]
    return potential


def _logarithms(
    point: Complex[np.ndarray, "sections points"],
    normal: Complex[np.ndarray, "sections points"],
    start: Complex[np.ndarray, "sections points"],
    end: Complex[np.ndarray, "sections points"],
) -> tuple[Float[np.ndarray, "sections points points"], Float[np.ndarray, "sections points points"]]:
    """``int ln|Z - s| ds/(2 pi)`` over panels and their images in y and z, in closed form, and its normal slope."""
    value = slope = np.zeros((*point.shape, point.shape[1]))
    for image in (lambda s: s, np.conj, lambda s: -np.conj(s), lambda s: -s):
        first, last = image(start)[:, None, :], image(end)[:, None, :]
        length = np.abs(last - first)
        unit = (last - first) / length
        # along the panel int_0^l ln(w - t) dt = w ln w - (w - l) ln(w - l) - l
        w = (point[:, :, None] - first) / unit
        near, far = np.log(w), np.log(w - length)
        value = value + (w * near - (w - length) * far - length).real
        slope = slope + ((near - far) / unit * normal[:, :, None]).real
    return value / (2 * np.pi), slope / (2 * np.pi)


def _waves(
    point: Complex[np.ndarray, "sections points"],
    normal: Complex[np.ndarray, "sections points"],
    along: Complex[np.ndarray, "sections points"],
    nu: float,
) -> tuple[Complex[np.ndarray, "sections points points"], Complex[np.ndarray, "sections points points"]]:
    """The rest of Green's function, ``- Re(K + ln a)/pi + i Re e^(-nu a)``, times the length of the source's panel."""
    value = slope = np.zeros((*point.shape, point.shape[1]), dtype=complex)
    for source in (point, -np.conj(point)):
        a = 1j * (point[:, :, None] - np.conj(source)[:, None, :])
        swing = np.exp(-nu * a)
        beside = np.where(a.imag < 0, 1.0, -1.0)
        integral = exp1(-nu * a) + 1j * np.pi * beside
        k = swing * np.where(a.imag == 0, integral.real, integral)  # on the cut itself the principal value is real
        value = value - (k + np.log(a)).real / np.pi + 1j * swing.real
        # d/dZ = i d/da, dK/da = - nu K - 1/a
        outward = 1j * nu * normal[:, :, None]
        slope = slope + (outward * k).real / np.pi - 1j * (outward * swing).real
    length = np.abs(along)[:, None, :]
    return value * length, slope * length
