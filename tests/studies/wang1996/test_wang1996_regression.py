"""Wang 1996, section 5.3: what a short reproduction of its tables and figures must show."""

from functools import cache

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx

from studies.reproduction.section import ChapterResult, ComputingEffort
from studies.wang1996.coefficients import THESIS_TERMS, thesis_prime
from studies.wang1996.derivatives import si_unit
from studies.wang1996.printed_coefficients import ORIGINAL_SLIPS, ROWS, SLIPS
from studies.wang1996.regression import chapter

SAID: list[str] = []


@cache
def section() -> ChapterResult:
    with unchecked():
        return chapter(ComputingEffort(quick=True, starts=2), SAID.append)


def claims(part: str) -> dict:
    return {(c.where, c.what): c for c in section().claims if part in c.what}


def offs() -> dict:
    table = next(rows for title, rows in section().tables.items() if title.startswith("15-15"))
    return {row["coefficients"]: row for row in table}


@pytest.mark.slow
def test_every_row_of_the_tables_has_its_claims():
    assert [sum(r.equation == e for r in ROWS) for e in "XYN"] == [15, 22, 22]
    assert len(claims(", estimated")) == len(ROWS)
    assert len(claims("original; ours")) == len(ROWS)
    assert len(claims("nondimensional")) == sum(r.regression != 0 for r in ROWS)
    assert len(claims("Clarke")) == sum(r.clarke is not None for r in ROWS) + 5


@pytest.mark.slow
def test_of_the_nondimensional_values_all_but_two_slips_follow_from_the_dimensional_ones():
    wrong = {c.what.split(",")[0] for c in claims("nondimensional").values() if c.verdict != "holds"}
    assert wrong == {f"{e}_{t}" for e, t in SLIPS} == {"Y_vdd", "Y_uv"}
    assert claims("Y_vdd, nondimensional")["Table 5.2", "Y_vdd, nondimensional"].ours == approx(-0.392, abs=1e-3)
    assert claims("Y_uv, nondimensional")["Table 5.2", "Y_uv, nondimensional"].ours == approx(-0.0954, abs=1e-4)


@pytest.mark.slow
def test_clarkes_columns_are_met():
    assert {c.verdict for c in claims("Clarke").values()} == {"holds"}


@pytest.mark.slow
def test_exact_g_gives_the_true_terms_and_the_originals_but_for_one_wrong_sign():
    assert {c.verdict for c in claims("exact g, largest error").values()} == {"holds"}
    assert [c.ours for c in claims("terms kept of exact g").values()] == ["exactly the true terms"]
    wrong = [c.what for c in claims("original; ours").values() if c.verdict != "holds"]
    assert wrong == ["Y_vvd, original; ours from exact g"] and ("Y", "vvd") in ORIGINAL_SLIPS


@pytest.mark.slow
def test_estimated_and_original_cannot_be_compared_at_unlike_inertia():
    (claim,) = claims("estimated and original").values()
    assert "-0.0845" in claim.why and "-0.0555" in claim.why


@pytest.mark.slow
def test_the_zigzag_fits_with_the_thesis_coefficients_and_better_with_ours():
    found = offs()
    assert found["thesis, as printed"]["worst"] < 0.2
    assert found["thesis, slips corrected"]["worst"] < found["thesis, as printed"]["worst"]
    assert found["ours, exact g"]["worst"] < 1e-6
    assert found["ours, networks' g"]["median"] < found["thesis, slips corrected"]["median"]


@pytest.mark.slow
def test_the_published_networks_give_the_thesis_large_surge_terms():
    found = claims("published networks' g, the thesis' terms")
    for term in ("vv", "vr", "vd", "uu", "0"):
        claim = found["Eq 5.1", f"X_{term}, published networks' g, the thesis' terms"]
        assert claim.ours == approx(claim.paper, rel=0.2), term
    assert [len(t) for t in THESIS_TERMS.values()] == [10, 10, 11]


@pytest.mark.slow
def test_whatever_does_not_hold_says_why():
    assert all(c.why for c in section().claims if c.verdict == "does not hold")


@pytest.mark.slow
def test_every_figure_is_drawn_with_numbers():
    plots = {p.name: p for p in section().plots}
    assert list(plots) == [f"figure_5_{k}" for k in range(13, 20)]
    lines = [line for p in plots.values() for panel in p.panels for line in panel.lines]
    assert all(len(line.x) == len(line.y) > 100 and np.isfinite(line.y).all() for line in lines)
    assert [len(p.panels) for p in plots.values()][:2] == [3, 4]
    assert plots["figure_5_19"].panels[0].equal


@pytest.mark.slow
def test_the_rudder_is_drawn_positive_to_port():
    *_, rudder = next(p for p in section().plots if p.name == "figure_5_14").panels
    assert rudder.lines[0].y[30] == approx(-35.0)


@pytest.mark.slow
def test_condition_numbers_and_intervals_are_in_the_tables():
    titles = list(section().tables)
    assert titles[:3] == ["Table 5.1: surge", "Table 5.2: sway", "Table 5.3: yaw"]
    statistics = section().tables["Statistics of the regressions"]
    assert len(statistics) == 3 * (3 + 2)
    assert all(row["condition number"] >= 1 and row["largest variance inflation"] >= 1 for row in statistics)
    exact = [row["condition number"] for row in statistics[:3]]
    assert exact == approx([219.2, 195.6, 195.6], rel=0.01)


@pytest.mark.slow
def test_who_waits_is_told_what_is_done():
    section()
    assert len(SAID) == 4 and "6 networks" in SAID[1]


@pytest.mark.parametrize("equation, term, value", [("X", "vd", 4721559.0), ("N", "r", 1.09662e11)])
def test_the_tables_were_made_with_fresh_water(equation, term, value):
    assert si_unit(thesis_prime(), equation, term) == approx(value, rel=1e-4)
