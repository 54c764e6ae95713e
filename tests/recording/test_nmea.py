"""A log of NMEA 0183 is read as the run was sailed, whoever wrote its times; what is damaged is dropped and counted."""

import numpy as np
import pandas as pd
import pytest
from logs import MIDNIGHT, placed, sentence, sentences, write_nmea

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.check.file_checks import file_findings
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.propose.proposal_yaml import to_yaml
from manoeuvre_nn.recording.read import nmea
from manoeuvre_nn.recording.read.reader import read_recording, read_recordings
from manoeuvre_nn.recording.read.table import read_table

STAMPS = {
    "none": None,
    "iso": "%Y-%m-%dT%H:%M:%S.%fZ ",
    "iso and a zone": "%Y-%m-%d %H:%M:%S.%f+00:00,",
    "strokes": "%Y/%m/%d %H:%M:%S.%f;",
    "day first": "%d.%m.%Y %H:%M:%S,%f ",
    "without marks": "%Y%m%d_%H%M%S.%f ",
    "clock in brackets": "[%H:%M:%S.%f] ",
    "number and clock": "17, %H:%M:%S.%f, ",
}


def cells(path, *lines):
    path.write_bytes(b"\r\n".join(x if isinstance(x, bytes) else x.encode("latin-1") for x in lines) + b"\r\n")
    return read_table(path)


def position(second):
    return sentence(f"GPRMC,0000{second:05.2f},A,4807.038,N,01131.000,E,1.0,2.0,230394,,,A")


def _since(record):
    """Times of a record since the begin of the log [s]."""
    return record.time + record.meta["started"] - MIDNIGHT.timestamp()


@pytest.mark.parametrize("how", ["none", "clock in brackets"])
def test_a_log_is_proposed_and_read_as_it_was_sailed_over_midnight(zz20, ship, tmp_path, how):
    path = write_nmea(tmp_path / "run.nmea", zz20, STAMPS[how])
    made = propose(path, ship)
    assert made.finding is None and set(made.questions) == {"reference_point"}
    record = read_recording(path, made.mapping, ship)
    np.testing.assert_allclose(record.time, zz20.time, atol=1e-5)
    np.testing.assert_allclose(record["r"], zz20["r"], atol=1e-5 * DEGREE / 60)
    np.testing.assert_allclose(record["psi"], zz20["psi"], atol=1e-4 * DEGREE)
    np.testing.assert_allclose(record["delta"], zz20["delta"], atol=1e-5 * DEGREE)
    for name in ("u", "v"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-6 * KNOT)
    for name in ("x", "y"):  # 1e-6 minutes are 2 mm; the radii of the earth are those of the reader
        np.testing.assert_allclose(record[name], zz20[name], atol=0.01 + 2e-4 * np.ptp(zz20[name]))
    assert record.meta["started"] == (MIDNIGHT.timestamp() if how == "none" else 86220.0)


@pytest.mark.parametrize("how", STAMPS)
def test_times_of_a_logger_are_read_in_its_form_over_midnight(zz20, tmp_path, how):
    table = read_table(write_nmea(tmp_path / "run.nmea", zz20, STAMPS[how]))
    if "clock" in how:
        np.testing.assert_allclose(table.numbers("time [s]"), 86220.0 + zz20.time)
    else:
        np.testing.assert_allclose(table.times("time", "iso"), MIDNIGHT.timestamp() + zz20.time)


@pytest.mark.parametrize("count", ["\\s:GPS,c:%d*5A\\", "%d ", "%.3f,", "17, %d, COM3, "])
def test_counts_since_1970_in_tag_blocks_or_before_sentences_are_times(tmp_path, count):
    for unit in (1, 1000):
        lines = [count % (unit * (1.6e9 + k)) + sentence(f"HEHDT,{k}.0,T") for k in range(40)]
        table = cells(tmp_path / "run.log", *lines)
        np.testing.assert_allclose(table.times("time", "iso"), 1.6e9 + np.arange(40))


def test_seconds_since_the_logger_started_are_times_too(tmp_path):
    table = cells(tmp_path / "run.log", *(f"{0.5 * k:.2f} {sentence(f'HEHDT,{k}.0,T')}" for k in range(40)))
    np.testing.assert_allclose(table.numbers("time [s]"), 0.5 * np.arange(40))


