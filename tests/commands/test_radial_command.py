import json

import numpy as np
import pandas as pd
import pytest
from test_pitch_command import TINY
from tiers import mainly

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.response import load_response

WORDS = [word for word in TINY if not word.startswith(("network.hidden", "trainer"))]
CHOSEN = {"rbf": ["network=rbf", "network.hidden=10"], "grnn": ["network=grnn"]}


@pytest.mark.parametrize("name", mainly(1, CHOSEN))
def test_what_is_near_is_learnt_kept_and_written_down(name, cli, tmp_path, monkeypatch):
    monkeypatch.setattr("manoeuvre_nn.commands.response_results.response_figures", lambda data, response: {})
    ended = cli(*WORDS, *CHOSEN[name], "out=out")
    assert ended.code == 0, ended.err
    assert {"rbf": "all widths tried", "grnn": "error at rest"}[name] in ended.out
    table = pd.read_csv(tmp_path / "out" / "records.csv").to_numpy()
    errors = json.loads((tmp_path / "out" / "scores.json").read_text())["errors"]
    response = load_response(tmp_path / "out" / "checkpoints" / "last.ckpt")
    found = response.at(table[:, :5] * [v.size for v in response.inputs]) / response.output.size
    both = (errors["learning"]["rms"] ** 2 + errors["testing"]["rms"] ** 2) / 2
    assert np.mean((found - table[:, 5]) ** 2) == pytest.approx(both, rel=1e-6)
    assert errors["learning"]["rms"] < 0.5 * table[:, 5].std()
    module: dict = {}
    exec(mnn.export(tmp_path / "out"), module)
    written = [module["pitch_deg"](*row) for row in table[:, :5].tolist()]
    np.testing.assert_allclose(written, found, rtol=1e-9, atol=1e-12)


def test_a_fit_for_another_network_is_refused_in_one_line(cli):
    ended = cli(*WORDS, "network=grnn", "fit=radial_basis")
    assert ended.code != 0
    assert len(ended.err.strip().splitlines()) == 1
    assert "GeneralRegression" in ended.err
