"""A ship with its effects: coefficients, forces, steering gear, shaft and sensors that belong to a list of effects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from studies.concealed_trial import condition, forces, unmodelled
from studies.concealed_trial.equations import Equations
from studies.concealed_trial.forces import Force, Moment
from studies.concealed_trial.ships import GRAVITY, TrialShip

SHAFT_LAG = 8.0
"""Lag of the shaft behind the power limit [s]."""


@dataclass(frozen=True)
class ConcealedEffect:
    """One effect of a case.

    Attributes:
        name: As in the recordings' format, or ``unknown``.
        parameters: With the format's names and units; the measures of an unmodelled effect for ``unknown``.
        intervals: ``"all"``, or for each run its intervals [s].
        detail: Which unmodelled effect.
        strength: ``weak``, ``moderate``, ``strong`` or ``extreme``.
        ramp: How long it takes to set in [s]; half of it acts at the start of an interval.
    """

    name: str
    parameters: Mapping[str, float]
    intervals: Mapping[str, list[list[int]]] | str = "all"
    detail: str | None = None
    strength: str = "moderate"
    ramp: float = 0.0


@dataclass(frozen=True)
class Gear:
    """What is wrong between the order and the blade.

    Attributes:
        offset: Blade minus indicator [rad].
        play: Total play between indicator and blade [rad].
        slow_rate: Rate of a blade that follows the order on its own [rad/s].
        delay: How late the recorded angle is [s].
    """

    offset: float = 0.0
    play: float = 0.0
    slow_rate: float | None = None
    delay: float = 0.0


@dataclass(frozen=True)
class Sensors:
    """What is wrong with the channels.

    Attributes:
        heading_bias: Recorded minus true heading [rad].
        two_beats: Amplitude [rad] and phase [rad] of a heading error with twice the heading.
        rate_bias: Recorded minus true yaw rate [rad/s].
        rate_scale: Recorded over true yaw rate.
        log_scale: Recorded over true speed through the water.
        log_by_heading: Amplitude [-] and phase [rad] of a log error with the heading.
        lever: Antenna forward and to starboard [m].
        runaway: Error of the position, north and east [m/s^2], times t^2.
    """

    heading_bias: float = 0.0
    two_beats: tuple[float, float] = (0.0, 0.0)
    rate_bias: float = 0.0
    rate_scale: float = 1.0
    log_scale: float = 1.0
    log_by_heading: tuple[float, float] = (0.0, 0.0)
    lever: tuple[float, float] = (0.0, 0.0)
    runaway: tuple[float, float] = (0.0, 0.0)

    def heading(self, psi: np.ndarray) -> np.ndarray:
        """What the compass shows.

        Args:
            psi: True heading [rad].

        Returns:
            Heading [rad].
        """
        amplitude, phase = self.two_beats
        return psi + self.heading_bias + (amplitude * np.cos(2 * psi - phase) if amplitude else 0.0)


@dataclass
class TruthModel:
    """A ship with its effects.

    Attributes:
        ship: The ship.
        equations: With the coefficients as they are.
        forces: All external ones.
        current: North and east [m/s].
        roll_gain: Yaw moment per heel [N m/rad]; 0 leaves roll out.
        rpm_slope: k of the power limit.
        gear: Faults of the steering gear.
        sensors: Faults of the sensors.
        felt: Unlisted rudder, its name and measures.
        model_error: Coloured force, one row of X, Y, N for each run at 0, 1, 2 ... s.
        telegraph: Ordered over nominal shaft speed.
        lag: Time that the remembered yaw rate is behind [s]; 0 if nothing remembers.
    """

    ship: TrialShip
    equations: Equations
    forces: list[Force] = field(default_factory=list)
    current: tuple[float, float] = (0.0, 0.0)
    roll_gain: float = 0.0
    rpm_slope: float = 0.0
    gear: Gear = Gear()
    sensors: Sensors = Sensors()
    felt: tuple[str, Mapping[str, float]] | None = None
    model_error: np.ndarray | None = None
    telegraph: float | np.ndarray = 1.0
    lag: float = 0.0

    def derivative(self, t: float | np.ndarray, state: np.ndarray, blade: np.ndarray, n: np.ndarray) -> np.ndarray:
        """Time derivative of x, y [m], psi [rad], u, v [m/s], r [rad/s], phi [rad], dphi/dt and r L/U0 lagged.

        Args:
            t: Time [s], the same for all runs or one for each.
            state: 9 rows, one column for each run; u and v through the water. The last may be missing.
            blade: Angle of the blade [rad], positive to port.
            n: Shaft speed [rpm].

        Returns:
            As many rows.
        """
        x, y, psi, u, v, r, phi, p = state[:8]
        d = blade if self.felt is None else unmodelled.felt_angle(*self.felt, blade)
        external = np.zeros((3, u.size))
        if self.forces:
            now = Moment(t, x, y, psi, u, v, r, d, n, state[8] if self.lag else None)
            for force in self.forces:
                external += force(now)
        if self.model_error is not None and float(t) >= 0:
            external += self.model_error[min(int(float(t)), len(self.model_error) - 1)]
        if self.roll_gain:
            external[2] += self.roll_gain * phi
        out = np.empty_like(state)
        out[3:6] = self.equations.accelerations(u, v, r, d, n, external)
        cosine, sine = np.cos(psi), np.sin(psi)
        out[0] = u * cosine - v * sine + self.current[0]
        out[1] = u * sine + v * cosine + self.current[1]
        out[2] = r
        out[6] = p
        out[7] = self._roll(u, r, phi, p, out[4]) if self.roll_gain else 0.0
        if len(state) > 8:
            out[8] = (r * self.ship.length / self.ship.speed - state[8]) / self.lag if self.lag else 0.0
        return out

    def _roll(self, u, r, phi, p, sway) -> np.ndarray:
        """Angular acceleration in roll, as the format defines it [rad/s^2]."""
        s, ship = self.ship.stability, self.ship
        frequency = 2 * np.pi / s["roll_period_s"]
        steady = -(s["KG_m"] - ship.draught / 2) / (GRAVITY * s["GM_m"]) * (u * r + sway)
        return frequency**2 * (steady - phi) - 2 * s["roll_damping_ratio"] * frequency * p

    def shaft_speed(self, u: np.ndarray) -> np.ndarray:
        """Shaft speed that the power limit allows.

        Args:
            u: Forward speed [m/s].

        Returns:
            n [rpm].
        """
        return self.telegraph * self.ship.rpm * (1 - self.rpm_slope * (1 - u / (self.telegraph * self.ship.speed)))


def build(
    ship: TrialShip,
    effects: Sequence[ConcealedEffect],
    runs: list[str],
    *,
    tables: condition.Tables | None = None,
    gusts: np.ndarray | None = None,
) -> TruthModel:
    """The truth model in which these effects act.

    Args:
        ship: The ship.
        effects: Its effects.
        runs: Names of the runs, in the order of the columns.
        tables: Coefficients to start from; the nominal ones by default.
        gusts: Gust speeds [m/s] at 0, 1, 2 ... s for each run.

    Returns:
        The truth model.
    """
    tables = tables or condition.Tables.of(ship)
    for effect in sorted(effects, key=lambda e: e.name == "rudder_area_loss"):  # the lost area also loses depth terms
        change = _TABLES.get(effect.name)
        if change is not None:
            change(tables, next(iter(effect.parameters.values())))
    truth = TruthModel(ship, tables.equations())
    if tables.resistance_gain != 1.0:
        truth.forces.append(forces.fouling(ship, tables.resistance_gain - 1.0))
    for effect in effects:
        _add(truth, effect, runs, gusts, tables)
    return truth


_TABLES = {
    "displacement_change": condition.change_displacement,
    "trim_change": condition.change_trim,
    "shallow_water": condition.change_depth,
    "rudder_area_loss": condition.lose_rudder,
    "propeller_pitch_error": condition.change_pitch,
}


def _add(
    truth: TruthModel, effect: ConcealedEffect, runs: list[str], gusts: np.ndarray | None, tables: condition.Tables
) -> None:
    """Put one effect where it acts."""
    ship, p, name = truth.ship, effect.parameters, effect.name
    acts = forces.gate(effect.intervals, runs, effect.ramp)
    if name in {"wind_steady", "wind_onset", "wind_gusty"}:
        truth.forces.append(forces.wind(ship, p, acts, gusts if name == "wind_gusty" else None))
    elif name == "wave_drift":
        truth.forces.append(forces.wave_drift(ship, p, acts))
    elif name == "side_force":
        truth.forces.append(forces.lateral(p["force_kN"], p["lever_m"], acts))
    elif name == "bow_thruster":
        truth.forces.append(forces.lateral(p["force_kN"], forces.THRUSTER * ship.length, acts))
    elif name == "propeller_side_force":
        truth.forces.append(forces.propeller_side(ship, p))
    elif name == "hull_fouling":
        truth.forces.append(forces.fouling(ship, p["added_resistance"]))
    elif name == "ice_resistance":
        truth.forces.append(forces.ice(p["force_kN"]))
    elif name == "propeller_pitch_error" and not ship.is_tanker:
        fraction, thrust = p["fraction"], truth.equations.thrust
        truth.forces.append(forces.surge(lambda now: fraction * thrust(now.u, now.n)))
    elif name == "current":
        toward = np.radians(p["toward_deg"])
        truth.current = (p["speed"] * float(np.cos(toward)), p["speed"] * float(np.sin(toward)))
    elif name == "roll_coupling":
        truth.roll_gain = p["N_phi"] * ship.force_unit * ship.length
    elif name == "power_limit":
        truth.rpm_slope = p["rpm_slope"]
    elif name == "unknown":
        _add_unmodelled(truth, effect, runs)
    else:
        _add_faults(truth, effect)


def _add_faults(truth: TruthModel, effect: ConcealedEffect) -> None:
    """Put a fault of the steering gear or of a sensor where it acts."""
    p, name = effect.parameters, effect.name
    gear: dict[str, dict[str, Any]] = {
        "rudder_offset": {"offset": np.radians(p.get("offset_deg", 0.0))},
        "rudder_backlash": {"play": np.radians(p.get("width_deg", 0.0))},
        "rudder_slow": {"slow_rate": np.radians(p.get("rate_deg_s", 0.0))},
        "rudder_delay": {"delay": p.get("delay_s", 0.0)},
    }
    sensors: dict[str, dict[str, Any]] = {
        "heading_bias": {"heading_bias": np.radians(p.get("bias_deg", 0.0))},
        "rate_bias": {"rate_bias": np.radians(p.get("bias_deg_s", 0.0))},
        "log_scale": {"log_scale": p.get("factor", 1.0)},
        "gps_lever_arm": {"lever": (p.get("dx_m", 0.0), p.get("dy_m", 0.0))},
    }
    if name in gear:
        truth.gear = Gear(**{**truth.gear.__dict__, **gear[name]})
    elif name in sensors:
        truth.sensors = Sensors(**{**truth.sensors.__dict__, **sensors[name]})


def _add_unmodelled(truth: TruthModel, effect: ConcealedEffect, runs: list[str]) -> None:
    """Put an effect that no list holds where it acts."""
    p, detail = effect.parameters, str(effect.detail)
    if detail in unmodelled.FORCES:
        truth.forces.append(unmodelled.unmodelled_force(truth.ship, detail, p, runs))
        truth.lag = p.get("lag_s", truth.lag)
    elif detail in unmodelled.RUDDERS:
        truth.felt = (detail, p)
    else:
        turned = np.radians(p.get("direction_deg", 0.0))
        changed: dict[str, dict[str, Any]] = {
            "compass_two_beats": {"two_beats": (np.radians(p["a"]), turned)},
            "log_by_heading": {"log_by_heading": (p["a"], turned)},
            "position_runs_away": {"runaway": (p["a"] * float(np.cos(turned)), p["a"] * float(np.sin(turned)))},
            "rate_scale": {"rate_scale": 1 + p["a"]},
        }
        truth.sensors = Sensors(**{**truth.sensors.__dict__, **changed[detail]})
