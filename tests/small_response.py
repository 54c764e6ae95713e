"""A response of two variables, 120 records of it, and a trainer without any logging: for fits of responses."""

import lightning as L
import torch
from fleet import unchecked
from torch.utils.data import DataLoader

from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.response import Quantities, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.training.fits import Fit

X = torch.rand(120, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
Y = (torch.sin(5 * X[:, :1]) + X[:, 1:] ** 2) * 3 + 7
OTHERS = torch.rand(200, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def response(network: Network) -> Response:
    scaling = Scaling(X.mean(0), X.std(0), Y.std(0), Y.mean(0))
    a, b, y = (Variable(name, "", 1.0, name) for name in "aby")
    return Response(network, scaling, Quantities([a, b], y, ["a", "b"]))


def trained(fit: Fit, epochs: int = 100, count: int = 120, noise: float = 0.0, repeats: int = 1) -> L.Trainer:
    """Train on the first records, with noise of this standard deviation, each given so many times."""
    generator = torch.Generator().manual_seed(2)
    y = Y[:count] + noise * torch.randn(count, 1, generator=generator, dtype=torch.float64)
    trainer = L.Trainer(
        max_epochs=epochs, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    )  # fmt: skip
    with unchecked():
        trainer.fit(
            fit, DataLoader([(X[:count].repeat(repeats, 1), y.repeat(repeats, 1), X[:0], Y[:0])], batch_size=None)
        )
    return trainer


def error_elsewhere(model: Response) -> float:
    right = (torch.sin(5 * OTHERS[:, 0]) + OTHERS[:, 1] ** 2) * 3 + 7
    with torch.no_grad():
        return float((model(OTHERS) - right).square().mean().sqrt())
