"""Charts of a diagnosis: sensors that are slower than the steps of the model, and channels that nobody recorded."""

from dataclasses import replace

import numpy as np
from diagnosed import NOISE, windy

from manoeuvre_nn.report.diagnosis_charts import REPAIRED, TRUTH, channel_chart, track_chart


def test_a_sensor_slower_than_the_steps_of_the_table_is_drawn_as_a_line_with_its_holes():
    p = windy().proofs[0]
    sparse = p.recorded.copy()
    sparse.loc[1::2, sparse.columns.drop("t")] = np.nan
    sparse.loc[40:80, sparse.columns.drop("t")] = np.nan
    slow = replace(p, recorded=sparse)
    shown, beside = channel_chart(slow, NOISE, repaired=True).panels[:2]
    (track,) = track_chart([slow], repaired=True).panels
    for panel, style in ((shown, TRUTH), (beside, REPAIRED), (track, TRUTH)):
        line = next(c for c in panel.curves if c.style["color"] == style["color"] and not c.filled)
        known = np.isfinite(line.y)
        joined = known[1:] & known[:-1]
        assert joined[:19].all()
        assert not joined[20:60].any()
        assert joined[63:70].all()


def test_a_channel_that_was_not_recorded_is_not_drawn():
    p = windy().proofs[0]
    labels = [panel.ylabel for panel in channel_chart(p, NOISE, repaired=True).panels[::2]]
    without = replace(p, recorded=p.recorded.assign(u_log=np.nan))
    fewer = [panel.ylabel for panel in channel_chart(without, NOISE, repaired=True).panels[::2]]
    assert fewer == [label for label in labels if "log" not in label]
    assert len(fewer) == len(labels) - 1
