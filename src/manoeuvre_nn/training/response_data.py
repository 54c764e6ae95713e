"""Records of a response in, features and targets of a network out: computed by seakeeping or read from a table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import lightning as L
import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.stats import qmc
from torch import Tensor
from torch.utils.data import DataLoader

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.response import Quantities, Records, Response, check_records
from manoeuvre_nn.core.terminal import Say
from manoeuvre_nn.recording.read.records import RecordsMapping, read_records
from manoeuvre_nn.seakeeping.form import HullForm
from manoeuvre_nn.seakeeping.pitch import MAX_DRAUGHT_RATIO, METHODS, MIN_DRAUGHT_RATIO, significant_pitch
from manoeuvre_nn.training.data import Batch
from manoeuvre_nn.training.settings import expand

MIN_STANDARD_ERRORS = 3.0
"""Standard errors from which on a difference of two correlations is told."""
CONDITIONS = ("d", "V", "beta", "Hs", "T")
"""What pitch is computed from, in the order of :func:`.significant_pitch`."""
MIN_LEARNT = 2
"""Records that have a spread."""
LEARNING, VALIDATION, TESTING, BETWEEN = "learning", "validation", "testing", "between"
"""Sets of records: learnt, kept back for a fit's stopping rule or a search, those that test, random points between."""


@dataclass(frozen=True)
class Split:
    """Which records are learnt from.

    Attributes:
        learning: Share of the records that is learnt from, drawn at random; the others test.
        validation: Share of the learnt ones that is kept back for a fit's own stopping rule.
        seed: Seed of the draw.
    """

    learning: float = 0.5
    validation: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what leaves nothing to learn.

        Raises:
            InputError: If a share is out of range.
        """
        if not 0 < self.learning <= 1:
            raise InputError(f"learning={self.learning}: expected a share of the records, more than 0, at most 1")
        if not 0 <= self.validation < 1:
            raise InputError(f"data.validation={self.validation}: expected a share from 0 to below 1")


class ResponseData(L.LightningDataModule):
    """Records of a response, split by sampling into those that are learnt and those that test.

    Attributes:
        quantities: Variables, once set up with the range of the records, and response.
        records: All records but those between.
        between: Records at random points, wherever the others lie; None if there are none.
        say: Is told what is being computed.
    """

    records: Records
    between: Records | None
    say: Say = staticmethod(lambda *_: None)

    def __init__(
        self,
        quantities: Quantities,
        make: Callable[[Say], tuple[Records, Records | None]],
        split: Split | None = None,
        dtype: torch.dtype = torch.float64,
        notes: Sequence[str] = (),
    ) -> None:
        """Store where the records come from.

        Args:
            quantities: Variables and the response.
            make: Computes or hands out the records, and those between.
            split: Which records are learnt from.
            dtype: Floating type.
            notes: What should be known before anything is learnt, a line each.
        """
        super().__init__()
        self.quantities = quantities
        self.make, self.split, self.dtype, self.notes = make, split or Split(), dtype, notes

    def setup(self, stage: str | None = None) -> None:
        """Compute the records, and take their ranges over."""
        if hasattr(self, "records"):
            return
        self.records, self.between = self.make(self.say)
        check_records(self.records)
        split, learnt = self.split, len(self.rows[LEARNING])
        if learnt < MIN_LEARNT:
            raise InputError(
                f"learning={split.learning:g} and data.validation={split.validation:g} of {len(self.records)} records "
                f"leave {learnt} to learn from: expected {MIN_LEARNT} or more"
            )
        low, high = self.records.conditions.min(0), self.records.conditions.max(0)
        ends = list(zip(self.quantities.inputs, low.tolist(), high.tolist(), strict=True))
        for v, a, b in ends:
            if not a < b:
                raise InputError(f"{v.name} is {a / v.size:g} {v.unit} in every record: leave it out, ~inputs.{v.name}")
        self.quantities = replace(self.quantities, inputs=[replace(v, low=a, high=b) for v, a, b in ends])

    @property
    def rows(self) -> dict[str, Int[np.ndarray, " m"]]:
        """Rows of the records that are learnt, those of the validation, and those that test."""
        count, split = len(self.records), self.split
        order = np.random.default_rng(split.seed).permutation(count)
        learnt = max(1, round(split.learning * count))
        kept = learnt - min(round(split.validation * learnt), learnt - 1)
        return {LEARNING: order[:kept], VALIDATION: order[kept:learnt], TESTING: order[learnt:]}

    @property
    def sets(self) -> dict[str, Records]:
        """Learning, validation, testing and between; what is empty is left out."""
        found = {name: self.records.at(np.sort(rows)) for name, rows in self.rows.items()}
        if self.between is not None:
            found[BETWEEN] = self.between
        return {name: records for name, records in found.items() if len(records)}

    def tuples(self, records: Records) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n 1"]]:
        """What a network sees of records, and what it should say.

        Args:
            records: The records.

        Returns:
            Features, and the response over what it is proportional to [SI].
        """
        x = torch.as_tensor(records.conditions, dtype=self.dtype)
        y = torch.as_tensor(records.values, dtype=self.dtype)
        return self.quantities.features(x), (y / self.quantities.factor(x))[:, None]

    def train_dataloader(self) -> DataLoader:
        """One batch an epoch: all that is learnt."""
        parts = (self.tuples(self.records.at(self.rows[name])) for name in (LEARNING, VALIDATION))
        batch: Batch = tuple(tensor for part in parts for tensor in part)  # type: ignore[assignment]
        return DataLoader([batch], batch_size=None, collate_fn=tuple)  # type: ignore[arg-type]

    def errors(self, response: Response) -> dict[str, dict[str, float]]:
        """How far an approximation is off.

        Args:
            response: The approximation.

        Returns:
            Set of records -> ``rms``, ``mean`` and ``largest`` error in the unit of the response, ``correlation``.
        """
        return {name: errors_of(records, response.at(records.conditions)) for name, records in self.sets.items()}

    def remarks(self) -> list[str]:
        """What should be known before anything is learnt, a line each."""
        return list(self.notes)

    def describe(self) -> str:
        """Number, source and split of the records, a sentence or two."""
        parts = ", ".join(f"{len(records)} {name}" for name, records in self.sets.items())
        return f"{self.records.source}: {parts}."


def errors_of(records: Records, found: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Errors of an approximation at records.

    Args:
        records: The records.
        found: What it gives there [SI].

    Returns:
        ``rms``, ``mean`` and ``largest`` in the unit of the response, ``correlation`` [-].

    Source:
        Cepowski 2007, eq. 2, with the sum over the records that is left out in print.
    """
    off = (found - records.values) / records.output.size
    varied = np.ptp(found) > 0 and np.ptp(records.values) > 0
    return {
        "rms": float(np.sqrt(np.mean(off**2))),
        "mean": float(off.mean()),
        "largest": float(np.abs(off).max()),
        "correlation": float(np.corrcoef(found, records.values)[0, 1]) if varied else np.nan,
    }


