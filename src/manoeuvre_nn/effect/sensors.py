"""Instruments that show something else than what is."""

from abc import ABC
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.effect.common import ACROSS, LATE, LENGTHWISE

TOO = ("too long", "too short")
EARTH = 465.1
"""Speed of the equator by the earth's rotation [m/s]."""


def add(channels: Mapping[str, Tensor], **errors: Tensor) -> dict[str, Tensor]:
    """Channels with errors added, in their units; errors of channels that are not recorded are dropped."""
    return {name: value + errors[name] if name in errors else value for name, value in channels.items()}


def shifted(
    channel: Float[Tensor, "..."], time: Float[Tensor, "..."], delay: Float[Tensor, "..."]
) -> Float[Tensor, "..."]:
    """A channel as it was some time before, straight between samples and beyond its ends.

    Its derivative by the delay is the slope, beyond the ends too, so that delays can be fitted.

    Args:
        channel: Samples over time in the last dimension.
        time: Times of the samples [s].
        delay: How late the channel is [s], one in the last dimension; negative is early.

    Returns:
        The channel at ``time - delay``.
    """
    channel, time, delay = torch.broadcast_tensors(channel, time, delay)
    asked = time - delay
    high = torch.searchsorted(time.contiguous(), asked.detach().contiguous()).clamp(1, time.shape[-1] - 1)
    t0, t1 = time.gather(-1, high - 1), time.gather(-1, high)
    f0, f1 = channel.gather(-1, high - 1), channel.gather(-1, high)
    return f0 + (f1 - f0) * (asked - t0) / (t1 - t0)


class _Sensor(Effect, ABC):
    """An instrument's error."""

    site = "sensor"
    family = "sensors"
    measured_by = "the same with a second sensor"


class HeadingBias(_Sensor):
    """A compass that shows too much by a constant angle: recorded minus true, positive clockwise."""

    name = "heading_bias"
    candidate = True
    label = "a compass error"
    equations = ("sensor:psi",)
    fingerprint = "Velocity over ground is turned against the heading by one angle, whatever the heading."
    source = "Gyro misalignment, psi_m = psi + e"
    declared = (
        Parameter("bias_deg", "deg", -45.0, 45.0, 0.0, 1.5, (1.0, -1.0, 10.0, -10.0), sides=("too much", "too little")),
    )

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Add the bias to the heading."""
        return add(channels, psi=self.angle("bias_deg"))


class RateBias(_Sensor):
    """A rate gyro that shows too much: recorded minus true, positive clockwise."""

    name = "rate_bias"
    candidate = True
    label = "a bias of the rate gyro"
    equations = ("sensor:r",)
    fingerprint = "The integral of the yaw rate runs away from the heading at a constant rate."
    source = "r_m = r + b"
    declared = (Parameter("bias_deg_s", "deg/s", -5.0, 5.0, 0.0, 0.05, (0.03, -0.03), sides=ACROSS),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Add the bias to the yaw rate."""
        return add(channels, r=self.angle("bias_deg_s"))


