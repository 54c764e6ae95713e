"""Recordings made ready for a diagnosis: even times, rudder and shaft freed of noise, velocity from positions."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter, uniform_filter1d

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording, followed
from manoeuvre_nn.core.units import RPM
from manoeuvre_nn.recording.holes import heading_across, holes, with_rudder
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import far_off, robust_sd
from manoeuvre_nn.recording.read.mapping import RECORD

MIN_STEP_S = 1.0
"""Finest step that recordings are read off at [s], unless the ship is fast."""
MAX_STEP = 0.05
"""Longest step that recordings are read off at, over L/U0."""
MAX_NOMINAL_OFFSET = 0.05
"""Largest distance of the first shaft speed from the nominal one at which the nominal one was ordered [-]."""
RESTING_WINDOW_S = 15.0
"""Length of the mean over a resting rudder [s]."""
SHAFT_WINDOW = 15
"""Samples of the running median of the shaft speed."""
HEEL = ("phi", "p")
"""Channels that only ships which roll are compared by."""
HEEL_WINDOW = 0.4
"""Window of the local cubics of recorded heel over L/U0: a quarter of a short roll period."""
SIDES = (("delta_split", "delta", "rad"), ("shaft_split", "n", "1/s"))
"""Input by which the sides differ, channel of which there is a starboard and a port one, unit."""
MIN_SPLIT = 5e-3
"""Difference of the sides [rad, -], halved, below which they are alike."""
MAX_RESTING_SDS, MIN_RESTING_SD = 5.0, 1e-6
"""A sample of a resting rudder further off than so many standard deviations [-] of at least so much [rad] is wrong."""


def measured(run: Recording, channels: Sequence[str] = MEASURED) -> Float[np.ndarray, "n channels"]:
    """What sensors wrote down, one column a channel; NaN where nothing was recorded."""
    gap = np.full(len(run), np.nan)
    return np.stack([run.channels.get(name, gap) for name in channels], axis=-1)


def with_measured(
    run: Recording, values: Float[np.ndarray, "n channels"], channels: Sequence[str] = MEASURED
) -> Recording:
    """A recording with other measured channels, one column a channel; NaN in gaps."""
    return run.with_channels(**dict(zip(channels, values.T, strict=True)))


def without_samples(
    run: Recording, bad: Bool[np.ndarray, "n channels"], channels: Sequence[str] = MEASURED
) -> Recording:
    """A recording with gaps where measured samples, one column a channel, are unusable."""
    return with_measured(run, np.where(bad, np.nan, measured(run, channels)), channels)


def over_ground(recording: Recording, ship: Particulars) -> Recording:
    """Only what was recorded, in the channels of a diagnosis: velocity over ground, shaft over the nominal speed.

    Times count from the first sample, where a part of a longer recording begins too.

    Args:
        recording: In SI, rudder positive to starboard; its u and v count as velocities over ground.
        ship: The ship, for its nominal shaft speed.

    Returns:
        A recording without channels that were derived, but for a velocity that positions give: ``meta["derived"]``.

    Raises:
        InputError: If it is a record of channels without heading, rudder and motion.
    """
    if recording.meta.get("kind") == RECORD:
        raise InputError(f"{recording.name}: a mapping of kind: record gives no manoeuvre that could be diagnosed")
    given = {k: c for k, c in recording.channels.items() if k not in recording.derived}
    kept = ("psi", "delta", "delta_order", "r", "x", "y", "u_log", "vn", "ve", *HEEL)
    channels = {k: given[k] for k in kept if k in given and not (k == "y" and "x" not in given)}
    if "n" in given:
        channels["shaft_recorded"] = given["n"] / (ship.rpm * RPM)
    elif "shaft" in given:
        channels["shaft_recorded"] = given["shaft"]
    for split, name, unit in SIDES:
        sides = [given.get(f"{name}_{side}") for side in ("starboard", "port")]
        if sides[0] is not None and sides[1] is not None:
            channels[split] = 0.5 * (sides[0] - sides[1]) / (ship.rpm * RPM if unit == "1/s" else 1.0)
    if "u" in given:
        channels["vn"], channels["ve"] = body_to_earth(given["u"], given["v"], given["psi"])
    meta = {**recording.meta, "derived": (), "time_unit": ship.time_unit}
    time = recording.time - recording.time[0]
    return _with_velocity(heading_across(replace(recording, time=time, channels=channels, meta=meta)), ship)


def _with_velocity(run: Recording, ship: Particulars) -> Recording:
    """Velocity over ground from the positions where it was not recorded: the smoother starts from it."""
    if "vn" in run.channels:
        return run
    vn, ve = (
        np.where(np.isfinite(run[k]), smoothed(run.time, run.filled(k), WINDOW * ship.time_unit)[1], np.nan)
        for k in ("x", "y")
    )
    return replace(run.with_channels(vn=vn, ve=ve), meta={**run.meta, "derived": ("vn", "ve")})


def common_step(runs: Sequence[Recording], ship: Particulars) -> float:
    """Step that several recordings are read off at [s]; one with longer steps is left with gaps.

    Returns:
        The step of the finest, but not less than ``MIN_STEP_S`` nor more than ``MAX_STEP`` ask for.
    """
    longest = MAX_STEP * ship.time_unit
    step = max(min(_whole_step(run) for run in runs), min(MIN_STEP_S, longest))
    return step / ceil(step / longest - 0.05)


def _whole_step(run: Recording) -> float:
    """Usual time between samples [s]: whole seconds or whole samples a second where written times only round it."""
    usual = run.step
    whole = float(round(usual)) if usual > 0.75 else 1.0 / round(1.0 / usual)
    return whole if abs(usual / whole - 1) < 0.01 else usual


def prepared(run: Recording, step: float, ship: Particulars, kind: str = "") -> Recording:
    """Put a recording on even times and take the noise out of its rudder and shaft.

    Args:
        run: From :func:`over_ground`.
        step: Time between samples [s].
        ship: For the rate of the steering gear.
        kind: What was sailed, as far as known.

    Returns:
        The recording with the channels ``MEASURED``, delta (noise taken out where the rudder rests), delta_order,
        order_lead and shaft; ``meta`` holds ``rudder_noise`` [rad], ``kind``, ``derived``, ``time_unit`` [s], and what
        :func:`~manoeuvre_nn.recording.holes.with_rudder` found.
    """
    even = with_rudder(_on_even_times(run, step), ship)
    shown = even["delta"]
    given = "delta_order" in even.channels
    order = even.filled("delta_order") if given else estimated_order(shown, step, ship.rudder_rate)
    if abs(order[0] - shown[0]) > ship.rudder_rate * step:
        order[0] = shown[0]  # the recording begins with a new order: until then the rudder was at rest
    delta, noise = smooth_rudder(shown, order, step, ship.rudder_rate)
    columns = measured(even)
    inputs = {
        "delta": delta,
        "delta_order": order,
        "order_lead": order_lead(shown, order, step, ship.rudder_rate),
        "shaft": smooth_shaft(columns[:, MEASURED.index("shaft_recorded")]),
    }
    inputs |= {split: smooth for split, *_ in SIDES if split in even.channels
               and np.abs(smooth := _smooth_split(even.filled(split))).max() > MIN_SPLIT}  # fmt: skip
    inputs |= {name: even[name] for name in HEEL if name in even.channels}
    derived = (*run.derived, *(() if given else ("delta_order",)))
    meta = {**even.meta, "rudder_noise": noise, "kind": kind, "derived": derived, "time_unit": ship.time_unit}
    return with_measured(replace(even, channels=inputs, meta=meta), columns)


def smooth_heel(run: Recording) -> dict[str, Float[np.ndarray, " n"]]:
    """Recorded heel [rad] without its noise, its rate [rad/s] and acceleration [rad/s^2].

    Args:
        run: Prepared, with ``phi`` and perhaps ``p``.

    Returns:
        phi, p, pdot.
    """
    window = HEEL_WINDOW * run.meta["time_unit"]
    phi, slope = smoothed(run.time, run.filled("phi"), window)
    p, pdot = smoothed(run.time, run.filled("p") if "p" in run.channels else slope, window)
    return {"phi": phi, "p": p, "pdot": pdot}


def _smooth_split(split: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Half the difference of two sides without the noise of either."""
    return uniform_filter1d(median_filter(split, 5, mode="nearest"), 5, mode="nearest")


