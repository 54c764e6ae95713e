"""Mappings proposed for recordings in many units, signs, axes and names read the same motion again."""

import numpy as np
import pandas as pd
import pytest
from exports import EXPORTS

from manoeuvre_nn.recording.proposal import propose
from manoeuvre_nn.recording.proposal_yaml import to_yaml
from manoeuvre_nn.recording.reader import read_recording


def apart(record, run):
    """Largest error of each channel over its size; positions and headings may begin anywhere."""
    found = {}
    for name in ("u", "v", "r", "delta"):
        found[name] = np.abs(record[name] - run[name]).max() / np.abs(run[name]).max()
    for name in ("x", "y", "psi"):
        error = (record[name] - record[name][0]) - (run[name] - run[name][0])
        found[name] = np.abs(error).max() / np.ptp(run[name])
    return found


@pytest.mark.parametrize("how", EXPORTS)
@pytest.mark.parametrize("known", [False, True], ids=["unknown ship", "known ship"])
def test_what_was_exported_is_read_as_it_was_sailed(zz20, ship, tmp_path, how, known):
    path = tmp_path / "run.csv"
    pd.DataFrame(EXPORTS[how](zz20)).to_csv(path, index=False)
    made = propose(path, ship if known else None)
    record = read_recording(path, made.mapping, ship)
    exact = {"no rate", "no rate, degrees", "no velocities", "no track", "no track, knots", "gps"}
    limit = 0.1 if how in exact else 0.03
    errors = apart(record, zz20)
    assert max(errors.values()) < limit, (errors, to_yaml(made))
    assert made.finding is None
