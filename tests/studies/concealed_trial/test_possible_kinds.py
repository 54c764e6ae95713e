"""What the ideal observer may add to what it has found."""

import pytest

from studies.concealed_trial.effects import KINDS, UNMODELLED
from studies.concealed_trial.ideal import _possible
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.unmodelled import RANDOM


@pytest.mark.parametrize("name", trial_ships())
def test_every_kind_is_possible_but_those_of_random_courses_other_ships_and_families_that_are_there(name):
    ship = trial_ships()[name]
    for kind in (*KINDS, *UNMODELLED):
        random = kind.detail in RANDOM or kind.name == "wind_gusty"
        elsewhere = bool(kind.ships) and ship.name not in kind.ships
        assert _possible(kind, ship, set()) is not (random or elsewhere), kind.name
        assert not _possible(kind, ship, {kind.family}) and not _possible(kind, ship, {kind.name})
    assert sum(kind.detail in RANDOM for kind in UNMODELLED) == len(RANDOM)