@dataclass(frozen=True)
class SeakeepingSettings:
    """How records are computed.

    Attributes:
        method: ``closed_form``, ``strip_theory`` or ``boundary_element``: see :func:`.significant_motions`.
        design: ``grid``, every combination of the values of the inputs, or ``sobol``, points that fill their ranges
            evenly.
        count: Points of ``sobol``; None takes as many as the grid has.
        between: Random points over the ranges that test and are never learnt from; 0 for none.
    """

    method: str = "strip_theory"
    design: Literal["grid", "sobol"] = "grid"
    count: int | None = None
    between: int = 800

    def __post_init__(self) -> None:
        """Refuse what is unknown or out of range.

        Raises:
            InputError: If a setting is.
        """
        check_choice("data.method", self.method, METHODS)
        check_choice("data.design", self.design, ["grid", "sobol"])
        if self.between < 0 or (self.count is not None and self.count < 8):
            raise InputError(
                f"data.between={self.between}, data.count={self.count}: expected 0 or more, and 8 records or more"
            )


def computed_records(
    quantities: Quantities,
    values: Mapping[str, Sequence[float]],
    form: HullForm,
    ship: str,
    settings: SeakeepingSettings | None = None,
    *,
    split: Split | None = None,
    dtype: torch.dtype = torch.float64,
) -> ResponseData:
    """Significant pitch amplitudes of a ship, computed by linear seakeeping when they are asked for.

    Args:
        quantities: Variables, those of :data:`CONDITIONS` and no other, and the response.
        values: Variable -> values of the grid [SI].
        form: The hull.
        ship: The ship's name.
        settings: Method, design of the records, number between.
        split: Which records are learnt from; its seed is that of the random points and of ``sobol``, too.
        dtype: Floating type.

    Returns:
        The data module.

    Raises:
        InputError: If a variable is missing or unknown, or has no values, or the hull does not reach the draughts.
    """
    chosen, names, seed = settings or SeakeepingSettings(), [v.name for v in quantities.inputs], (split or Split()).seed
    if sorted(names) != sorted(CONDITIONS):
        raise InputError(
            f"inputs are {', '.join(names)}; pitch is computed from {', '.join(CONDITIONS)}: to leave one out of a "
            "network write sees.NAME=false"
        )
    empty = [name for name in names if len(values[name]) < 2]
    if empty:
        raise InputError(f"inputs.{empty[0]}.values has fewer than two values: records are computed over a range")
    low, high = (ratio * form.draught for ratio in (MIN_DRAUGHT_RATIO, MAX_DRAUGHT_RATIO))
    if not low <= min(values["d"]) <= max(values["d"]) <= high:
        raise InputError(
            f"inputs.d.values from {min(values['d']):g} to {max(values['d']):g} m: the hull of the {ship} goes from "
            f"{low:.1f} to {high:.1f} m; write inputs.d.values=[{0.8 * form.draught:.1f},{form.draught:.1f}], say"
        )
    places = [names.index(name) for name in CONDITIONS]

    def make(say: Say) -> tuple[Records, Records | None]:
        grid = grid_of([values[name] for name in names])
        points = grid if chosen.design == "grid" else space_filling(grid, chosen.count or len(grid), seed)
        further = np.random.default_rng(seed + 1).uniform(grid.min(0), grid.max(0), (chosen.between, len(names)))
        conditions = np.concatenate([points, further])  # at once: hydrodynamics are solved for all draughts together
        found = significant_pitch(conditions[:, places], chosen.method, form, say)
        source = f"{len(points)} records of the {ship} by {chosen.method.replace('_', ' ')}, {chosen.design}"
        both = Records(quantities.inputs, quantities.output, conditions, found, source)
        first = np.arange(len(both)) < len(points)
        return both.at(first), both.at(~first) if chosen.between else None

    return ResponseData(quantities, make, split, dtype)


