"""Errors of predictions against recordings, J, and what counts as an outlier, on recordings that are made by hand."""

from math import inf

import numpy as np
import pandas as pd
import pytest
from pytest import approx
from referee_folder import write_manifest

from studies.concealed_trial import true_model
from studies.concealed_trial.ships import trial_ships

MARINER = trial_ships()["mariner"]


@pytest.fixture
def case(tmp_path):
    return write_manifest(tmp_path)


def test_j_is_the_root_of_the_mean_square_of_errors_over_the_published_scales():
    scales = {"pos": 0.02 * 152.4, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}
    assert true_model.scales(MARINER) == approx(scales)
    errors = {"pos": 6.096, "psi": 0.5, "r": 0.03}
    assert true_model.total(MARINER, errors) == approx(((4 + 1 + 1) / 3) ** 0.5)


def recording(case, **changes):
    """The held-out run: 20 s on heading 350 to 369 deg, all channels known; changes by second."""
    t = np.arange(20.0)
    table = pd.DataFrame({"t": t, "x_north": 7 * t, "y_east": 0 * t, "psi": (350 + t) % 360, "u": 7.0, "v": 0.0,
                          "r": 1.0, "u_log": 7.0})  # fmt: skip
    for name, values in changes.items():
        for second, value in values.items():
            table.loc[second, name] = value
    table.to_csv(case / "b.csv", index=False)
    return pd.DataFrame({"t": t[4:], "x": 7 * t[4:], "y": 0.0, "psi": 350 + t[4:], "u": 7.0, "v": 0.0, "r": 1.0,
                         "u_log": 7.0})  # fmt: skip


def test_errors_are_rms_over_samples_from_the_warm_up_on(case):
    exact = recording(case, psi={10: np.nan})
    assert true_model.rmse(case, {"b": exact}) == approx(dict.fromkeys(("pos", "psi", "u", "v", "r", "u_log"), 0.0))
    off = exact.assign(x=exact["x"] + 3, y=exact["y"] - 4, psi=exact["psi"] + 358, u=7.2)
    off.loc[0, "v"] = 0.8  # one of sixteen samples
    found = true_model.rmse(case, {"b": off})
    assert found == approx({"pos": 5.0, "psi": 2.0, "u": 0.2, "v": 0.2, "r": 0.0, "u_log": 0.0})
    assert true_model.rmse(case, {"b": exact.iloc[1:]}) is None, "a prediction that begins late"
    assert true_model.rmse(case, {"b": exact.drop(columns="r")}) is None and true_model.rmse(case, {}) is None
    assert true_model.rmse(case, {"b": exact.assign(u=np.nan)})["u"] == inf
    recording(case, **{"u_log": dict.fromkeys(range(20), np.nan)})
    assert set(true_model.rmse(case, {"b": exact.drop(columns="u_log")})) == {"pos", "psi", "u", "v", "r"}


NOISE = {"u": 0.04, "v": 0.04, "r": 0.02, "u_log": 0.05}
"""Of channels that are steady in the recording."""


@pytest.mark.parametrize(("channel", "noise"), NOISE.items())
def test_a_sample_is_an_outlier_beyond_eight_standard_deviations_of_its_neighbours_middle(case, channel, noise):
    run = {"file": "b.csv"}
    manifest = true_model.read_manifest(case)["nominal_noise_sd"]
    true = recording(case)[channel].iloc[8]  # of second 12
    for size, kept in ((7.9, True), (8.3, False)):
        value = true + size * noise + 0.01
        recording(case, **{channel: {12: value}})
        table = true_model.read_run(case, run, manifest)
        assert np.isfinite(table[channel][12]) == kept
        assert np.isfinite(table[channel].drop(index=12)).all()