def _on_even_times(run: Recording, step: float) -> Recording:
    """A recording read off at even times; nothing is made up where nothing was recorded."""
    # Several samples within a step are joined to their median. Where samples are rarer, each is moved to the nearest of
    # the new times along the straight line to its neighbour, and the other times stay empty.
    time = run.time
    even = step * np.arange(int(time[-1] / step + 1e-6) + 1)
    if len(even) == len(time) and np.abs(time - even).max() < 0.02 * step:
        return replace(run, time=even)
    place = np.minimum(np.rint(time / step).astype(int), len(even) - 1)
    fast = _whole_step(run) < 0.75 * step
    joined = {k: _joined(time, v, even, place, fast) for k, v in run.channels.items()}
    if "delta_order" in joined:  # an order stands until the next one
        latest = np.searchsorted(time, even + 1e-6 * step, side="right") - 1
        joined["delta_order"] = run.filled("delta_order")[latest]
        for begin, end in holes(time, np.isfinite(run["delta_order"]), run.step):
            joined["delta_order"][(even > begin + 1e-9) & (even < end - 1e-9)] = np.nan
    return replace(run, time=even, channels=joined)


def _joined(time: np.ndarray, values: np.ndarray, even: np.ndarray, place: np.ndarray, fast: bool) -> np.ndarray:
    """One channel at even times; ``place`` says which of them each sample is nearest to."""
    if fast:
        joined = pd.Series(values).groupby(place).median().reindex(range(len(even))).to_numpy(float, copy=True)
        ends = [0, -1]  # half a step on one side only: its median would be late or early
        joined[ends] = values[[np.abs(time - even[k]).argmin() for k in ends]]
        return joined
    good = np.isfinite(values)
    result = np.full(len(even), np.nan)
    hit = np.unique(place[good])
    result[hit] = np.interp(even[hit], time[good], values[good])
    return result


