from dataclasses import replace

import numpy as np
import pytest
from diagnosed import brief, proof, windy

from manoeuvre_nn.report.diagnosis_charts import OUTLINES, diagnosis_charts, forecast_chart, forecast_tracks
from manoeuvre_nn.report.diagnosis_figures import draw_diagnosis, in_pairs
from manoeuvre_nn.report.interactive import as_data

WIDTHS = {"x": 21.0, "y": 17.0, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.05, "u_log": 0.1}


@pytest.fixture
def planned():
    p = proof()
    bounds = {f"{c}_{side}": p.after[c] + s * w for c, w in WIDTHS.items() for side, s in (("low", -1), ("high", 1))}
    return replace(p, after=p.after.assign(**bounds))


def test_the_band_is_told_at_the_end_and_drawn_along_the_track(planned):
    (panel,) = forecast_tracks([planned]).panels
    assert panel.title.endswith("band at the end ± 21 m north, ± 17 m east")
    boxes, calm, model = panel.curves
    corners = np.stack([boxes.x, boxes.y], axis=-1).reshape(OUTLINES, 5, 2)
    assert np.ptp(corners[:, :4], axis=1) == pytest.approx(np.tile([34.0, 42.0], (OUTLINES, 1)))
    assert corners[-1, :4].mean(axis=0) == pytest.approx([model.x[-1], model.y[-1]])
    assert (model.x[0], model.y[0]) == (0.0, 0.0) and len(calm.x) == len(planned.before)


def test_the_band_is_drawn_about_the_model_however_narrow_it_is(planned):
    figure = in_pairs(forecast_chart(planned), "zz20")
    figure.draw_without_rendering()
    heading, band = figure.axes[:2]
    assert (heading.get_ylabel(), band.get_ylabel()) == ("heading ψ\n[deg]", "band [deg]")
    drawn = band.collections[0].get_paths()[0].vertices[:, 1]
    assert (drawn.min(), drawn.max()) == pytest.approx((-0.5, 0.5))
    assert [a.get_xlabel() for a in figure.axes] == [""] * 8 + ["time t [s]"] * 2


def test_planned_runs_can_be_zoomed(planned):
    d = replace(brief(windy()), forecasts=[planned])
    names = {name for name in draw_diagnosis(d) if name.startswith("planned")}
    charts = diagnosis_charts(d)
    assert names == {"planned", f"planned/{planned.run}"} <= set(charts)
    (track,), channels = (as_data(charts[name])["panels"] for name in sorted(names))
    assert len(channels) == 10
    assert {"95 % of recordings", "repaired"} <= {trace.get("name") for trace in track["traces"]}
