"""Waves that a surging, heaving and pitching hull makes at zero speed, by a boundary element method."""

import logging
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
from jaxtyping import Complex, Float, Int

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.panels import PanelledHull, grid_faces

MODES = ("surge", "heave", "pitch")


@dataclass(frozen=True, eq=False)
class Radiation:
    """Potentials on a hull that surges, heaves and pitches, each with unit velocity ``e^(i w t)``.

    Attributes:
        hull: The port half of the hull.
        modes: Area times normal velocity of the panels in surge, heave and pitch that the potentials belong to.
        frequency: Frequencies of the motion [rad/s], rising.
        potential: Potential on the panels for surge and heave [m] and pitch [m^2].
    """

    hull: PanelledHull
    modes: Float[np.ndarray, "3 panels"]
    frequency: Float[np.ndarray, " frequencies"]
    potential: Complex[np.ndarray, "frequencies 3 panels"]

    @cached_property
    def _forces(self) -> Complex[np.ndarray, "frequencies 3 3"]:
        """``A - i B/w``: force of mode j on the hull that moves in mode k."""
        return -2 * self.hull.rho * np.einsum("fkp,jp->fjk", self.potential, self.modes)

    @property
    def added_mass(self) -> Float[np.ndarray, "frequencies 3 3"]:
        """Added mass of surge, heave and pitch [kg, kg m, kg m^2]."""
        return np.asarray(self._forces.real)

    @property
    def damping(self) -> Float[np.ndarray, "frequencies 3 3"]:
        """Damping of surge, heave and pitch [kg/s, kg m/s, kg m^2/s]."""
        return np.asarray(-self.frequency[:, None, None] * self._forces.imag)

    def forces_at(self, frequency: Float[np.ndarray, " waves"]) -> Complex[np.ndarray, "waves 3 3"]:
        """``A - i B/w`` at other frequencies: straight between those solved for, held beyond them.

        Args:
            frequency: Frequencies w of the motion [rad/s].

        Returns:
            Forces over acceleration [kg, kg m, kg m^2], rows the forces.
        """
        left, share = self._place(frequency)
        share = share[:, None, None]
        return np.asarray(self._forces[left] * (1 - share) + self._forces[left + 1] * share)

    def work_on(
        self, flow: Complex[np.ndarray, "waves panels"], frequency: Float[np.ndarray, " waves"]
    ) -> Complex[np.ndarray, "waves 3"]:
        """Sums over the panels of the potentials times something else, for each frequency.

        Args:
            flow: What the potentials are multiplied by, a row for each frequency.
            frequency: Frequencies of the motion [rad/s]; the potentials are straight between those solved for.

        Returns:
            ``sum phi_j flow`` for surge, heave and pitch.
        """
        left, share = self._place(frequency)
        low, high = ((self.potential[at] @ flow[:, :, None])[:, :, 0] for at in (left, left + 1))
        return np.asarray(low * (1 - share[:, None]) + high * share[:, None])

    def _place(
        self, frequency: Float[np.ndarray, " waves"]
    ) -> tuple[Int[np.ndarray, " waves"], Float[np.ndarray, " waves"]]:
        """Between which of the frequencies solved for others lie: the lower one, and the share of the upper one."""
        solved = self.frequency
        left = np.clip(np.searchsorted(solved, frequency) - 1, 0, len(solved) - 2)
        return left, np.clip((frequency - solved[left]) / (solved[left + 1] - solved[left]), 0.0, 1.0)


def radiate(hull: PanelledHull, frequency: Float[np.ndarray, " frequencies"]) -> Radiation:
    """Solve for the potentials on deep water, irregular frequencies suppressed by a lid; needs capytaine.

    Args:
        hull: The hull.
        frequency: Frequencies [rad/s], rising and above 0.

    Returns:
        The potentials.

    Source:
        Ancellin & Dias 2019, "Capytaine: a Python-based linear potential flow solver", JOSS 4(36).
    """
    capytaine = _capytaine()
    half = capytaine.Mesh(hull.vertices.reshape(-1, 3), hull.faces)
    mesh = capytaine.ReflectionSymmetricMesh(half, plane="xOz")
    lid = capytaine.ReflectionSymmetricMesh(capytaine.Mesh(*_lid(hull)), plane="xOz")
    body = capytaine.FloatingBody(mesh=mesh, lid_mesh=lid)
    x, y, z = (mesh.faces_centers - [hull.buoyancy[0], 0.0, hull.weight_depth]).T
    none, one = np.zeros_like(y), np.ones_like(y)
    motions = ((one, none, none), (none, none, one), (z, none, -x))
    body.dofs = {mode: np.stack(motion, axis=1) for mode, motion in zip(MODES, motions, strict=True)}
    solver, panels = capytaine.BEMSolver(), len(hull.faces)
    potential = np.empty((len(frequency), len(MODES), panels), dtype=complex)
    for i, omega in enumerate(frequency.tolist()):
        for j, mode in enumerate(MODES):
            problem = capytaine.RadiationProblem(
                body=body, radiating_dof=mode, omega=omega, rho=hull.rho, g=GRAVITY, water_depth=np.inf
            )
            solved = solver.solve(problem, keep_details=True, _check_wavelength=False).potential[body.hull_mask]
            # capytaine moves the hull by e^(-i w t), hence with the velocity -i w; port comes before its mirror image
            potential[i, j] = np.conj(solved[:panels] / (-1j * omega))
    return Radiation(hull, hull.modes, frequency, potential)


def _lid(hull: PanelledHull) -> tuple[Float[np.ndarray, "corners 3"], Int[np.ndarray, "panels 4"]]:
    """Corners and panels on the water inside the port half, two from centre line to side; the very ends go without."""
    waterline = hull.vertices[1:-1, -1]
    corners = waterline[:, None] * [[1.0, share, 0.0] for share in (0.0, 0.5, 1.0)]
    return corners.reshape(-1, 3), grid_faces(*corners.shape[:2])


def _capytaine() -> ModuleType:
    """Capytaine, without the log handlers that it installs."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    try:
        import capytaine
    except ImportError as error:
        raise InputError(
            "the boundary element method needs capytaine: pip install 'manoeuvre-nn[seakeeping]', or write "
            "method='strip_theory'"
        ) from error
    finally:
        root.handlers[:] = handlers
        root.setLevel(level)
    logging.getLogger("capytaine").setLevel(logging.ERROR)
    return capytaine