class LogScale(_Sensor):
    """A speed log that shows a multiple of the forward speed through the water."""

    name = "log_scale"
    candidate = True
    label = "a scale error of the speed log"
    equations = ("sensor:u_log",)
    fingerprint = "The log is off by a share of the speed on every heading, with and against any current."
    source = "u_m = factor u"
    declared = (Parameter("factor", "-", 0.1, 5.0, 1.0, 0.08, (1.05, 0.95, 1.5, 0.6)),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Scale the log."""
        return {k: c * self.value("factor") if k == "u_log" else c for k, c in channels.items()}


class LeverArm(_Sensor):
    """A GPS antenna that is not at the reference point: dx_m forward, dy_m to starboard of it."""

    name = "gps_lever_arm"
    candidate = True
    label = "a lever arm of the GPS antenna"
    equations = ("sensor:x", "sensor:y", "sensor:vn", "sensor:ve")
    fingerprint = "Sway over ground gains a share of the yaw rate, and the turning circle changes its radius."
    source = "Rigid body: x_m = x + dx cos psi - dy sin psi and its rate"
    declared = (
        Parameter("dx_m", "m", -0.6, 0.6, 0.0, 0.3, (0.2, -0.2), within="length", sides=LENGTHWISE),
        Parameter("dy_m", "m", -0.6, 0.6, 0.0, 0.3, (0.0,), within="beam", sides=ACROSS),
    )

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Position and velocity of the antenna."""
        north, east = body_to_earth(self.value("dx_m"), self.value("dy_m"), s.psi)
        return add(channels, x=north, y=east, vn=-s.r * east, ve=s.r * north)


class PositionConversion(_Sensor):
    """Positions that were converted wrongly: longer or shorter along an axis, and the grid turned against true north.

    A sphere for the ellipsoid makes up to .7 % along an axis, a wrong latitude anything along the east axis, a grid its
    scale and its convergence. All are about the origin of the coordinates. Speed over ground, which a receiver finds by
    itself, is right. A datum that is off by a constant moves all runs alike and shows nowhere.
    """

    name = "position_conversion"
    candidate = True
    label = "an error in the conversion of positions"
    equations = ("sensor:x", "sensor:y")
    fingerprint = "The track is longer or shorter than the speed over ground adds up to, by one share along each axis."
    source = "Snyder 1987, USGS PP 1395: scale factor and convergence of a grid, radii of the ellipsoid"
    declared = (
        Parameter("north", "%", -80.0, 400.0, 0.0, 0.5, (0.3, -0.3), sides=TOO),
        Parameter("east", "%", -80.0, 400.0, 0.0, 0.5, (0.0,), sides=TOO),
        Parameter("turn_deg", "deg", -180.0, 180.0, 0.0, 1.0, (0.0,), sides=("clockwise", "anticlockwise")),
    )

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """``(x_m, y_m) = R(turn) ((1 + north) x, (1 + east) y)``."""
        if not {"x", "y"} <= channels.keys():
            return dict(channels)
        x, y = (channels[at] * (1 + 0.01 * self.value(name)) for at, name in (("x", "north"), ("y", "east")))
        return {**channels, **dict(zip("xy", body_to_earth(x, y, self.angle("turn_deg")), strict=True))}


class WrongFrame(_Sensor):
    """Velocities over ground that hold for a point dx_m forward of where the position holds."""

    name = "wrong_frame"
    label = "velocities of another reference point"
    equations = ("sensor:vn", "sensor:ve")
    fingerprint = "Sway over ground gains a share of the yaw rate although the track is that of the reference point."
    source = "Rigid body: v_m = v + dx r"
    declared = (Parameter("dx_m", "m", -0.6, 0.6, 0.0, 0.3, (0.2, -0.2), within="length", sides=LENGTHWISE),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Velocity of the other point."""
        sway = self.value("dx_m") * s.r
        return add(channels, vn=-sway * torch.sin(s.psi), ve=sway * torch.cos(s.psi))


class GpsDelay(_Sensor):
    """Position and velocity over ground that are late."""

    name = "gps_delay"
    fittable = False
    label = "a late GPS"
    equations = ("sensor:x", "sensor:y", "sensor:vn", "sensor:ve")
    fingerprint = "The track lags by the speed times one time, and velocity over ground turns after the heading."
    source = "x_m(t) = x(t - tau)"
    declared = (Parameter("delay_s", "s", -30.0, 30.0, 0.0, 0.7, (0.5,), sides=LATE),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Take position and velocity from before."""
        delay = self.value("delay_s")
        return {k: shifted(c, s.time, delay) if k in {"x", "y", "vn", "ve"} else c for k, c in channels.items()}


class TimeSync(_Sensor):
    """A yaw rate that is stamped late."""

    name = "time_sync"
    label = "a clock offset of the yaw rate"
    equations = ("sensor:r",)
    fingerprint = "The yaw rate is the derivative of the heading, but of some time before."
    source = "r_m(t) = r(t - tau)"
    declared = (Parameter("offset_s", "s", -60.0, 60.0, 0.0, 1.5, (1.0, -1.0, 10.0, -10.0), sides=LATE),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Take the yaw rate from before."""
        late = self.value("offset_s")
        return {k: shifted(c, s.time, late) if k == "r" else c for k, c in channels.items()}


class GyroSpeedError(_Sensor):
    """A gyro compass whose latitude and speed correction is not set: it settles west of north on northerly courses.

    ``psi_m = psi + factor V_north / 465 m/s``, V over ground; the factor of a compass without any correction is
    1 / cos(latitude).
    """

    name = "gyro_speed_error"
    label = "an uncorrected speed error of the gyro compass"
    equations = ("sensor:psi",)
    fingerprint = "The angle between heading and course changes with the cosine of the course and the speed."
    source = "e = V cos psi / (R Omega cos lat)"
    declared = (Parameter("factor", "-", -6.0, 6.0, 0.0, 1.5, (1.0,)),)

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """Add the error to the heading."""
        through_water, _ = body_to_earth(s.u, s.v, s.psi)
        return add(channels, psi=self.value("factor") * channels.get("vn", through_water) / EARTH)
