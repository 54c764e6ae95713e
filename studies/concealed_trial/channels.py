"""What a recorder writes: channel sets, holes in time, and held-out runs that hold rudder and warm-up only."""

import numpy as np
import pandas as pd

from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.effects import Kind
from studies.concealed_trial.helm import Run
from studies.concealed_trial.strength import WARMUP

CHANNEL_SETS: dict[str, tuple[tuple[str, ...], int]] = {
    "full": ((), 1),
    "no_shaft": (("n",), 1),
    "no_log": (("u_log",), 1),
    "gps_heading": (("r", "u_log", "n"), 1),
    "two_seconds": ((), 2),
}
"""Name of a set -> columns that are left out, and the sample interval [s]. Rudder and orders are always there."""
GIVEN = ("t", "delta_order", "delta")
"""Columns that a strict trial leaves in a held-out run after its warm-up."""


def shows(channels: str, kind: Kind) -> bool:
    """Whether an effect leaves a trace in a channel set: that of a sensor is gone with its channel.

    Args:
        channels: Name of the set.
        kind: Kind of the effect.

    Returns:
        True if it does.
    """
    place = kind.accepted[0][0]
    return place.removeprefix("sensor:") not in CHANNEL_SETS[channels][0]


def seconds_of(case: TrialCase, run: Run) -> np.ndarray:
    """Seconds at which a run is recorded.

    Args:
        case: The case.
        run: One of its runs.

    Returns:
        Whole seconds, without those of a hole.
    """
    seconds = np.arange(0, run.duration + 1, CHANNEL_SETS[case.channels][1])
    if case.hole is None or case.hole[0] != run.name:
        return seconds
    return seconds[(seconds < case.hole[1]) | (seconds > case.hole[2])]


def published(case: TrialCase, run: Run, table: pd.DataFrame, more: tuple[str, ...] = ()) -> pd.DataFrame:
    """What of a recording the tools get.

    Args:
        case: The case.
        run: The run.
        table: All columns, one row a second.
        more: Columns that are written down although the channel set lacks them.

    Returns:
        The columns of the channel set at the seconds that are recorded.
    """
    missing = [column for column in CHANNEL_SETS[case.channels][0] if column not in more]
    table = table.iloc[seconds_of(case, run)].drop(columns=missing)
    if case.strict and run.split == "held_out":
        answering = [name for name in table if name not in GIVEN]
        table.loc[table["t"] > WARMUP, answering] = np.nan
    return table
