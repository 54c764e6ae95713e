"""Currents: the water moves and takes the ship with it."""

from abc import abstractmethod
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.effect.common import columns, compass, direction

SPEED = Parameter("speed", "m/s", 0.0, 10.0, 0.0, 0.6, (0.5, 2.5), vector=True)


class _UniformCurrent(Effect):
    """Water that moves with one velocity everywhere, at a speed over time that each current gives itself."""

    acts_indoors = False
    measured_by = "the current"
    site = "inflow"
    family = "current"
    equations = ("kinematics",)

    def stream(self, s: Situation) -> Float[Tensor, "*batch 2"]:
        """Velocity of the water over ground."""
        north, east = compass(self.value("toward_deg"))
        speed = self._speed(s)
        return columns(speed * north, speed * east)

    @abstractmethod
    def _speed(self, s: Situation) -> Tensor:
        """Speed of the water at every sample [m/s]."""


class Current(_UniformCurrent):
    """A uniform current: a Galilean shift of the track.

    Motion through the water is what it would be without; only the rates of position gain the water's velocity.
    """

    name = "current"
    candidate = True
    exclusive = "current"
    label = "a current"
    fingerprint = "The track drifts in one compass direction; heading, yaw rate and log speed are as in still water."
    source = "Fossen 2012; Hegrenaes & Hallingstad 2011; IMO MSC/Circ.1053, 3.4.2.5"
    declared = (SPEED, direction("toward_deg"))

    def _speed(self, s: Situation) -> Tensor:
        """Speed of the water at every sample [m/s]."""
        return self.value("speed") + 0.0 * s.time


class TidalCurrent(_UniformCurrent):
    """A rectilinear stream that gains or loses speed evenly in a run, and has another speed in each.

    Runs of one trial are sailed one after another while the tide turns. A negative speed is that of a stream that has
    turned.
    """

    name = "tidal_current"
    candidate = True
    exclusive = "current"
    variant_of = "current"
    label = "a current that changes with the tide"
    fingerprint = "Like a current, but the drift of the track grows or fades evenly during the trial."
    source = "Linear part of V0 + V1 cos(2 pi t / 12.42 h + p), enough for trials of half an hour"
    declared = (
        replace(SPEED, low=-SPEED.high, starts=(0.5,), per_run=True, vector=False, sides=("that way", "the other way")),
        direction("toward_deg"),
        Parameter("change", "m/s per hour", -10.0, 10.0, 0.0, 0.5, (0.3, -0.3), sides=("growing", "falling")),
    )

    def _speed(self, s: Situation) -> Tensor:
        """Speed of the water at every sample [m/s]; negative where the stream has turned."""
        return self.value("speed") + self.value("change") / 3600.0 * s.time
