"""Unknowns with Gaussian priors from inner products of columns: mean, covariance and log evidence in closed form.

With G the inner products of the unknowns' columns, g those with the data, P the data's own and S the diagonal of the
prior standard deviations, the posterior precision is ``G + S^-2`` and

    log evidence = log_norm - 1/2 (P - g^T (G + S^-2)^-1 g) - 1/2 log det (S G S + 1).

The prior of the first unknowns (coefficients of a model) may be scaled by a factor that is not known. Eliminating the
others and taking the eigenvalues of what is left gives all of this for every factor at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ReducedNormalEquations:
    """What recordings say of the unknowns c, whatever their prior: the others o, whose prior is fixed, are eliminated.

    Attributes:
        log_norm: Log normaliser of the samples, less 1/2 log det (G_oo + 1).
        power: P - g_o^T (G_oo + 1)^-1 g_o.
        prior: Prior standard deviations of all.
        inverse: (G_oo + 1)^-1.
        cross: G_oc.
        pull: g_o.
        left: S = G_cc - G_co (G_oo + 1)^-1 G_oc.
        own: g_c - G_co (G_oo + 1)^-1 g_o.
    """

    log_norm: float
    power: float
    prior: Float[np.ndarray, " m"]
    inverse: Float[np.ndarray, "o o"]
    cross: Float[np.ndarray, "o c"]
    pull: Float[np.ndarray, " o"]
    left: Float[np.ndarray, "c c"]
    own: Float[np.ndarray, " c"]

    def by(self, root: Float[np.ndarray, "c c"]) -> "ReducedNormalEquations":
        """The same for other unknowns e, ``c = R e``: independent ones where ``R R^T`` is the prior covariance of c.

        Args:
            root: R.

        Returns:
            With ``R^T S R``.
        """
        left, own = root.T @ self.left @ root, root.T @ self.own
        return replace(self, left=left, own=own, cross=self.cross @ root)

    def posterior(self, scales: Sequence[float] = (1.0,)) -> "Posterior":
        """Combine them with the prior of c.

        Args:
            scales: Factors on its standard deviation.

        Returns:
            The posterior.
        """
        sizes, axes = np.linalg.eigh(0.5 * (self.left + self.left.T))
        sizes, along = np.maximum(sizes, 0.0), axes.T @ self.own
        factors = np.array(scales, dtype=float)
        square = factors[:, None] ** 2
        misfit = self.power - (square * along**2 / (1 + square * sizes)).sum(1)
        evidence = self.log_norm - 0.5 * misfit - 0.5 * np.log1p(square * sizes).sum(1)
        return Posterior(evidence, misfit, factors, axes, sizes, along, self)


@dataclass(frozen=True)
class Posterior:
    """What recordings say of unknowns, as deviations from their prior means, at every scale of the prior.

    Unknowns are in units of their prior standard deviations here; c are those whose prior is scaled, o the others.

    Attributes:
        evidence: Log marginal likelihood at every scale.
        misfit: Square of what is left of the data in its own metric, at every scale.
        scales: The scales.
        axes: Eigenvectors of S, what is left of G_cc.
        sizes: Its eigenvalues.
        along: What is left of g_c, along the eigenvectors.
        equations: What they follow from.
    """

    evidence: Float[np.ndarray, " s"]
    misfit: Float[np.ndarray, " s"]
    scales: Float[np.ndarray, " s"]
    axes: Float[np.ndarray, "c c"]
    sizes: Float[np.ndarray, " c"]
    along: Float[np.ndarray, " c"]
    equations: ReducedNormalEquations

    def _variances(self, scale: int) -> Float[np.ndarray, " c"]:
        """Posterior variances of c along the eigenvectors: (S + scale^-2)^-1."""
        square = self.scales[scale] ** 2
        return square / (1 + square * self.sizes)

    def evidence_at(self, scales: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Log marginal likelihood at other scales of the prior.

        Args:
            scales: Factors on the prior standard deviation of c.

        Returns:
            One a scale.
        """
        square = np.append(self.scales[0], scales)[:, None] ** 2
        gain = 0.5 * (square * self.along**2 / (1 + square * self.sizes) - np.log1p(square * self.sizes)).sum(axis=1)
        return self.evidence[0] + gain[1:] - gain[0]

    def mean(self, scale: int = 0) -> Float[np.ndarray, " m"]:
        """Most likely deviations."""
        c = self.axes @ (self._variances(scale) * self.along)
        known = self.equations
        return np.concatenate([c, known.inverse @ (known.pull - known.cross @ c)]) * known.prior

    def covariance(self, scale: int = 0) -> Float[np.ndarray, "m m"]:
        """Covariance of the unknowns."""
        # With K = (G_oo + 1)^-1 G_oc: [[C, -C K^T], [-K C, (G_oo + 1)^-1 + K C K^T]].
        c, known = (self.axes * self._variances(scale)) @ self.axes.T, self.equations
        follow = known.inverse @ known.cross
        below = -follow @ c
        whole = np.block([[c, below.T], [below, known.inverse - below @ follow.T]])
        return whole * known.prior[:, None] * known.prior


