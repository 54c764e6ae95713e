"""A diagnosis as one HTML file that needs nothing else, on a phone, light or dark; and in TensorBoard."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread
from torch.utils.tensorboard import SummaryWriter

from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.report.diagnosis_charts import diagnosis_charts
from manoeuvre_nn.report.diagnosis_tables import (
    FOUND,
    alias_texts,
    cause_rows,
    check_rows,
    diagnosis_markdown,
    error_rows,
    main_causes,
    outcomes,
    parameter_rows,
    site_rows,
    verdict_text,
)
from manoeuvre_nn.report.html import Picture, picture, write_page

CAPTIONS = {
    "probabilities": "Probability of each cause",
    "tracks": "Tracks of the held-out runs: recorded, by the calm-water model and by the repaired model",
    "errors": "RMS errors over the measurement noise, before and after",
    "where": "Places at which something is missing",
    "residual": "Missing force over time, shaded where it was located",
    "channels": "Channels over time and their errors",
    "planned": "Planned runs as predicted, with the band that 95 % of recordings lie in",
}
"""What a screen reader says of each kind of figure."""


def diagnosis_html(d: Diagnosis, figures: Mapping[str, Figure], path: Path) -> None:
    """Write a diagnosis as a page: the summary first, then causes, proof, place, what speaks against it, what to do."""
    charts = diagnosis_charts(d)

    def images(*kinds: str) -> list[Picture]:
        """Figures of some kinds: ``residual/r01`` is of the kind ``residual``."""
        named = [(name, *name.partition("/")[::2]) for name in figures]
        return [
            picture(CAPTIONS[kind] + (f", run {run}" if run else ""), figures[name], charts.get(name))
            for name, kind, run in named
            if kind in kinds
        ]

    write_page(
        path,
        "diagnosis.html",
        d=d,
        images=images,
        verdict=verdict_text(d),
        alias=alias_texts(d),
        outcomes=outcomes(d),
        causes=[{k: v for k, v in row.items() if k != FOUND} for row in cause_rows(d, main_causes(d))],
        parameters=parameter_rows([cause for cause in d.causes if cause.name in d.model]),
        errors=error_rows(d),
        sites=site_rows(d),
        checks=check_rows(d),
        everything=[
            {k: row[k] for k in ("cause", "probability", "ln B", FOUND)}
            | {"how it is recognised": cause.fingerprint, "source": cause.source}
            for cause, row in zip(d.causes, cause_rows(d, d.causes), strict=True)
        ],
        settings=[{"setting": name, "value": value} for name, value in d.settings.items()],
    )


def log_to_tensorboard(d: Diagnosis, pictures: Mapping[str, Path], folder: Path) -> None:
    """Write figures from their PNGs, the summary, probabilities and errors to a folder where TensorBoard finds them."""
    scalars = {f"probability/{cause.name}": cause.probability for cause in d.causes}
    for name, errors in (*((when, d.rmse(when)) for when in ("before", "alone", "after")), ("noise", d.noise)):
        scalars |= {f"rmse_{name}/{channel}": error for channel, error in errors.items()}
    with SummaryWriter(str(folder)) as writer:
        writer.add_text("diagnosis", diagnosis_markdown(d))
        for name, value in scalars.items():
            if np.isfinite(value):
                writer.add_scalar(name, value)
        for name, path in pictures.items():
            writer.add_image(name, imread(path), dataformats="HWC")
