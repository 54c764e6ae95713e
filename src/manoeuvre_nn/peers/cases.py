"""Cases made ready for the peers: ships by name, runs to fit and runs to place events in."""

from pathlib import Path

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.diagnosis.case import Case, read_case
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.loading import DisplacementChange, TrimChange
from manoeuvre_nn.effect.local import BowThruster, SideForce
from manoeuvre_nn.effect.propulsion import (
    HullFouling,
    IceResistance,
    PowerLimit,
    PropellerPitchError,
    PropellerSideForce,
)
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderOffset, RudderSlow
from manoeuvre_nn.effect.sensors import HeadingBias, LeverArm, LogScale, RateBias
from manoeuvre_nn.effect.steering import RudderAreaLoss, RudderDelay
from manoeuvre_nn.effect.waves import WaveDrift
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind, WindOnset
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIPS = {"mariner": mariner_corrected, "great_lakes_bulker": great_lakes_bulker, "esso_tanker": esso_190k}
"""Name in a manifest -> the ship."""
SHELF: tuple[type[Effect], ...] = (
    SteadyWind, GustyWind, WindOnset, Current, ShallowWater, WaveDrift, RudderOffset, RudderBacklash, RudderSlow,
    RudderDelay, RudderAreaLoss, PropellerSideForce, PropellerPitchError, PowerLimit, HullFouling, IceResistance,
    DisplacementChange, TrimChange, RollCoupling, SideForce, BowThruster, HeadingBias, RateBias, LogScale, LeverArm,
)  # fmt: skip
"""Every effect that a case may have."""


def effects(ship: Ship) -> list[Effect]:
    """The shelf on a ship.

    Args:
        ship: The ship.

    Returns:
        One of every effect.
    """
    return [kind(ship) for kind in SHELF]


def load(folder: Path) -> tuple[Case, CalmWater]:
    """A case and its calm-water model.

    Args:
        folder: Folder of the case.

    Returns:
        The case and the model.

    Raises:
        InputError: If the ship is unknown.
    """
    case = read_case(folder)
    if case.ship not in SHIPS:
        raise InputError(f"{folder.name}: ship {case.ship!r} is unknown; expected one of: {', '.join(SHIPS)}")
    return case, CalmWater(SHIPS[case.ship]())