def test_numbers_of_lines_are_no_times(tmp_path):
    table = cells(tmp_path / "run.log", *(f"{k},{position(2 * k)}" for k in range(25)))
    np.testing.assert_allclose(np.diff(table.times("time", "iso")), 2.0)


def test_what_is_damaged_or_foreign_is_dropped_and_counted(zz20, ship, tmp_path):
    path = write_nmea(tmp_path / "run.nmea", zz20)
    lines = path.read_bytes().split(b"\r\n")
    rubbish = [
        b"!AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0*24",
        b"\xff\x00\xfe$\x07",
        b"$PSRT,1,2*00",
        b"",
        b"no sense",
    ]
    changed = [line.replace(b"HEHDT,", b"HEHDT,1", 1) if k % 70 == 1 else line for k, line in enumerate(lines)]
    cut = [line[:12] if k % 140 == 9 else line for k, line in enumerate(changed)]
    path.write_bytes(b"\r\n".join(one for k, line in enumerate(cut) for one in (line, *rubbish[: k % 6])))
    made = propose(path, ship)
    lost = sum(a != b for a, b in zip(lines, cut, strict=True))
    assert f"Dropped: {lost} of " in made.notes[0] and f"# Dropped: {lost} of " in to_yaml(made)
    said = [f.text for f in file_findings(path, made.mapping, ship) if f.verdict == "note"]
    assert any(text.startswith(f"Dropped: {lost} of ") for text in said)
    record = read_recording(path, made.mapping, ship)
    np.testing.assert_allclose(record["psi"], np.interp(_since(record), zz20.time, zz20["psi"]), atol=0.05 * DEGREE)


def test_sentences_without_any_checksum_are_read_with_a_warning(zz20, ship, tmp_path):
    path = write_nmea(tmp_path / "run.nmea", zz20)
    path.write_text("\n".join(line.partition("*")[0] for line in path.read_text().splitlines()))
    made = propose(path, ship)
    assert "no checksums" in made.notes[0]
    np.testing.assert_allclose(read_recording(path, made.mapping, ship)["psi"], zz20["psi"], atol=1e-4 * DEGREE)


def test_instruments_of_several_rates_stand_on_the_samples_of_the_slowest_that_is_used(zz20, ship, tmp_path):
    fine = np.arange(0.0, zz20.time[-1], 0.1)
    table = placed(zz20)
    continuous = {k: np.unwrap(table[k], period=360) if k in {"hdg", "cog"} else table[k] for k in table}
    faster = pd.DataFrame({k: np.interp(fine, zz20.time, v) for k, v in continuous.items()})
    faster[["hdg", "cog"]] = np.mod(faster[["hdg", "cog"]], 360)
    lines = []
    for k, row in enumerate(faster.itertuples()):
        now = MIDNIGHT + pd.Timedelta(seconds=row.t)
        rmc, hdt, rot, rsa, *_ = sentences(row, now)
        wanted = ([rmc] if k % 10 == 0 else []) + [hdt] + ([rot, rsa] if k % 2 == 1 else [])
        lines += [f"{now.isoformat()} {one}" for one in wanted]
        lines += [f"{now.isoformat()} {sentence('WIMWD,10.0,T,,M,5.0,N,2.6,M')}"] if k % 50 == 3 else []
    path = tmp_path / "run.nmea"
    path.write_text("\n".join(lines))
    made = propose(path, ship)
    record = read_recording(path, made.mapping, ship)
    assert record.step == 1.0 and "wind_speed" in record.channels and made.mapping.fill_gaps is False
    np.testing.assert_allclose(record["psi"], np.interp(_since(record), zz20.time, zz20["psi"]), atol=0.05 * DEGREE)


def test_a_heading_between_359_and_1_degrees_is_read_through_north(tmp_path):
    lines = [f"{k / 10:.1f} {sentence(f'HEHDT,{(350 + k) % 360}.0,T')}" for k in range(40)]
    lines += [f"{k / 10 + 0.05:.2f} {sentence(f'AGRSA,{k}.0,A,,')}" for k in range(1, 38)]
    table = cells(tmp_path / "run.log", *lines)
    np.testing.assert_allclose(np.mod(table.numbers("HEHDT.heading [deg]"), 360), np.mod(350.5 + np.arange(1, 38), 360))


