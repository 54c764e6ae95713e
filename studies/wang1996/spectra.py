"""Wave spectra, the regular waves that a random sea is made of, and records of the sea or of what answers to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import gamma, pi, sqrt

import numpy as np
from jaxtyping import Complex, Float

from manoeuvre_nn.core.errors import InputError


@dataclass(frozen=True)
class IttcSpectrum:
    """The two-parameter spectrum of the ITTC, ``S = A w^-5 exp(-B w^-4)``.

    ``A = 173 H^2/T^4`` and ``B = 691/T^4`` with the significant height H and the mean period T. The two round numbers
    do not fit together fully: the height that the moments give is 1.0008 H.

    Attributes:
        height: Significant wave height H_1/3 [m].
        period: Period T_1 of the average frequency, ``2 pi m0/m1`` [s].

    Source:
        ITTC 1972, as in Wang 1996, eqs 7.1 and 7.2.
    """

    height: float
    period: float

    def __post_init__(self) -> None:
        """Refuse what is no sea.

        Raises:
            InputError: If height or period is not above 0.
        """
        if not (self.height > 0 and self.period > 0):
            raise InputError(f"a sea of {self.height} m and {self.period} s is none: write values above 0")

    @property
    def parameters(self) -> tuple[float, float]:
        """A [m^2/s^4] and B [1/s^4]."""
        return 173.0 * self.height**2 / self.period**4, 691.0 / self.period**4

    def density(self, frequency: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Spectral density.

        Args:
            frequency: Wave frequency [rad/s], above 0.

        Returns:
            S [m^2 s].
        """
        a, b = self.parameters
        return np.asarray(a * frequency**-5.0 * np.exp(-b * frequency**-4.0))

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
            raise InputError(f"moment {order} of the ITTC spectrum is infinite: ask for 3 or less")
        a, b = self.parameters
        return a / 4 * b ** (order / 4 - 1) * gamma(1 - order / 4)


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


def compose(spectrum: IttcSpectrum, low: float, high: float, count: int, seeds: Sequence[int]) -> Waves:
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
