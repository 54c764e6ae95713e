"""Wave spectra, the regular waves that a random sea is made of, and records of the sea or of what answers to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import gamma, pi, sqrt

import numpy as np
from jaxtyping import Complex, Float

from manoeuvre_nn.core.errors import InputError


@dataclass(frozen=True)
class WaveSpectrum:
    """A spectrum of Bretschneider's form, ``S = A w^-5 exp(-B w^-4)``: see :meth:`ittc` and :meth:`bretschneider`.

    Attributes:
        level: A [m^2/s^4].
        decay: B [1/s^4].
    """

    level: float
    decay: float

    @classmethod
    def ittc(cls, height: float, mean_period: float) -> "WaveSpectrum":
        """The two-parameter spectrum of the ITTC, ``A = 173 H^2/T^4`` and ``B = 691/T^4``.

        The two round numbers do not fit together fully: the height that the moments give is 1.0008 H.

        Args:
            height: Significant wave height H_1/3 [m].
            mean_period: Period T_1 of the average frequency, ``2 pi m0/m1`` [s].

        Returns:
            The spectrum.

        Source:
            ITTC 1972, as in Wang 1996, eqs 7.1 and 7.2.
        """
        _check_sea(height, mean_period)
        return cls(173.0 * height**2 / mean_period**4, 691.0 / mean_period**4)

    @classmethod
    def bretschneider(cls, height: float, zero_crossing_period: float) -> "WaveSpectrum":
        """The same by the mean period between upward zero crossings, ``A = 4 pi^3 H^2/T^4``, ``B = 16 pi^3/T^4``.

        With these ``m0 = H^2/16`` and ``2 pi sqrt(m0/m2) = T`` exactly.

        Args:
            height: Significant wave height H_s [m].
            zero_crossing_period: T_z [s].

        Returns:
            The spectrum.

        Source:
            Bretschneider 1959; with the mean zero-crossing period in ISSC and ITTC, see Journée & Massie 2001, ch. 5.
        """
        _check_sea(height, zero_crossing_period)
        return cls(4 * pi**3 * height**2 / zero_crossing_period**4, 16 * pi**3 / zero_crossing_period**4)

    def density(self, frequency: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Spectral density.

        Args:
            frequency: Wave frequency [rad/s], above 0.

        Returns:
            S [m^2 s].
        """
        return np.asarray(self.level * frequency**-5.0 * np.exp(-self.decay * frequency**-4.0))

    def moment(self, order: int) -> float:
        """Moment in closed form, ``m_n = A/4 B^(n/4 - 1) Gamma(1 - n/4)``.

        Args:
            order: n, below 4.

        Returns:
            ``int w^n S dw`` [m^2/s^n].

        Raises:
            InputError: If the moment does not exist.
        """
        if order >= 4:
            raise InputError(f"moment {order} of the spectrum is infinite: ask for 3 or less")
        return self.level / 4 * self.decay ** (order / 4 - 1) * gamma(1 - order / 4)


def _check_sea(height: float, period: float) -> None:
    """Refuse what is no sea."""
    if not (height > 0 and period > 0):
        raise InputError(f"a sea of {height} m and {period} s is none: write values above 0")


def significant_height(variance: float) -> float:
    """Significant height of a narrow-banded Gaussian sea.

    Args:
        variance: m0 [m^2].

    Returns:
        ``4 sqrt(m0)`` [m].

    Source:
        Longuet-Higgins 1952.
    """
    return 4 * sqrt(variance)


@dataclass(frozen=True)
class Waves:
    """Regular waves whose sum is a random sea, in one or more realisations.

    Attributes:
        frequency: Wave frequencies [rad/s].
        amplitude: Amplitudes [m].
        phase: Phases [rad], a row for each realisation.
    """

    frequency: Float[np.ndarray, " waves"]
    amplitude: Float[np.ndarray, " waves"]
    phase: Float[np.ndarray, "seas waves"]

    def moment(self, order: int) -> float:
        """Moment of what the waves carry, ``sum a^2/2 w^n``.

        Args:
            order: n.

        Returns:
            [m^2/s^n].
        """
        return float(np.sum(self.amplitude**2 / 2 * self.frequency**order))

    def record(
        self,
        time: Float[np.ndarray, " times"],
        transfer: Complex[np.ndarray, " waves"] | None = None,
        encounter: Float[np.ndarray, " waves"] | None = None,
    ) -> Float[np.ndarray, "seas times"]:
        """The sea at a point, or what answers linearly to it: ``sum Re[H a exp(i (w_e t + phase))]``.

        Args:
            time: Times [s].
            transfer: Answer H to a wave of 1 m with its crest at the point at time 0 [unit/m]; None is the sea itself.
            encounter: Frequencies at which the waves are met [rad/s]; None for a point at rest.

        Returns:
            Record [unit], a row for each realisation.
        """
        size = self.amplitude if transfer is None else transfer * self.amplitude
        swing = np.exp(1j * np.outer(self.frequency if encounter is None else encounter, time))
        return np.asarray(((size * np.exp(1j * self.phase)) @ swing).real)


def compose(spectrum: WaveSpectrum, low: float, high: float, count: int, seeds: Sequence[int]) -> Waves:
    """Evenly spaced regular waves with the energy of a spectrum and random phases.

    The record repeats itself after ``2 pi / dw``: take enough waves for the time that is wanted.

    Args:
        spectrum: The sea.
        low: Lowest frequency [rad/s].
        high: Highest frequency [rad/s].
        count: Number of waves, 2 or more.
        seeds: One for each realisation.

    Returns:
        The waves; ``a = sqrt(2 S dw)``, phases even over a turn.

    Raises:
        InputError: If the frequencies or the count make no band.

    Source:
        Wang 1996, eqs 7.3-7.6.
    """
    if not (0 < low < high and count >= 2):
        raise InputError(
            f"{count} waves from {low} to {high} rad/s make no band: write 0 < low < high and 2 waves or more"
        )
    frequency = np.linspace(low, high, count)
    amplitude = np.sqrt(2 * spectrum.density(frequency) * (high - low) / (count - 1))
    return Waves(frequency, amplitude, np.stack([np.random.default_rng(s).uniform(0, 2 * pi, count) for s in seeds]))
