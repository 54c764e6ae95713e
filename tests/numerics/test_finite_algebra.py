"""LAPACK sees finite numbers only: given NaN it prints, given infinity its singular values never end."""

import re

import numpy as np
import pytest
from house_rules import PACKAGE

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.numerics.finite_algebra import lstsq

COLUMNS = np.random.default_rng(0).standard_normal((6, 2))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["columns", "values"])
def test_what_is_not_finite_is_refused_in_silence(bad, place, capfd):
    columns, values = COLUMNS.copy(), np.ones(6)
    (columns if place == "columns" else values)[0] = bad
    with pytest.raises(InputError, match="grew beyond all bounds"):
        lstsq(columns, values)
    assert capfd.readouterr() == ("", "")


def test_finite_problems_are_solved():
    np.testing.assert_allclose(lstsq(COLUMNS, COLUMNS @ [2.0, -1.0]), [2.0, -1.0])


def test_the_package_calls_lapack_in_no_other_way():
    found = [p.name for p in PACKAGE.rglob("*.py") if re.search(r"(?<!torch\.)linalg\.lstsq\(", p.read_text())]
    assert found == ["finite_algebra.py"]
