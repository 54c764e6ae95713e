from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tiny
import torch
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.ship.kvlcc2 import kvlcc2
from manoeuvre_nn.training.data import DataSettings, RecordedData, SimulatedData, recorded_files

COLUMNS = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}
PLAIN = mapping(
    time={"column": "t [s]", "unit": "s"},
    channels={name: {"column": f"{name} [{unit}]", "unit": unit} for name, unit in COLUMNS.items()},
)


def simulated(**settings) -> SimulatedData:
    """The usual tuples, judged by what is quickly simulated."""
    return tiny.simulated(**{"score": [straight(45.0)]} | settings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three runs of the Mariner as files, 120 s at 2 Hz."""
    where = tmp_path_factory.mktemp("runs")
    for trial in (zigzag(20.0, duration=120.0), zigzag(35.0, duration=120.0), turning_circle(25.0, duration=120.0)):
        with unchecked():
            simulate(CalmWater(tiny.ships()[0]), trial, interval=0.5).to_csv(where / f"{trial.name}.csv")
    return where


def recorded(folder, files=("zz35.csv",), score=(), **settings) -> RecordedData:
    ship, known = tiny.ships()
    data = recorded_files(
        ship, known, list(files), list(score), PLAIN, folder=str(folder), settings=DataSettings(**settings)
    )
    data.setup()
    return data


def test_tuples_equal_the_textbook_formula():
    data, (ship, known) = tiny.usual(), tiny.ships()
    (run,), p = data.recordings, ship.particulars
    unit = p.length / p.speed
    primed = np.column_stack([run["u"] / p.speed, run["v"] / p.speed, run["r"] * unit, run["delta"]])
    np.testing.assert_allclose(data.tuples.inputs.numpy(), primed, rtol=1e-13)
    rates = np.column_stack([run["udot"], run["vdot"], run["rdot"] * p.length]) * unit / p.speed
    speeds, rudder = torch.as_tensor(run.stacked("u", "v", "r")), torch.as_tensor(run["delta"])
    g = rates @ known.inertia.numpy().T - known.force(speeds, rudder).numpy()
    np.testing.assert_allclose(data.tuples.targets.numpy(), g, atol=1e-14)
    assert np.abs(g).max() > 1e-3


def test_known_part_and_g_together_give_the_ships_own_acceleration():
    data, (ship, known) = tiny.usual(), tiny.ships()
    nu = torch.as_tensor(data.recordings[0].stacked("u", "v", "r"))
    delta = data.tuples.inputs[:, 3]
    whole = known.acceleration_from_force(known.force(nu, delta) + data.tuples.targets)
    torch.testing.assert_close(whole, ship.acceleration(nu, delta), rtol=1e-9, atol=1e-12)


def test_length_and_rate_say_how_many_tuples_there_are():
    def times(**s):
        return simulated(**s).tuples.times.numpy()

    np.testing.assert_allclose(times(length=60.0), np.arange(61.0))
    np.testing.assert_allclose(times(length=60.0, rate_hz=2.0), np.arange(121) / 2)
    np.testing.assert_allclose(times(length=60.0, rate_hz=0.5), np.arange(31) * 2.0)


def test_a_length_beyond_the_usual_one_is_simulated():
    data = simulated(manoeuvres=[zigzag(35.0, duration=60.0)], length=90.0)
    assert data.recordings[0].duration == 90.0


def test_several_manoeuvres_are_put_one_after_the_other():
    both = simulated(manoeuvres=[zigzag(35.0), turning_circle(15.0)], length=60.0)
    alone = [simulated(manoeuvres=[m], length=60.0).tuples.targets for m in (zigzag(35.0), turning_circle(15.0))]
    torch.testing.assert_close(both.tuples.targets, torch.cat(alone))
    assert both.tuples.index.tolist() == [0] * 61 + [1] * 61
    assert "zz35 (60 s), tc15 (60 s)" in both.describe()


def test_what_effects_do_is_part_of_what_is_learnt():
    ship, known = tiny.ships()
    wind = SteadyWind(ship, speed=12.0, from_deg=60.0)
    data = simulated(effects=[wind, Current(ship, speed=1.0, toward_deg=90.0)], length=60.0)
    (run,), inputs = data.recordings, data.tuples.inputs
    nu, delta, course = (torch.as_tensor(c) for c in (run.stacked("u", "v", "r"), run["delta"], run["psi"]))
    state = torch.cat([nu, torch.zeros(len(run), 2).double(), course[:, None]], dim=-1)
    with unchecked():
        rates = Vessel(CalmWater(ship), [wind]).model(state, Inputs(delta))[:, :3]
    whole = known.acceleration_from_force(known.force(nu, delta) + data.tuples.targets)
    torch.testing.assert_close(whole, rates, rtol=1e-9, atol=1e-12)
    assert (rates - ship.acceleration(nu, delta)).abs().max() > 1e-4
    torch.testing.assert_close(inputs[:, 0] * ship.particulars.speed, nu[:, 0])
    (judged,) = data.held_out.references
    assert judged["ve"][0] == pytest.approx(1.0), "judged in the same current"
    assert "Mariner with a steady wind (speed=12 m/s, from_deg=60) and a current (" in data.describe()
    assert "the simulated Mariner: zz35 (60 s)" in simulated(length=60.0).describe()


def test_a_current_alone_leaves_nothing_to_learn():
    ship = tiny.ships()[0]
    still, drifting = simulated(length=60.0), simulated(effects=[Current(ship)], length=60.0)
    torch.testing.assert_close(drifting.tuples.inputs, still.tuples.inputs, rtol=0, atol=1e-7)
    torch.testing.assert_close(drifting.tuples.targets, still.tuples.targets, rtol=0, atol=1e-7)


def test_noise_is_that_of_the_seed_and_of_the_named_channels():
    def raw(seed, **noise):
        return simulated(length=60.0, rate_hz=5.0, noise=noise, seed=seed, accelerations="central").recordings[0]

    first, again, other = raw(1, u=0.1, r_deg_s=0.2), raw(1, u=0.1, r_deg_s=0.2), raw(2, u=0.1, r_deg_s=0.2)
    clean = raw(1, u=0.0)
    assert np.array_equal(first["u"], again["u"]) and not np.array_equal(first["u"], other["u"])
    assert np.array_equal(first["v"], clean["v"]) and np.array_equal(first["psi"], clean["psi"])
    assert np.std(first["u"] - clean["u"]) == pytest.approx(0.1, rel=0.15)
    assert np.std(first["r"] - clean["r"]) == pytest.approx(0.2 * DEGREE, rel=0.15)


def test_two_manoeuvres_have_different_noise():
    data = simulated(manoeuvres=[zigzag(35.0), zigzag(35.0)], length=60.0, noise={"u": 0.1},
                          accelerations="central")  # fmt: skip
    one, two = (r["u"] for r in data.recordings)
    assert np.abs(one - two).max() > 0.05


def test_accelerations_are_exact_where_channels_are_clean_and_smoothed_where_they_are_not():
    exact = tiny.usual().tuples.targets
    torch.testing.assert_close(simulated(accelerations="exact").tuples.targets, exact, rtol=0, atol=0)
    noisy = simulated(noise={"v": 1e-12}).tuples.targets
    smooth = simulated(accelerations="smoother").tuples.targets
    torch.testing.assert_close(noisy, smooth, atol=1e-8, rtol=0)
    assert (noisy - exact).abs().max() > 1e-5


def test_validation_tuples_are_kept_from_training():
    data = simulated(validation=0.2, seed=5)
    x, y, held_x, held_y = next(iter(data.train_dataloader()))
    assert (len(x), len(held_x)) == (73, 18) and (len(y), len(held_y)) == (73, 18)
    rows = {tuple(row) for row in torch.cat([x, held_x]).tolist()}
    assert rows == {tuple(row) for row in data.tuples.inputs.tolist()}
    assert not {tuple(row) for row in x.tolist()} & {tuple(row) for row in held_x.tolist()}
    assert torch.equal(data.train_mask(), simulated(validation=0.2, seed=5).train_mask())
    assert not torch.equal(data.train_mask(), simulated(validation=0.2, seed=6).train_mask())


def test_without_validation_all_tuples_are_trained_on():
    x, _, held_x, held_y = next(iter(tiny.usual().train_dataloader()))
    assert len(x) == 91 and held_x.shape == (0, 4) and held_y.shape == (0, 3)


def test_single_precision_reaches_the_batch():
    data = simulated(dtype=torch.float32)
    assert {part.dtype for part in next(iter(data.train_dataloader()))} == {torch.float32}
    assert data.tuples.inputs.dtype == torch.float64


@pytest.mark.parametrize(
    "settings, told, cure",
    [
        ({"length": 10.0}, "data.length=10 s of zz35 is too short for the Mariner", "write at least 40.1 s"),
        ({"noise": {"w": 0.1}}, "data.noise 'w' is unknown", "choose one of: u, v, x, y, r_deg_s, psi_deg, delta_deg"),
        ({"noise": {"u": -0.1}}, "data.noise.u=-0.1", "expected a standard deviation, 0 or more"),
        ({"rate_hz": -1.0}, "data.rate_hz=-1.0", "expected a number more than 0"),
        ({"rate_hz": float("nan")}, "data.rate_hz=nan", "expected a number more than 0"),
        ({"length": -5.0}, "data.length=-5.0", "expected a time in seconds, more than 0"),
        ({"length": 1e7}, "data.length=10000000.0", "up to 1e+06"),
        ({"validation": 1.0}, "data.validation=1.0", "expected a share from 0 to below 1"),
        ({"accelerations": "guess"}, "data.accelerations 'guess' is unknown", "auto, exact, central, smoother, joint"),
        (
            {"delays": ["psi"]},
            "data.delays=[psi] is estimated by data.accelerations=joint only, not by auto",
            "leave data.delays out",
        ),
        ({"accelerations": "joint", "delays": ["delta"]}, "data.delays 'delta' is unknown", "u, v, r, x, y, psi"),
        ({"manoeuvres": []}, "manoeuvre=[] names no manoeuvre", "write for instance manoeuvre=zz35"),
        ({"score": []}, "score=[] names no manoeuvre", "write for instance score=[zz20]"),
        ({"score": [zigzag(40.0)]}, "zz40 orders 40 deg of rudder; the Mariner stops at 35", "a smaller rudder_deg"),
    ],
)
def test_settings_of_simulated_data_are_refused_with_their_cure(settings, told, cure):
    with unchecked(), pytest.raises(InputError) as refusal:
        simulated(**settings)
    message = str(refusal.value)
    assert told in message and cure in message.replace(told, "") and "\n" not in message


def test_a_ship_without_coefficients_is_not_simulated():
    with unchecked(), pytest.raises(InputError, match=r"no coefficients .* write data=recording data.folder=FOLDER"):
        SimulatedData(kvlcc2(), tiny.ships()[1], [zigzag(20.0)], [zigzag(10.0)])


def test_measured_files_give_nearly_the_tuples_of_the_simulation_behind_them(folder):
    measured = recorded(folder, length=90.0, rate_hz=1.0).tuples
    inside = slice(10, 80)  # a smoother knows least at the ends
    true = simulated(length=90.0, accelerations="exact").tuples
    assert torch.equal(measured.times, true.times)
    torch.testing.assert_close(measured.inputs[inside], true.inputs[inside], atol=5e-3, rtol=0)
    spread = true.targets.std(0)
    # A smoother rounds the kinks of the rudder off.
    assert ((measured.targets - true.targets)[inside].square().mean(0).sqrt() / spread < 0.2).all()


def test_without_a_score_all_other_files_are_judged(folder):
    data = recorded(folder)
    assert sorted(r.name for r in data.held_out.references) == ["tc25", "zz20"]
    assert [r.name for r in data.recordings] == ["zz35"]
    assert "tuples of the measured Mariner: zz35 (120 s)" in data.describe()


def test_all_channels_are_smoothed_at_once_and_a_late_one_is_moved_back(folder, tmp_path):
    for path in folder.glob("*.csv"):
        table = pd.read_csv(path)
        late = np.interp(table["t [s]"] - 1.0, table["t [s]"], table["psi [rad]"])
        noise = 2e-3 * np.random.default_rng(0).standard_normal(len(table))
        table.assign(**{"psi [rad]": late + noise}).to_csv(tmp_path / path.name, index=False)
    data = recorded(tmp_path, accelerations="joint", delays=["psi"], offsets=["u"], rate_hz=1.0)
    (run,) = data.recordings
    assert " Sensors are late by: zz35 psi " in data.describe()
    assert " Sensors are off by: zz35 u " in data.describe()
    true = simulated(length=120.0, accelerations="exact").recordings[0]
    delay, error = run.meta["delays"]["psi"]
    assert abs(delay - 1.0) < 4 * error < 0.3
    assert np.std(run["psi"] - true["psi"]) < 2e-3
    assert (run["rdot_sd"] > 0).all() and len(run["rdot_sd"]) == 121


def test_a_pattern_names_several_files(folder):
    data = recorded(folder, files=["zz*.csv"])
    assert [r.name for r in data.recordings] == ["zz20", "zz35"]
    assert [r.name for r in data.held_out.references] == ["tc25"]


def test_a_measured_record_is_cut_and_reduced_to_the_usual_rate(folder):
    assert len(recorded(folder).tuples.times) == 121
    assert recorded(folder, length=50.0, rate_hz=2.0).tuples.times.tolist() == [k / 2 for k in range(101)]


@pytest.mark.parametrize(
    "settings, told",
    [
        ({"files": []}, "data.files=[] names no recording: write data.files=[FILE,...], relative to data.folder"),
        ({"files": ["none.csv"]}, "data.files: none.csv is not in"),
        ({"score": ["none.csv"]}, "it holds tc25.csv, zz20.csv, zz35.csv"),
        ({"files": ["zz*.csv"], "score": ["zz35.csv"]}, "zz35.csv is both in data.files and in score"),
        ({"files": ["*.csv"]}, " to score: leave one out of data.files, or add one there"),
        ({"length": 5.0}, "write at least 40.1 s"),
    ],
)
def test_lists_of_files_that_make_no_sense_are_refused(folder, settings, told):
    with pytest.raises(InputError) as refusal:
        recorded(folder, **settings)
    assert told in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_folder_that_is_none_is_refused(folder):
    with pytest.raises(InputError, match="none is not a folder: write the folder that holds the recordings"):
        recorded(folder / "none")


@pytest.mark.parametrize("method", ["auto", "central", "joint"])
def test_a_further_manoeuvre_would_be_learnt_as_this_sets_own_are(method):
    data = simulated(noise={"v": 0.2, "r_deg_s": 0.1}, seed=4, accelerations=method)
    with unchecked():
        sailed = simulate(CalmWater(tiny.ships()[0]), zigzag(35.0, duration=90.0), interval=1.0)
        again = data.would_record(sailed, seed=4)
    torch.testing.assert_close(again.inputs, data.tuples.inputs, rtol=0, atol=1e-12)
    torch.testing.assert_close(again.targets, data.tuples.targets, rtol=0, atol=1e-12)


def test_a_further_run_beside_measured_ones_is_sensed_at_their_own_rate(folder):
    data = recorded(folder, rate_hz=1.0)
    assert data.noise["v"] < 0.02  # the files hold none; what is taken away is kinks rounded off
    data.noise = {"v": 0.2}
    with unchecked():
        sailed = simulate(CalmWater(tiny.ships()[0]), zigzag(35.0, duration=120.0), interval=1.0)
        (clean,) = data.recordings
        there = data.would_record(sailed, seed=1)
    assert torch.equal(there.times, data.tuples.times)
    left = np.std(there.inputs[5:-5, 1].numpy() * 7.717 - clean["v"][5:-5])
    # Local cubics over 33 samples, 17 s at 2 Hz, leave .26 of white noise; over 17 samples, at 1 Hz, .36.
    assert left / 0.2 == pytest.approx(0.26, abs=0.06)