def estimated_order(shown: Float[np.ndarray, " n"], step: float, rate: float) -> Float[np.ndarray, " n"]:
    """Helm orders [rad] behind an angle shown at even steps [s]: while the rudder moves, where it will come to rest."""
    smooth = median_filter(shown, 5, mode="nearest")
    moving = np.abs(np.gradient(smooth, step)) > 0.25 * rate
    piece = np.cumsum(np.diff(moving, prepend=moving[0]))
    rest = pd.Series(shown).groupby(piece).transform("median").mask(moving)
    return rest.bfill().fillna(smooth[-1]).to_numpy(float, copy=True)


def smooth_rudder(
    recorded: Float[np.ndarray, " n"], order: Float[np.ndarray, " n"], step: float, rate: float
) -> tuple[Float[np.ndarray, " n"], float]:
    """Take the noise out of an indicated rudder angle where the rudder rests.

    While the rudder moves the record is kept: a mean would blur the ramp. It moves from a change of the order until the
    nominal gear would have arrived and two seconds more, and wherever the record itself moves: a slow gear, or an
    indicator that is late.

    Args:
        recorded: Indicated angle [rad].
        order: Helm order [rad].
        step: Time between samples [s].
        rate: Nominal rate of the gear [rad/s].

    Returns:
        The angle and the standard deviation of its noise [rad].
    """
    shown = followed(step * np.arange(len(order)), order, rate, start=recorded[0])
    busy = np.abs(np.diff(shown, prepend=shown[0])) > 1e-9
    reach = max(1, round(2.0 / step))
    busy = np.convolve(busy, np.ones(2 * reach + 1), mode="same") > 0
    busy |= np.abs(np.diff(order, prepend=order[0])) > 1e-9
    busy |= np.convolve(_moves(recorded, reach), np.ones(2 * reach + 1), mode="same") > 0
    result = recorded.copy()
    half = max(1, round(0.5 * RESTING_WINDOW_S / step))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], busy, [True]]).astype(int)))
    residuals = []
    for start, end in zip(edges[::2], edges[1::2], strict=False):
        piece = recorded[start:end]
        if len(piece) >= 3:
            wild, _ = far_off(piece - np.median(piece), MAX_RESTING_SDS, MIN_RESTING_SD)
            result[start:end] = _mean(np.where(wild, np.median(piece), piece), half)
            residuals.append(piece - result[start:end])
    if not residuals:
        return result, 0.0
    return result, robust_sd(np.concatenate(residuals))


