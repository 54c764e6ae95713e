"""A hull under water as flat panels, with its weight and what holds it up."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY, SEA_WATER
from manoeuvre_nn.seakeeping.form import MAX_DRAUGHT, HullForm
from manoeuvre_nn.seakeeping.hull import Hull


@dataclass(frozen=True, eq=False)
class PanelledHull:
    """The port half of a hull that floats on an even keel; x forward of midship, y to port, z up from still water.

    All integrals run over the panels, those of the weight and the restoring forces too: so a hull that floats in still
    water stays in balance on long waves, however coarse its panels are.

    Attributes:
        vertices: Corners of panels [m], from stern to bow and from keel to waterline.
        gyradius: Radius of gyration in pitch [m].
        weight_depth: Height of the centre of gravity above still water [m].
        rho: Density of the water [kg/m^3].
    """

    vertices: Float[np.ndarray, "stations points 3"]
    gyradius: float
    weight_depth: float
    rho: float = SEA_WATER

    @property
    def faces(self) -> Int[np.ndarray, "panels 4"]:
        """Numbers of the four corners of each panel."""
        return grid_faces(*self.vertices.shape[:2])

    @cached_property
    def directed_area(self) -> Float[np.ndarray, "panels 3"]:
        """Area times the normal into the water [m^2]."""
        a, b, c, d = np.moveaxis(self.vertices.reshape(-1, 3)[self.faces], 1, 0)
        return np.asarray(np.cross(c - a, d - b) / 2)

    @cached_property
    def centre(self) -> Float[np.ndarray, "panels 3"]:
        """Centroids of the panels [m], the mean of those by either diagonal."""
        a, b, c, d = np.moveaxis(self.vertices.reshape(-1, 3)[self.faces], 1, 0)
        return np.asarray((_centroid(a, b, c, d) + _centroid(b, c, d, a)) / 2)

    @cached_property
    def volume(self) -> float:
        """Displaced by both halves [m^3]: ``int z n_z dS``."""
        return float(2 * np.sum(self.centre[:, 2] * self.directed_area[:, 2]))

    @cached_property
    def buoyancy(self) -> tuple[float, float]:
        """Centre of buoyancy forward of midship and above still water [m]: ``int x z n_z dS``, ``int z^2/2 n_z dS``."""
        x, z, area = self.centre[:, 0], self.centre[:, 2], 2 * self.directed_area[:, 2] / self.volume
        return float(np.sum(x * z * area)), float(np.sum(z**2 / 2 * area))

    @cached_property
    def modes(self) -> Float[np.ndarray, "3 panels"]:
        """Area times normal velocity of panels for unit surge ahead, heave up and pitch about G bow down [m^2, m^3]."""
        x, z = self.centre[:, 0] - self.buoyancy[0], self.centre[:, 2] - self.weight_depth
        ahead, _, up = self.directed_area.T
        return np.stack([ahead, up, z * ahead - x * up])

    @cached_property
    def mass(self) -> Float[np.ndarray, "3 3"]:
        """Mass [kg] and moment of inertia [kg m^2] about the centre of gravity, which stands over that of buoyancy."""
        return np.diag([1.0, 1.0, self.gyradius**2]) * self.rho * self.volume

    @cached_property
    def restoring(self) -> Float[np.ndarray, "3 3"]:
        """Restoring forces [N/m, N, N m]: of the waterplane, and of the weight above the buoyancy; none of surge."""
        x, plane = self.centre[:, 0] - self.buoyancy[0], -2 * self.directed_area[:, 2]
        tilt = float(np.sum(plane * x**2)) + self.volume * (self.buoyancy[1] - self.weight_depth)
        area, moment = float(np.sum(plane)), float(np.sum(plane * x))
        return self.rho * GRAVITY * np.array([[0.0, 0.0, 0.0], [0.0, area, -moment], [0.0, -moment, tilt]])


def grid_faces(stations: int, points: int) -> Int[np.ndarray, "panels 4"]:
    """Panels between the points of a grid.

    Args:
        stations: Rows of points, from stern to bow.
        points: Points in each, from keel to waterline.

    Returns:
        Numbers of the four corners of each panel, anticlockwise from outside of a port side.
    """
    number = np.arange(stations * points).reshape(stations, points)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def _centroid(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Centroids of quadrilaterals cut along a-c into two triangles."""
    first, second = (np.linalg.norm(np.cross(p - a, q - a), axis=-1, keepdims=True) for p, q in ((b, c), (c, d)))
    return (first * (a + b + c) + second * (a + c + d)) / (3 * np.maximum(first + second, 1e-12))


def panelled(form: HullForm, draught: float, lengthwise: int = 28, girthwise: int = 6) -> PanelledHull:
    """Panels on a hull form at any draught.

    Args:
        form: The hull form.
        draught: Draught on an even keel [m].
        lengthwise: Panels along the ship, denser at the ends.
        girthwise: Panels from keel to waterline, of equal length.

    Returns:
        The panels of the port half.

    Raises:
        InputError: If the sides of the form end below the water.
    """
    if not 0 < draught <= MAX_DRAUGHT * form.draught:
        raise InputError(f"draught {draught:g} m is outside the hull form: write 0 to {MAX_DRAUGHT * form.draught:g} m")
    hull, span = form.offsets(), 0.45 * np.pi
    x = form.length / 2 * np.sin(np.linspace(-span, span, lengthwise + 1)) / np.sin(span)
    points = np.stack([_girth(hull, at, draught, girthwise) for at in x])
    vertices = np.concatenate([np.broadcast_to(x[:, None, None], (*points.shape[:2], 1)), points], axis=-1)
    return PanelledHull(vertices, form.gyradius * form.length, form.weight_height - draught)


def _girth(hull: Hull, x: float, draught: float, parts: int) -> Float[np.ndarray, "points 2"]:
    """Points y, z at equal distances along a section, from the keel to the waterline."""
    z = np.append(hull.waterlines[hull.waterlines < draught], draught)
    y = hull.half_breadth(np.array([x]), z)[0]
    y, z = np.append(0.0, y), np.append(0.0, z)
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(y), np.diff(z))))
    at = np.linspace(0.0, along[-1], parts + 1)
    return np.stack([np.interp(at, along, y), np.interp(at, along, z) - draught], axis=-1)
