"""What the tests of the diagnosis share."""

import pytest
from fleet import unchecked


@pytest.fixture
def unchecked_types():
    """Leaves out the checks of shapes and types, which take two thirds of the time."""
    with unchecked():
        yield
