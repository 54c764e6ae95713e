from dataclasses import replace

import pytest
from diagnosed import proof

from manoeuvre_nn.report.forecast_figure import forecast_figure

WIDTHS = {"x": 21.0, "y": 17.0, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.05, "u_log": 0.1}


def test_the_band_is_told_at_the_end_and_drawn_about_the_model_however_narrow_it_is():
    p = proof()
    bounds = {f"{c}_{side}": p.after[c] + s * w for c, w in WIDTHS.items() for side, s in (("low", -1), ("high", 1))}
    figure = forecast_figure(replace(p, after=p.after.assign(**bounds)))
    figure.draw_without_rendering()
    track, heading, band = figure.axes[:3]
    assert track.get_title("left") == "band at the end ± 21 m north, ± 17 m east"
    assert (heading.get_ylabel(), band.get_ylabel()) == ("heading ψ\n[deg]", "band [deg]")
    drawn = band.collections[0].get_paths()[0].vertices[:, 1]
    assert (drawn.min(), drawn.max()) == pytest.approx((-0.5, 0.5))
    assert [a.get_xlabel() for a in figure.axes[1:]] == [""] * 8 + ["time t [s]"] * 2