def test_where_a_sensor_was_silent_its_cells_are_empty(tmp_path):
    lines = [f"{k}.0 {sentence(f'{name},{k}.0,A')}" for k in range(60) for name in ("HETHS", "HEROT")]
    lines += [f"{k}.5 {sentence(f'AGRSA,{k}.0,A,,')}" for k in range(60) if not 20 <= k < 30]
    rudder = cells(tmp_path / "run.log", *lines).numbers("AGRSA.rudder [deg]")
    assert np.isnan(rudder).sum() == 11 and np.nanmax(np.abs(np.diff(rudder))) <= 1.0


def test_without_stamps_several_headings_between_two_positions_are_spread_evenly(tmp_path):
    lines = [one for k in range(30) for one in (position(k), *(sentence(f"HEHDT,{k + j / 4},T") for j in range(4)))]
    cells(tmp_path / "run.log", *lines)
    table = read_table(tmp_path / "run.log", ["HEHDT.heading [deg]"])
    heading, seconds = table.numbers("HEHDT.heading [deg]"), table.times("time", "iso")
    assert len(heading) == 120
    np.testing.assert_allclose(heading, seconds - seconds[0], atol=1e-6)
    assert seconds[0] == pd.Timestamp("1994-03-23").timestamp()


FIELDS = {
    "GPGGA,000001,4807.038,S,01131.000,W,1,08,0.9,545.4,M,46.9,M,,": {"GPGGA.latitude [deg]": -48.1173,
                                                                     "GPGGA.longitude [deg]": -11.516667},
    "GPGLL,4916.45,N,12311.12,W,000001,A": {"GPGLL.latitude [deg]": 49.274167, "GPGLL.longitude [deg]": -123.185333},
    "GNGNS,000001,4807.038,N,01131.000,E,AN,08,0.9,545.4,46.9,,": {"GNGNS.latitude [deg]": 48.1173},
    "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K": {"GPVTG.cog [deg]": 54.7, "GPVTG.sog [kn]": 5.5},
    "VWVHW,45.0,T,43.0,M,3.5,N,6.4,K": {"VWVHW.speed_through_water [kn]": 3.5, "VWVHW.heading [deg]": 45.0},
    "VDVBW,12.1,-0.2,A,12.4,0.3,A,,V,,V": {"VDVBW.surge_over_ground [kn]": 12.4, "VDVBW.sway_over_ground [kn]": 0.3,
                                          "VDVBW.speed_through_water [kn]": 12.1},
    "HCHDG,101.1,1.5,W,7.1,E": {"HCHDG.heading [deg]": 106.7, "HCHDG.heading_magnetic [deg]": 99.6},
    "HCHDM,238.5,M": {"HCHDM.heading_magnetic [deg]": 238.5},
    "GPTHS,77.5,A": {"GPTHS.heading [deg]": 77.5},
    "TIROT,-35.6,A": {"TIROT.rot [deg/min]": -35.6},
    "AGRSA,5.0,A,-4.0,A": {"AGRSA.rudder_starboard [deg]": 5.0, "AGRSA.rudder_port [deg]": -4.0},
    "ERRPM,S,1,98.5,10.0,A": {"ERRPM.shaft [rpm]": 98.5},
    "WIMWV,214.8,R,10.0,K,A": {"WIMWV.apparent_wind_angle [deg]": 214.8, "WIMWV.apparent_wind_speed [m/s]": 2.777778},
    "WIMWD,30.0,T,28.0,M,10.0,N,5.1,M": {"WIMWD.wind_direction [deg]": 30.0, "WIMWD.wind_speed [m/s]": 5.1},
    "SDDPT,76.1,0.0": {"SDDPT.depth [m]": 76.1},
    "SDDBT,7.8,f,2.4,M,1.3,F": {"SDDBT.depth [m]": 2.4},
    "AGHTD,V,2.8,L,M,N,,,,,,,,A,A,A,": {"AGHTD.rudder_order [deg]": -2.8},
}  # fmt: skip


@pytest.mark.parametrize("words", FIELDS)
def test_fields_of_a_sentence_stand_where_the_standard_has_them(tmp_path, words):
    table = cells(tmp_path / "run.log", *(f"{k}.0 {sentence(words)}" for k in range(30)))
    for column, value in FIELDS[words].items():
        np.testing.assert_allclose(table.numbers(column), value, atol=1e-6)


INVALID = ["GPRMC,000001,V,4807.038,N,01131.000,E,1.0,2.0,230394,,,N", "GPGGA,000001,4807.0,N,01131.0,E,0,0,,,M,,M,,",
           "TIROT,35.6,V", "AGRSA,5.0,V,,", "GPTHS,77.5,V", "WIMWV,214.8,R,10.0,K,V"]  # fmt: skip


