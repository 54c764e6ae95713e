"""A neural classifier of cases: an ensemble of networks from features to the probability of every effect."""

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file
from studies.concealed_trial.rivals.examples import STRANGE, Examples, names
from studies.concealed_trial.rivals.features import COUNT, mirrored
from studies.concealed_trial.rivals.posterior import Posteriors, fit_posteriors, untrained

MEMBERS, HIDDEN, DROPOUT = 5, 160, 0.3
"""Networks of the ensemble, width of their two layers, share of neurons left out in training."""
RATE, DECAY, BATCH = 2e-3, 3e-3, 128
"""Of AdamW: learning rate, weight decay, examples a step."""
MAX_EPOCHS, PATIENCE = 80, 10
HELD_BACK = 0.12
"""Share of the examples by which training is stopped and logits are tempered."""
TEMPERATURES = np.linspace(0.7, 2.5, 19)


@dataclass(frozen=True)
class NeuralDiagnosis:
    """What was learnt.

    Attributes:
        mean: Of the features.
        sd: Their standard deviation.
        members: Networks from standardised features to a logit of every name.
        temperature: Logits are divided by it.
        posteriors: Of the parameters; None where only names were learnt.
    """

    mean: Float[np.ndarray, " f"]
    sd: Float[np.ndarray, " f"]
    members: list[nn.Module]
    temperature: float
    posteriors: Posteriors | None

    def standard(self, features: Float[np.ndarray, "*n f"]) -> Float[np.ndarray, "*n f"]:
        """Features with mean 0 and variance 1, outliers drawn in."""
        return np.clip((features - self.mean) / self.sd, -8.0, 8.0)

    def probabilities(self, features: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n c"]:
        """Probability that each of :func:`.names` acts."""
        x = torch.as_tensor(self.standard(features), dtype=torch.float32)
        return torch.sigmoid(_logits(self.members, x) / self.temperature).double().numpy()


def learn(data: Examples, seed: int = 0, with_posteriors: bool = True) -> NeuralDiagnosis:
    """Train the networks, and the flow for parameters.

    Args:
        data: Examples.
        seed: Seed.
        with_posteriors: Whether to train the flow.

    Returns:
        What was learnt.
    """
    mean, sd = data.features.mean(axis=0), data.features.std(axis=0) + 1e-3
    frame = NeuralDiagnosis(mean, sd, [], 1.0, None)
    cut = int(len(data.features) * (1 - HELD_BACK))
    train, check = data.some(slice(0, cut)), data.some(slice(cut, None))
    # A ship that turns the other way is a case of its own: the mirror image has the same effects.
    both = np.concatenate([train.features, mirrored(train.features)])
    x, y = _tensor(frame.standard(both)), _tensor(np.concatenate([train.present, train.present]))
    x_check, y_check = _tensor(frame.standard(check.features)), _tensor(check.present)
    members = [_member(x, y, x_check, y_check, seed + k) for k in range(MEMBERS)]
    logits = _logits(members, x_check)
    losses = [float(nn.functional.binary_cross_entropy_with_logits(logits / t, y_check)) for t in TEMPERATURES]
    temperature = float(TEMPERATURES[int(np.argmin(losses))])
    flow = fit_posteriors(data, seed) if with_posteriors else None
    return NeuralDiagnosis(mean, sd, members, temperature, flow)


def _tensor(values: np.ndarray) -> Tensor:
    """In single precision."""
    return torch.as_tensor(values, dtype=torch.float32)


def _network() -> nn.Module:
    """Two hidden layers."""
    return nn.Sequential(
        nn.Linear(COUNT, HIDDEN), nn.ReLU(), nn.Dropout(DROPOUT),
        nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Dropout(DROPOUT),
        nn.Linear(HIDDEN, len(names())),
    )  # fmt: skip


def _member(x: Tensor, y: Tensor, x_check: Tensor, y_check: Tensor, seed: int) -> nn.Module:
    """One network, as it was when the examples held back were explained best."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = _network()
        optimiser = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=DECAY)
        best, kept, waited = np.inf, net.state_dict(), 0
        for _ in range(MAX_EPOCHS):
            net.train()
            for rows in torch.randperm(len(x)).split(BATCH):
                optimiser.zero_grad()
                nn.functional.binary_cross_entropy_with_logits(net(x[rows]), y[rows]).backward()
                optimiser.step()
            loss = float(nn.functional.binary_cross_entropy_with_logits(_logits([net], x_check), y_check))
            waited += 1
            if loss < best:
                best, waited = loss, 0
                kept = {name: value.clone() for name, value in net.state_dict().items()}
            if waited >= PATIENCE:
                break
    net.load_state_dict(kept)
    return net


def _logits(members: list[nn.Module], x: Tensor) -> Tensor:
    """Mean logit of every name."""
    with torch.no_grad():
        return torch.stack([m.eval()(x) for m in members]).mean(dim=0)


def save(learnt: NeuralDiagnosis, path: Path) -> None:
    """Write what was learnt.

    Args:
        learnt: It, with posteriors.
        path: The file.
    """
    assert learnt.posteriors is not None
    state: dict[str, Any] = {"mean": torch.as_tensor(learnt.mean), "sd": torch.as_tensor(learnt.sd)}
    state |= {"temperature": learnt.temperature, "members": [m.state_dict() for m in learnt.members]}
    content = BytesIO()
    torch.save(state | {"flow": learnt.posteriors.flow.state_dict(), "names": names()}, content)
    write_file(path, content.getvalue())


def load(path: Path) -> NeuralDiagnosis:
    """Read what was learnt.

    Args:
        path: The file.

    Returns:
        It.

    Raises:
        InputError: If there is no file, or it was made for another shelf.
    """
    if not path.is_file():
        raise InputError(f"model={path} does not exist: write method=neural train=10000 seed=SEED model={path} first")
    state: Mapping[str, Any] = torch.load(path, weights_only=True)
    if tuple(state["names"]) != names() or len(state["mean"]) != COUNT:
        raise InputError(f"model={path} was trained for other effects or features: train it anew")
    members = []
    for weights in state["members"]:
        members.append(_network())
        members[-1].load_state_dict(weights)
    flow = untrained()
    flow.load_state_dict(state["flow"])
    return NeuralDiagnosis(
        state["mean"].numpy(), state["sd"].numpy(), members, float(state["temperature"]), Posteriors(flow)
    )


def accuracy(learnt: NeuralDiagnosis, test: Examples) -> dict[str, float]:
    """How often the most probable names are right.

    Args:
        learnt: What was learnt.
        test: Examples that it has not seen.

    Returns:
        Share of cases with something in them whose first name acts, of pairs with both among the first two, and of
        strange cases called ``unknown``.
    """
    p, listed = learnt.probabilities(test.features), names()
    order, count = np.argsort(-p, axis=1), test.present.sum(axis=1)
    rows = np.arange(len(p))
    first = test.present[rows, order[:, 0]] > 0
    both = first & (test.present[rows, order[:, 1]] > 0)
    strange = test.present[:, listed.index(STRANGE)] > 0
    return {
        "first": float(first[(count > 0) & ~strange].mean()),
        "both": float(both[count == 2].mean()),
        "unknown": float(first[strange].mean()),
    }
