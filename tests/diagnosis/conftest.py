"""What the tests of the diagnosis share."""

import pytest
from fleet import unchecked

from manoeuvre_nn.diagnosis import forecast, predictive


@pytest.fixture
def unchecked_types():
    """Leaves out the checks of shapes and types, which take two thirds of the time."""
    with unchecked():
        yield


@pytest.fixture
def few_draws(request, monkeypatch):
    """A quarter of the draws where no test looks at bands; slow tests have them all."""
    for module in () if request.node.get_closest_marker("slow") else (forecast, predictive):
        monkeypatch.setattr(module, "DRAWS", 24)