@pytest.mark.parametrize("words", INVALID)
def test_what_an_instrument_calls_invalid_is_not_read(tmp_path, words):
    lines = [f"{k}.0 {one}" for k in range(30) for one in (sentence(words), sentence("HEHDT,1.0,T"))]
    assert list(cells(tmp_path / "run.log", *lines).cells) == ["time [s]", "HEHDT.heading [deg]"]


def test_two_shafts_are_starboard_and_port_by_their_odd_and_even_numbers(tmp_path):
    lines = [f"{k}.{n} {sentence(f'ERRPM,S,{n},{90 + n}.0,10.0,A')}" for k in range(30) for n in (1, 2)]
    table = cells(tmp_path / "run.log", *lines)
    assert np.nanmean(table.numbers("ERRPM.shaft_starboard [rpm]")) == 91
    assert np.nanmean(table.numbers("ERRPM.shaft_port [rpm]")) == 92


def test_two_instruments_that_say_the_same_sentence_are_kept_apart(tmp_path):
    lines = [f"{k}.0 {sentence(f'{talker}HDT,{at}.0,T')}" for k in range(30) for talker, at in (("HE", 1), ("TI", 2))]
    table = cells(tmp_path / "run.log", *lines)
    assert set(table.numbers("HEHDT.heading [deg]")) == {1.0} and set(table.numbers("TIHDT.heading [deg]")) == {2.0}


def test_a_magnetic_heading_is_undecided_and_asked_about(zz20, ship, tmp_path):
    path = write_nmea(tmp_path / "run.nmea", zz20)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(sentence("HCHDM" + x[6:].partition(",T*")[0] + ",M") if "HDT" in x else x for x in lines))
    made = propose(path, ship)
    assert "psi" in made.questions and "undecided: magnetic: add the variation" in to_yaml(made)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty file"),
        (b"t,u\n1,2\n", "no sentence such as .GPRMC or .HEHDT; expected NMEA 0183"),
        (b"\x89PNG" + bytes(300), "no sentence such as"),
        (b"$GPRMC,000000,A,4807.038,N,01131.000,E,1.0,2.0,230394,,,A*00\n" * 9, "no sentence .* with a right checksum"),
        ((sentence("HEHDT,1.0,T") + "\n").encode() * 30, "neither time stamps of a logger nor sentences with a time"),
        ((sentence("GPZDA,000000,23,03,1994,00,00") + "\n").encode() * 30, "no sentence has both a value and a time"),
        (b"$GPRMC," + b"9" * 400_000, "neither time stamps"),
    ],
)  # fmt: skip
def test_what_is_no_log_is_refused_in_one_line(tmp_path, ship, content, message):
    path = tmp_path / "run.nmea"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        propose(path, ship)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_a_log_of_any_name_is_known_by_its_sentences_and_stands_beside_other_files(zz20, ship, tmp_path):
    path = write_nmea(tmp_path / "a.txt", zz20)
    mapping = propose(path, ship).mapping
    write_nmea(tmp_path / "b.txt", zz20)
    assert [run.name for run in read_recordings(tmp_path, mapping, ship)] == ["a", "b"]


def test_block_by_block_a_log_is_read_as_at_once(zz20, tmp_path, monkeypatch):
    path = write_nmea(tmp_path / "run.nmea", zz20, "[%H:%M:%S.%f] ")
    whole = read_table(path).cells
    monkeypatch.setattr(nmea, "BLOCK", 5000)
    pd.testing.assert_frame_equal(read_table(path).cells, whole)


def test_a_log_that_does_not_fit_into_memory_is_refused_before_it_is_read(zz20, tmp_path, monkeypatch):
    path = write_nmea(tmp_path / "run.nmea", zz20)
    monkeypatch.setattr("manoeuvre_nn.core.memory.free_memory", lambda: 1000.0)
    with pytest.raises(InputError, match="GB of sentences need about .* cut the log into parts"):
        read_table(path)


def test_a_byte_that_is_no_letter_in_a_field_of_letters_is_read_over(tmp_path):
    words = "HEROT,1.5,\xc1"
    table = cells(
        tmp_path / "run.nmea", position(0), sentence(words), position(1), sentence("HEROT,2.5,A"), position(2)
    )
    assert table.cells["HEROT.rot [deg/min]"].iloc[0] == 1.5
