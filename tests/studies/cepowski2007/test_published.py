import numpy as np
import pytest

from manoeuvre_nn.core.units import DEGREE, KNOT
from studies.cepowski2007.published import GRID, grid_conditions, published_pitch

GOLDEN = [1.65, 1.72, 1.78, 1.84, 1.83, 0.52, 2.48, 2.98, 3.01, 3.02, 2.99]


def test_equation_3_gives_the_values_read_off_it_independently() -> None:
    rows = [[7.0, 20 * KNOT, beta, 5.0, 10.5] for beta in GRID["beta"]]
    assert published_pitch(np.array(rows)) / DEGREE == pytest.approx(GOLDEN, abs=0.02)


def test_equation_3_stays_within_its_training_range_on_the_grid() -> None:
    conditions = grid_conditions()
    pitch = published_pitch(conditions) / DEGREE
    assert conditions.shape == (4400, 5)
    assert len(np.unique(conditions, axis=0)) == 4400
    assert (pitch.min(), pitch.max()) == pytest.approx((-0.134, 3.018), abs=1e-3)


def test_head_sea_pitches_the_ship_more_than_following_sea_at_service_speed() -> None:
    following, head = published_pitch(np.array([[7.0, 20 * KNOT, beta, 5.0, 10.5] for beta in (0.0, np.pi)]))
    assert head > 1.5 * following
