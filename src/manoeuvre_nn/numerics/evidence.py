"""How far weights are to be shrunk, said by the data themselves: MacKay's evidence for a weight decay."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class WeightDecay:
    """Prior and noise of K independent least-squares problems.

    The weights are ``N(0, 1/alpha)`` and the errors ``N(0, 1/beta)``, so that ``|e|^2 + alpha/beta |w|^2`` is to be
    least: errors beside which further ones, ``sqrt(alpha/beta) w``, are stacked.

    Attributes:
        alpha: One over the variance of the weights; 0 where nothing is shrunk.
        beta: One over the variance of the errors.
        effective: Number of weights that the data determine, gamma.

    Source:
        MacKay 1992; Foresee & Hagan 1997 for its use with Levenberg-Marquardt.
    """

    alpha: Float[Tensor, " k"]
    beta: Float[Tensor, " k"]
    effective: Float[Tensor, " k"]

    @property
    def ratio(self) -> Float[Tensor, " k"]:
        """``alpha/beta``."""
        return self.alpha / self.beta

    def residuals(self, errors: Float[Tensor, "k n"], weights: Float[Tensor, "k p"]) -> Float[Tensor, "k residuals"]:
        """Errors, and what stands for the prior."""
        return torch.cat([errors, self.ratio.sqrt()[:, None] * weights], 1)

    def normal_equations(
        self, normal: Float[Tensor, "k p p"], gradient: Float[Tensor, "k p"], weights: Float[Tensor, "k p"]
    ) -> tuple[Float[Tensor, "k p p"], Float[Tensor, "k p"]]:
        """Those of the residuals, from those of the errors.

        Args:
            normal: J^T J of the errors.
            gradient: J^T e.
            weights: w.

        Returns:
            ``J^T J + alpha/beta I`` and ``J^T e + alpha/beta w``.
        """
        shrunk = normal.clone()
        shrunk.diagonal(dim1=1, dim2=2).add_(self.ratio[:, None])
        return shrunk, gradient + self.ratio[:, None] * weights

    def again(
        self, normal: Float[Tensor, "k p p"], errors: Float[Tensor, "k n"], weights: Float[Tensor, "k p"]
    ) -> "WeightDecay":
        """Estimate once more, at weights that are least under the present prior.

        ``gamma = sum_i l_i / (l_i + alpha/beta)``, ``alpha = gamma / |w|^2``, ``beta = (N - gamma) / |e|^2``, l the
        eigenvalues of J^T J. Where this changes nothing any more, the evidence is greatest.

        Args:
            normal: J^T J of the errors.
            errors: e.
            weights: w.

        Returns:
            The new estimate. It leaves the errors at least one degree of freedom; that of a problem with errors that
            are no numbers stays as it was.

        Source:
            MacKay 1992, "Bayesian interpolation", section 4.
        """
        finite = normal.isfinite().all(-1).all(-1) & errors.isfinite().all(1)
        size = torch.linalg.eigvalsh(torch.where(finite[:, None, None], normal, 0.0)).clamp(min=0)
        tiny = torch.finfo(errors.dtype).tiny
        heard = size > normal.shape[1] * torch.finfo(size.dtype).eps * size.amax(1, keepdim=True)
        effective = torch.where(heard, size / (size + self.ratio[:, None]).clamp(min=tiny), 0.0).sum(1)
        free = (errors.shape[1] - effective).clamp(min=1.0)
        alpha = effective / weights.square().sum(1).clamp(min=tiny)
        found = alpha, free / errors.square().sum(1).clamp(min=tiny), effective
        kept = self.alpha, self.beta, self.effective
        return WeightDecay(*(torch.where(finite, new, old) for new, old in zip(found, kept, strict=True)))

    def log_evidence(
        self, normal: Float[Tensor, "k p p"], errors: Float[Tensor, "k n"], weights: Float[Tensor, "k p"]
    ) -> Float[Tensor, " k"]:
        """Logarithm of the marginal likelihood of the data, exact for a linear model.

        ``(N ln(beta/2 pi) + P ln alpha - beta |e|^2 - alpha |w|^2 - ln det(beta J^T J + alpha I)) / 2``

        Args:
            normal: J^T J of the errors.
            errors: e at the weights that are least under this prior.
            weights: These weights.

        Returns:
            One number a problem.

        Source:
            MacKay 1992, "Bayesian interpolation", section 4.
        """
        curvature = self.beta[:, None, None] * normal
        curvature.diagonal(dim1=1, dim2=2).add_(self.alpha[:, None])
        fit = self.beta * errors.square().sum(1) + self.alpha * weights.square().sum(1)
        counts = errors.shape[1] * (self.beta / (2 * torch.pi)).log() + weights.shape[1] * self.alpha.log()
        return 0.5 * (counts - fit - torch.logdet(curvature))


def nothing_shrunk(weights: Float[Tensor, "k p"]) -> WeightDecay:
    """What a fit begins with: alpha 0, beta 1.

    Args:
        weights: Weights of every problem.

    Returns:
        The prior of the first step.

    Source:
        Foresee & Hagan 1997.
    """
    one = torch.ones_like(weights[:, 0])
    return WeightDecay(0 * one, one, weights.shape[1] * one)
