"""Effects that act beside each other: on a ship whose inertia one changes, and on a heel that one drives."""

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from trials import CALM, SHIP, TIMED, about, run_of, sailed, states_of, values

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.effect.loading import DisplacementChange
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.effect_columns import beside_it, contribution
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.linearised_run import LinearisedRun

STATES = 1e-6
"""Changes of the state within a step that are next to nothing."""
HEEL = RollCoupling(SHIP, N_phi=0.05, Y_pdot=0.01)


def alone(effect: Effect, line: LinearisedRun) -> Columns:
    with unchecked():
        return contribution(effect, values(effect), line)


def each_beside(effects: list[Effect], line: LinearisedRun) -> list[Columns]:
    here = [e.values.numpy() for e in effects]
    with unchecked():
        return [
            contribution(e, values(e), line, beside=beside_it(effects, here, k, line)) for k, e in enumerate(effects)
        ]


@pytest.mark.parametrize(
    "pushed",
    [SideForce(SHIP, force_kN=400.0, lever_m=30.0, start_s=0.0, end_s=80.0), RudderOffset(SHIP, offset_deg=4.0)],
)
def test_what_pushes_a_ship_moves_her_as_another_effect_has_changed_her_inertia(pushed):
    heavy = DisplacementChange(SHIP, factor=1.6)
    (record,) = sailed([TIMED], [heavy, pushed])
    line = about(run_of(record), states_of(record))
    with unchecked():
        made = [
            contribution(e, values(e), line, beside=beside_it([heavy, pushed], [heavy.values.numpy()] * 2, k, line))
            for k, e in enumerate((heavy, pushed))
        ]
    missing = -line.defect
    for both, right in ((made, True), ([made[0], alone(pushed, line)], False)):
        moved = sum(c.moved[..., 0] for c in both)
        off = np.abs(moved - missing) / (np.abs(missing).max(axis=0) + STATES)
        assert (np.quantile(off[:, :3], 0.9, axis=0).max() < 0.01) == right


@pytest.mark.parametrize(
    "pushing",
    [SideForce(SHIP, force_kN=600.0, lever_m=-30.0, start_s=20.0, end_s=120.0), RudderOffset(SHIP, offset_deg=6.0)],
)
@pytest.mark.parametrize("heavy", [(), (DisplacementChange(SHIP, factor=1.4),)], ids=["as she is", "heavier"])
def test_a_ship_heels_by_all_that_pushes_her_sideways(pushing, heavy):
    """A second route: the forces that a simulation with all of them has, along its own track."""
    every = [HEEL, *heavy, pushing]
    (record,) = sailed([TIMED], every)
    line = about(run_of(record), states_of(record))
    missing = -line.defect
    for made, right in ((each_beside(every, line), True), ([alone(HEEL, line), *each_beside(every, line)[1:]], False)):
        off = np.abs(sum(c.moved[..., 0] for c in made) - missing) / (np.abs(missing).max(axis=0) + STATES)
        assert (np.quantile(off[:, [1, 2]], 0.9, axis=0).max() < 0.01) == right


def test_what_a_force_does_by_the_heel_is_in_the_column_of_its_size():
    """A second route: the difference of the whole at two sizes of the force."""
    force = SideForce(SHIP, force_kN=300.0, lever_m=20.0, start_s=0.0, end_s=500.0)

    def columns(size: float):
        table = force.values.numpy()[None].copy()
        table[0, 0] = size
        made = Hypothesis((HEEL, force), (HEEL.values.numpy()[None], table))
        with unchecked():
            return hypothesis_columns(data_set, made), made

    with unchecked():
        data_set = whitened_data_set(CALM, [run_of(sailed([TIMED], [HEEL, force])[0])])
    (more, _), (less, _), (here, hypothesis) = (columns(size) for size in (310.0, 290.0, 300.0))
    (column,) = [k for k, f in enumerate(hypothesis.unknowns()) if f.parameter.name == "force_kN"]
    found = here.columns[0].moved[..., list(here.index[0]).index(1 + column)]
    expected = (more.columns[0].moved[..., 0] - less.columns[0].moved[..., 0]) / 20.0
    direct = alone(force, data_set.runs[0].linearised).moved[..., 0] / 300.0
    assert found == approx(expected, abs=1e-6 * np.abs(expected).max())
    assert np.abs(direct - expected)[:, 2].max() > 0.05 * np.abs(expected[:, 2]).max(), "else nothing was asked"


def test_an_engine_is_not_driven_by_forces():
    (record,) = sailed([TIMED])
    line, force = about(run_of(record), states_of(record)), SideForce(SHIP, force_kN=300.0, start_s=0.0, end_s=900.0)
    both, heeling = [PowerLimit(SHIP, rpm_slope=0.3), force], [HEEL, force]
    with unchecked():
        engine, heel = (beside_it(pair, [e.values.numpy() for e in pair], 0, line) for pair in (both, heeling))
    assert engine.nudot is None
    expected = SHIP.acceleration_from_si(SHIP.inertia.new_tensor([0.0, 3e5, 0.0]))
    assert heel.nudot[0, len(record) // 2].numpy() == approx(expected.numpy())
