"""Parameters of effects by neural posterior estimation: one flow for all effects, told which one it is asked about."""

import warnings
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial.rivals.examples import Examples, names, some_shelf
from studies.concealed_trial.rivals.pilot import MAX_NUMBERS, SIZE, pilot, told_of, values_of
from studies.concealed_trial.rivals.whitened import WhitenedRuns

FLOW: dict[str, Any] = {"model": "maf", "hidden_features": 40, "num_transforms": 3}
"""Masked autoregressive flow (Papamakarios et al. 2017)."""
PATIENCE, MAX_EPOCHS, RATE, BATCH = 15, 120, 1e-3, 128
"""Of the training: epochs without improvement, all epochs, learning rate of Adam, examples a step."""
BOX = 12.0
"""Largest number of a parameter."""
DRAWS = 400
"""Samples of a posterior."""
MISSING = 'the neural methods need sbi: write pip install -e ".[rivals]"'


class Posteriors:
    """Posterior of every effect's parameters, given what its first estimate is.

    Attributes:
        flow: sbi's density estimator.
    """

    def __init__(self, flow: nn.Module) -> None:
        """Take the flow."""
        self.flow = flow

    def __call__(self, data: WhitenedRuns, effect: Effect, seed: int = 0) -> dict[str, np.ndarray]:
        """Draw parameters.

        Args:
            data: The runs to fit.
            effect: The effect, on its ship.
            seed: Of the draws.

        Returns:
            Values of each parameter, ``DRAWS`` of them.
        """
        asked = np.array([name == effect.name for name in names()], float)
        return values_of(effect, self.drawn(np.concatenate([pilot(data, effect), asked]), seed))

    def drawn(self, condition: Float[np.ndarray, " c"], seed: int = 0) -> Float[np.ndarray, "n k"]:
        """Draw numbers.

        Args:
            condition: First estimate, and which effect is asked about.
            seed: Of the draws.

        Returns:
            One set a row.
        """
        self.flow.eval()
        with torch.no_grad(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            x = torch.as_tensor(condition, dtype=torch.float32)[None]
            found = self.flow.sample((DRAWS,), condition=x)  # type: ignore[operator]
        return np.clip(found[:, 0].double().numpy(), -BOX, BOX)


def fit_posteriors(data: Examples, seed: int) -> Posteriors:
    """Train the flow on every effect of every example (neural posterior estimation, Greenberg et al. 2019).

    Args:
        data: The examples.
        seed: Seed.

    Returns:
        The posteriors.

    Raises:
        InputError: If sbi is not installed.
    """
    try:
        from sbi.inference import NPE
        from sbi.utils import BoxUniform
        from sbi.utils.tracking import TensorBoardTracker
    except ImportError:
        raise InputError(MISSING) from None
    theta, x = pairs(data, seed)
    with TemporaryDirectory() as place, torch.random.fork_rng(devices=[]), warnings.catch_warnings():
        torch.manual_seed(seed)
        tracker = TensorBoardTracker(SummaryWriter(place))  # left to itself, sbi writes where it is called
        prior = BoxUniform(-BOX * torch.ones(MAX_NUMBERS), BOX * torch.ones(MAX_NUMBERS))
        trainer = NPE(prior, density_estimator=_builder(), tracker=tracker, show_progress_bars=False)
        warnings.simplefilter("ignore")  # columns of effects that no example has, and the last epoch
        flow = trainer.append_simulations(theta, x).train(
            training_batch_size=BATCH, learning_rate=RATE, stop_after_epochs=PATIENCE, max_num_epochs=MAX_EPOCHS
        )
    return Posteriors(flow)


def pairs(data: Examples, seed: int) -> tuple[Tensor, Tensor]:
    """Numbers and what the flow sees, one row for every effect of every example; numbers that mean nothing are noise.

    Args:
        data: The examples.
        seed: Of the noise.

    Returns:
        Both.
    """
    rows, columns = np.nonzero(np.isfinite(data.targets[..., 0]))
    theta, listed = data.targets[rows, columns].copy(), names()
    counts = np.array([_parameters().get(listed[k], 0) for k in columns])
    idle = np.arange(MAX_NUMBERS) >= counts[:, None]
    theta[idle] = np.random.default_rng(seed).standard_normal(int(idle.sum()))
    x = np.concatenate([data.pilots[rows, columns], np.eye(len(listed))[columns]], axis=1)
    return torch.as_tensor(theta, dtype=torch.float32), torch.as_tensor(x, dtype=torch.float32)


def untrained() -> nn.Module:
    """A flow of the right shape, for loading what was learnt.

    Returns:
        The flow.
    """
    noise = torch.Generator().manual_seed(0)
    theta, x = (torch.randn((8, width), generator=noise) for width in (MAX_NUMBERS, SIZE + len(names())))
    return _builder()(theta, x)


def _parameters() -> dict[str, int]:
    """How many parameters an answer reports of every effect."""
    return {e.name: len(told_of(e)) for e in some_shelf()}


def _builder() -> Any:
    """The maker of the flow, by sbi."""
    try:
        from sbi.neural_nets import posterior_nn
    except ImportError:
        raise InputError(MISSING) from None
    return posterior_nn(**FLOW, z_score_x="none", z_score_theta="independent")