def _moves(recorded: Float[np.ndarray, " n"], reach: int) -> Bool[np.ndarray, " n"]:
    """Where a noisy record moves on: medians so many samples before and after differ by more than noise makes them."""
    noise = max(robust_sd(np.diff(recorded)) / np.sqrt(2), MIN_RESTING_SD)
    middle = np.pad(median_filter(recorded, 2 * reach + 1, mode="nearest"), reach, mode="edge")
    return np.abs(middle[2 * reach :] - middle[: -2 * reach]) > MAX_RESTING_SDS * noise


def order_lead(
    recorded: Float[np.ndarray, " n"], order: Float[np.ndarray, " n"], step: float, rate: float
) -> Float[np.ndarray, " n"]:
    """When, between two samples, a new order was given: the nominal gear has moved the indicator since then.

    Args:
        recorded: Indicated angle [rad].
        order: Helm order [rad].
        step: Time between samples [s].
        rate: Nominal rate of the gear [rad/s].

    Returns:
        Share of the step before each sample, 0 where the order did not change.
    """
    lead = np.zeros_like(order)
    for k in np.flatnonzero(np.abs(np.diff(order)) > rate * step) + 1:
        rest = recorded[max(k - 3, 0) : k].mean() if np.ptp(order[max(k - 3, 0) : k]) == 0 else recorded[k - 1]
        lead[k] = np.clip((recorded[k] - rest) / (np.sign(order[k] - order[k - 1]) * rate * step), 0.0, 1.0)
    return lead


def _mean(piece: Float[np.ndarray, " n"], half: int) -> Float[np.ndarray, " n"]:
    """Mean over a window, shorter at the ends."""
    window, n = np.ones(2 * half + 1), len(piece)
    return (np.convolve(piece, window) / np.convolve(np.ones(n), window))[half : half + n]


def with_own_shafts(runs: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings whose shaft speed is what was ordered where they approach at other speeds than the nominal one.

    A shaft that is nominal on the approach and then falls off shows an engine at its limit. One that is another from
    the first sample on was ordered otherwise: it still drives the model, but says nothing of the engine.

    Args:
        runs: Prepared recordings of one ship.

    Returns:
        The recordings; without the measured shaft speed if one of them was ordered otherwise.
    """
    if all(abs(run["shaft"][0] - 1) <= MAX_NOMINAL_OFFSET for run in runs):
        return tuple(runs)
    return tuple(run.with_channels(shaft_recorded=np.full(len(run), np.nan)) for run in runs)


def smooth_shaft(ratio: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Shaft speed as an input of the model: 1 where it is nominal all the time, else the record without its noise.

    Args:
        ratio: Recorded shaft speed over the nominal one [-]; NaN in gaps.

    Returns:
        Ratio [-].
    """
    good = np.isfinite(ratio)
    if good.sum() < SHAFT_WINDOW:
        return np.ones_like(ratio)
    filled = np.interp(np.arange(len(ratio)), np.flatnonzero(good), ratio[good])
    smooth = uniform_filter1d(median_filter(filled, SHAFT_WINDOW, mode="nearest"), SHAFT_WINDOW // 2, mode="nearest")
    return smooth if np.abs(smooth - 1).max() > 0.01 else np.ones_like(ratio)
