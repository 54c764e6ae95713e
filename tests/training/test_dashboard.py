"""TensorBoard opens on the held-out manoeuvres: groups are sorted by name."""

import re

import pytest

from manoeuvre_nn.training.dashboard import HELD_OUT, charts_of, image_place_of, place_of


@pytest.mark.parametrize("name, place", [
    ("score/dev_L", "1 held-out/dev_L"),
    ("score/left_range", "1 held-out/left_range"),
    ("zz20/dev_L", "1 held-out/dev_L zz20"),
    ("testing/rms", "1 held-out/rms testing"),
    ("train/mse", "3 training/mse"),
    ("noise/psi", "3 training/noise psi"),
    ("steps", "3 training/steps"),
    ("zz20/error_overshoot_1_deg", "4 zz20/error_overshoot_1_deg"),
    ("A/zz 1/nrmse_u", "4 A/zz 1/nrmse_u"),
])  # fmt: skip
def test_every_number_has_its_place(name, place):
    assert place_of(name) == place


@pytest.mark.parametrize("name, place", [
    ("zz20/track", "2 tracks/zz20"), ("zz20/time series", "5 figures/zz20 time series"),
    ("training/forces", "5 figures/training forces"), ("sensitivity", "5 figures/sensitivity"),
])  # fmt: skip
def test_tracks_stand_before_other_figures(name, place):
    assert image_place_of(name) == place


def test_whatever_manoeuvres_are_called_the_held_out_error_comes_first():
    names = ["0_run/nrmse_u", "A.csv/nrmse_u", "train/mse", "score/dev_L", "0_run/dev_L"]
    assert sorted(map(place_of, names))[:2] == [f"{HELD_OUT}/dev_L", f"{HELD_OUT}/dev_L 0_run"]


def test_the_page_of_curves_has_no_empty_chart_and_the_mean_square_one_of_its_own():
    page = charts_of(map(place_of, ["zz20/dev_L", "score/dev_L", "train/relrmse_g1"]))
    assert {heading: list(kinds) for heading, kinds in page.items()} == {
        "Held-out": ["dev_L"],
        "Training": ["mse", "relrmse"],
    }
    _, (such,) = page["Training"]["mse"]
    names = ["3 training/mse", "3 training/validation_mse", "3 training/relrmse_g1"]
    assert [bool(re.match(such, name)) for name in names] == [True, True, False]
    assert {heading: list(kinds) for heading, kinds in charts_of([place_of("testing/rms")]).items()} == {
        "Held-out": ["rms"],
        "Training": ["mse"],
    }
