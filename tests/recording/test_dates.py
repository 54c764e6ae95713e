"""Dates are read as programs write them; day and month are not exchanged in silence."""

import numpy as np
import pytest
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.recording.read.table import read_table

DAY = 86400.0
DAYS = [pytest.param(d) for d in [("02.05.2026", "03.05.2026"), ("2026-05-02", "2026-05-03"), ("2/5/2026", "3/5/2026")]]


@pytest.mark.parametrize(
    "written", mainly(2, ["2.5.2026 {},00", "05/02/2026 {} AM", "02.05.2026 {}", "2026/05/02 {}", "02-05-2026T{}Z"])
)
def test_a_file_whose_dates_are_written_otherwise_is_read(zz20, frame, write, columns, ship, written):
    frame["t"] = [written.format(f"09:{int(t) // 60:02d}:{int(t) % 60:02d}") for t in frame["t"]]
    path = write(frame.to_csv(sep=";", index=False))
    assert propose(path, ship).settings["time"] == {"column": "t", "unit": "iso"}
    record = read_recording(path, columns(time={"column": "t", "unit": "iso"}, delimiter=";"), ship)
    np.testing.assert_allclose(record.time, np.floor(zz20.time))


@pytest.mark.parametrize("days", mainly(1, DAYS))
def test_a_date_and_a_time_of_day_in_two_columns_are_read_past_midnight(zz20, frame, write, columns, ship, days):
    clock = 86380 + frame["t"].astype(int)
    frame["Date"] = [days[s >= DAY] for s in clock]
    frame["Time"] = [f"{s // 3600 % 24:02d}:{s // 60 % 60:02d}:{s % 60:02d}" for s in clock]
    frame = frame[["Date", "Time", *frame.columns.difference(["Date", "Time", "t"], sort=False)]]
    path = write(frame.to_csv(sep=";", index=False))
    assert propose(path, ship).settings["time"] == {"column": "Time", "unit": "clock"}
    record = read_recording(path, columns(time={"column": "Time", "unit": "clock"}, delimiter=";"), ship)
    np.testing.assert_allclose(record.time, np.floor(zz20.time))


@pytest.mark.parametrize(("first", "second", "apart"), [
    ("31/05/2026 23:59:50", "01/06/2026 00:00:00", 10.0), ("05/31/2026 11:59:50 PM", "06/01/2026 12:00:00 am", 10.0),
    ("11.05.2026 09:00:00", "12.05.2026 09:00", DAY), ("05/05/2026 09:00:00", "06/06/2026 09:00:00", 32 * DAY),
    ("02/05/2026 11:59:50 AM", "02/05/2026 12:00:00 PM", 10.0), ("", "", np.nan),
])  # fmt: skip
def test_days_of_a_file_say_which_number_is_the_day(write, first, second, apart):
    stamps = (first, second)
    time = read_table(write("t,u\n" + "".join(f"{stamp},1\n" for stamp in stamps))).times("t", "iso")
    np.testing.assert_allclose(time[1] - time[0], apart)


@pytest.mark.parametrize(("stamps", "said"), [
    (("11/05/2026 23:59:00", "12/05/2026 00:01:00"), "line 3: .*'12/05/2026 00:01:00', where day and month can be"),
    (("31/05/2026 09:00:00", "05/31/2026 09:01:00"), "line 3: .*'05/31/2026 09:01:00'; expected a time such as 2020-"),
])  # fmt: skip
def test_dates_that_can_be_read_in_two_ways_or_in_none_are_refused(write, stamps, said):
    table = read_table(write("t,u\n" + "".join(f"{stamp},1\n" for stamp in stamps)))
    with pytest.raises(InputError, match=said):
        table.times("t", "iso")
