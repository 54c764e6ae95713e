"""Runs with no plan of turning: straight, and with a random rudder."""

import numpy as np

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage, check_count, check_degrees, check_duration


def straight(duration: float | None = None, name: str = "straight") -> Manoeuvre:
    """Rudder amidships for a time [s]; by default the ship's usual record."""
    check_duration("manoeuvre duration", duration)
    return Manoeuvre(name, "straight", (Stage(0.0),), duration=duration)


def random_rudder(
    rudder_deg: float = 20.0,
    shortest_period: float = 20.0,
    duration: float = 600.0,
    seed: int = 0,
    interval: float | None = None,
    name: str | None = None,
) -> Manoeuvre:
    """A random rudder whose orders hold no period shorter than a given one.

    White Gaussian numbers are cut off in the frequency domain above ``1 / shortest_period``, scaled to a standard
    deviation of half the largest angle, and clipped at the largest angle.

    Args:
        rudder_deg: Largest rudder angle [deg].
        shortest_period: Shortest period in the orders [s].
        duration: Length of the run [s].
        seed: Seed of the random numbers.
        interval: Time between orders [s]; by default a quarter of the shortest period.
        name: Short name; by default ``random0`` after the seed.

    Returns:
        The manoeuvre.

    Raises:
        InputError: If a setting makes no sense, or the shortest period is not resolved by the interval, or longer than
            the run.
    """
    rudder = check_degrees("manoeuvre rudder_deg", rudder_deg)
    check_duration("manoeuvre duration", duration)
    check_duration("manoeuvre shortest_period", shortest_period)
    check_duration("manoeuvre interval", interval)
    interval = shortest_period / 4 if interval is None else interval
    if not 2 * interval <= shortest_period <= duration:
        raise InputError(
            f"manoeuvre shortest_period={shortest_period}: expected between {2 * interval:g} s (two intervals) and "
            f"the duration, {duration:g} s"
        )
    check_count(f"manoeuvre duration={duration}, shortest_period={shortest_period}", duration / interval)
    if not seed >= 0:
        raise InputError(f"manoeuvre seed={seed}: expected a whole number, 0 or more")
    count = int(duration / interval) + 1
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    spectrum[np.fft.rfftfreq(count, interval) > 1 / shortest_period] = 0.0
    orders = np.fft.irfft(spectrum, count)
    orders = np.clip(orders * 0.5 * rudder / orders.std(), -rudder, rudder)
    stages = tuple(Stage(float(order), hold=interval) for order in orders)
    return Manoeuvre(name or f"random{seed}", "random_rudder", stages, duration=duration)