def mixture(
    shares: Float[np.ndarray, " n"],
    means: Float[np.ndarray, "n m"],
    covariances: Sequence[Float[np.ndarray, "m m"]],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Mean and covariance of a mixture: the covariance within its parts and that of their means.

    ``m = sum_k w_k m_k`` and ``C = sum_k w_k (C_k + (m_k - m) (m_k - m)^T)``, the law of total variance.

    Args:
        shares: Weight of each part; their sum is 1.
        means: One row a part.
        covariances: One a part.

    Returns:
        Mean, covariance.
    """
    mean = shares @ means
    within = sum(w * c for w, c in zip(shares, covariances, strict=True))
    return mean, within + (means - mean).T @ ((means - mean) * shares[:, None])


def posterior(
    gram: Float[np.ndarray, "q q"],
    log_norm: float,
    prior: Float[np.ndarray, " m"],
    data: Float[np.ndarray, " q"],
    scales: Sequence[float] = (1.0,),
    scaled: int | None = None,
) -> Posterior:
    """Combine inner products with the prior.

    Args:
        gram: Inner products of all columns; those of the unknowns stand last.
        log_norm: Log normaliser of the samples.
        prior: Prior standard deviations.
        data: What is to be explained, as a combination of all columns.
        scales: Factors on the prior standard deviation of the first unknowns.
        scaled: How many these are; None is all.

    Returns:
        The posterior; inner products that are not finite are refused as by :func:`reduced`.
    """
    return reduced(gram, log_norm, prior, data, scaled).posterior(scales)


def reduced(
    gram: Float[np.ndarray, "q q"],
    log_norm: float,
    prior: Float[np.ndarray, " m"],
    data: Float[np.ndarray, " q"],
    scaled: int | None = None,
) -> ReducedNormalEquations:
    """Eliminate the unknowns whose prior is fixed: see :func:`posterior`.

    Returns:
        What is left of the others.

    Raises:
        LinAlgError: If the inner products are not finite.
    """
    m = len(prior)
    k = m if scaled is None else scaled
    at = slice(len(gram) - m, len(gram))
    whole = gram[at, at] * prior[:, None] * prior
    right = gram @ data
    if not np.isfinite(whole).all():
        raise np.linalg.LinAlgError("the columns of the unknowns are not finite")
    pull, cross = right[at] * prior, whole[k:, :k]
    values, vectors = np.linalg.eigh(0.5 * (whole[k:, k:] + whole[k:, k:].T))
    others = np.maximum(values, 0.0) + 1  # what rounding took below the prior is the prior
    inverse = (vectors / others) @ vectors.T
    known = inverse @ pull[k:]
    return ReducedNormalEquations(
        log_norm=log_norm - 0.5 * float(np.log(others).sum()),
        power=float(data @ right) - float(pull[k:] @ known),
        prior=prior,
        inverse=inverse,
        cross=cross,
        pull=pull[k:],
        left=whole[:k, :k] - cross.T @ inverse @ cross,
        own=pull[:k] - cross.T @ known,
    )