def grid_of(values: Sequence[Sequence[float]]) -> Float[np.ndarray, "n k"]:
    """Every combination of values; the last varies fastest."""
    return np.stack(np.meshgrid(*[np.asarray(v, dtype=float) for v in values], indexing="ij"), -1).reshape(
        -1, len(values)
    )


def space_filling(grid: Float[np.ndarray, "m k"], count: int, seed: int) -> Float[np.ndarray, "n k"]:
    """Points that fill the ranges of a grid evenly.

    Args:
        grid: Points whose ranges are filled.
        count: Number of points.
        seed: Seed of the scrambling.

    Returns:
        Points.

    Source:
        Sobol 1967, scrambled as in Owen 1998.
    """
    drawn = qmc.Sobol(grid.shape[1], seed=seed).random_base2(int(np.ceil(np.log2(count))))[:count]
    return np.asarray(qmc.scale(drawn, grid.min(0), grid.max(0)))


def recorded_records(
    quantities: Quantities,
    files: Sequence[str],
    mapping: RecordsMapping | None,
    form: HullForm | None = None,
    *,
    folder: str = ".",
    split: Split | None = None,
    dtype: torch.dtype = torch.float64,
) -> ResponseData:
    """Records of tables, read and checked at once, so that a bad one is refused before computing starts.

    Args:
        quantities: Variables and the response.
        files: Names or patterns, relative to the folder.
        mapping: Columns and units; None for headings as this package writes them, ``Hs [m]``.
        form: The hull, by which it is seen whether headings are reversed; None does not look.
        folder: Where the files are.
        split: Which records are learnt from.
        dtype: Floating type.

    Returns:
        The data module.

    Raises:
        InputError: If no file is named, or one cannot be used.
    """
    paths = expand(Path(folder), files, "data.files")
    if not paths:
        raise InputError("data.files=[] names no table: write data.files=[FILE,...], relative to data.folder")
    records = read_records(paths, quantities.inputs, quantities.output, mapping)
    check_records(records)
    notes = heading_notes(records, form) if form else []
    return ResponseData(quantities, lambda say: (records, None), split, dtype, notes)


def heading_notes(records: Records, form: HullForm) -> list[str]:
    """Say if records agree better with the closed form of the hull when head and following seas are exchanged.

    The correlations r of the two readings are compared by Fisher's ``z = atanh r``, whose standard error is
    ``1/sqrt(n - 3)``.

    Args:
        records: The records.
        form: The hull.

    Returns:
        A line, or none: also where the records lack a variable, or are outside what the closed form can do.
    """
    names = [v.name for v in records.inputs]
    if not set(CONDITIONS) <= set(names):
        return []
    conditions = records.conditions[:, [names.index(name) for name in CONDITIONS]]
    heading, turned = CONDITIONS.index("beta"), conditions.copy()
    turned[:, heading] = np.pi - turned[:, heading]
    try:
        found = [significant_pitch(c, "closed_form", form) for c in (conditions, turned)]
    except InputError:
        return []
    labelled, reversed_ = (float(np.corrcoef(values, records.values)[0, 1]) for values in found)
    apart = np.subtract(*np.arctanh(np.clip([reversed_, labelled], -1 + 1e-12, 1 - 1e-12)))
    if not apart > MIN_STANDARD_ERRORS * np.sqrt(2 / (len(records) - 3)):
        return []
    return [
        f"pitch agrees better with the closed form of this hull if 0 is a head sea (correlation {reversed_:.2f}; as it "
        f"stands {labelled:.2f}): if it is, write heading_zero: head into the mapping"
    ]
