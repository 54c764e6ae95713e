"""Mappings proposed for recordings in many units, signs, axes and names read the same motion again."""

import re
from dataclasses import replace
from functools import cache
from time import monotonic

import numpy as np
import pandas as pd
import pytest
import yaml
from exports import EXPORTS, plain, without, wrapped
from fleet import unchecked
from tiers import mainly, only

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.propose.headings import WORDS, take_apart, word_score
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.propose.proposal_yaml import to_yaml
from manoeuvre_nn.recording.read.reader import read_recording

DERIVED = {"no rate", "no rate, degrees", "no velocities", "no track", "no track, knots", "gps"}
"""Exports that lack a channel: it is derived, so not exact."""
LIKE_OTHERS = {
    "degrees", "all at once", "milliseconds", "earth", "antenna", "no rate", "astern", "rate to port", "camels",
    "u and v exchanged", "west", "heading to port", "heading 0 to 360", "heading from east", "german", "as it is",
    "long names", "km/h and feet", "minutes", "heading and rate to port", "x and y exchanged",
}  # fmt: skip
"""Exports of which others hold all, or which are read where the ship need not be known."""


def apart(record, run):
    """Largest error of each channel over its size; positions and headings may begin anywhere."""
    found = {}
    for name in ("u", "v", "r", "delta"):
        found[name] = np.abs(record[name] - run[name]).max() / np.abs(run[name]).max()
    for name in ("x", "y", "psi"):
        error = (record[name] - record[name][0]) - (run[name] - run[name][0])
        found[name] = np.abs(error).max() / np.ptp(run[name])
    return found


@pytest.fixture(scope="module")
def proposed(zz20, ship, tmp_path_factory):
    """What is proposed for an export, which several tests look at."""

    @cache
    def look(how):
        path = tmp_path_factory.mktemp("exports") / "run.csv"
        pd.DataFrame(EXPORTS[how](zz20)).to_csv(path, index=False)
        with unchecked():  # types are checked where the ship need not be known
            return propose(path, ship)

    return look


@pytest.fixture
def export(tmp_path):
    def write(columns, **how):
        path = tmp_path / "run.csv"
        pd.DataFrame(columns).to_csv(path, **{"index": False, **how})
        return path

    return write


def choice(made, channel):
    return next(c for c in made.choices if c.channel == channel)


@pytest.mark.parametrize("how", only(set(EXPORTS) - LIKE_OTHERS, EXPORTS))
def test_what_was_exported_is_read_as_it_was_sailed(zz20, ship, proposed, how):
    made = proposed(how)
    content = yaml.safe_load(to_yaml(made))
    assert "_target_" not in content
    made = replace(made, settings=content)
    record = read_recording(made.file.path, made.mapping, ship)
    errors = apart(record, zz20)
    assert max(errors.values()) < (0.08 if how in DERIVED else 0.01), (errors, to_yaml(made))
    assert made.finding is None


@pytest.mark.parametrize("how", mainly(4, ["all at once", "milliseconds", "earth", "antenna", "degrees"]))
def test_the_ship_need_not_be_known_where_the_file_says_enough(zz20, ship, export, how):
    path = export(EXPORTS[how](zz20))
    made = propose(path)
    assert max(apart(read_recording(path, made.mapping, ship), zz20).values()) < 0.01
    assert all(c.decided for c in (made.time, *made.choices)) and set(made.undecided) <= {"reference_point"}


UNITS = {
    "ROT deg/min": ("rot", "deg/min"), "ROT [deg / min]": ("rot", "deg/min"), "ROT (°/min)": ("rot", "deg/min"),
    "Turn rate °/min": ("turn_rate", "deg/min"), "turn rate deg per min": ("turn_rate", "deg/min"),
    "rot_deg_per_min": ("rot", "deg/min"), "Yaw rate °/s": ("yaw_rate", "deg/s"), "Speed m/s": ("speed", "m/s"),
    "n 1/s": ("n", "1/s"), "psi °": ("psi", "deg"), "Heading true deg": ("heading_true", "deg"),
    "log.nav.yaw_rate [rad/s]": ("log_nav_yaw_rate", "rad/s"),
}  # fmt: skip


@pytest.mark.parametrize("heading", UNITS)
def test_units_behind_a_name_are_read_with_and_without_brackets(heading):
    made = take_apart(heading)
    assert (made.name, made.unit) == UNITS[heading]


GERMAN = {
    "Kompass (°)": "psi", "Kompasskurs [°]": "psi", "Kreiselkurs": "psi", "Wendegeschw. (°/min)": "r",
    "Drehgeschwindigkeit": "r", "Ruderlage (°)": "delta", "Wellendrehzahl (U/min)": "n", "Logge [kn]": "u_log",
    "Fahrt durchs Wasser [kn]": "u_log", "Fahrt über Grund [kn]": "sog", "Kurs über Grund": "cog",
    "Breite": "lat", "Länge": "lon", "Krängung (°)": "phi",
}  # fmt: skip


@pytest.mark.parametrize("heading", GERMAN)
def test_headings_of_german_bridges_name_their_channel(heading):
    scores = {channel: word_score(channel, take_apart(heading)) for channel in WORDS}
    assert max(scores, key=lambda channel: scores[channel]) == GERMAN[heading]


@pytest.mark.parametrize("unit", ["deg/min", "deg/s", ""])
def test_a_rate_of_turn_in_degrees_a_minute_is_decided_by_the_heading_whatever_its_own_says(zz20, ship, export, unit):
    table = {**plain(zz20), "psi": wrapped(zz20["psi"])}
    table = {k: v for k, v in table.items() if k != "r"} | {f"ROT {unit}".strip(): -zz20["r"] * 60 / DEGREE}
    r = choice(propose(export(table), ship), "r")
    assert (r.unit, r.sign, r.decided) == ("deg/min", -1, True) and float(r.misfit) < 0.02
    assert (
        r.why
        == {"deg/min": "unit by name", "deg/s": "unit by data, against its heading", "": "unit by data"}[unit]
        + "; sign by psi"
    )


@pytest.mark.slow
def test_noise_does_not_turn_the_axes(zz20, ship, export):
    stream = np.random.default_rng(1)
    sd = {"u": 0.05, "v": 0.05, "r": 5e-4, "x": 1.0, "y": 1.0, "psi": 3e-3, "delta": 3e-3}
    noisy = zz20.with_channels(**{k: zz20[k] + s * stream.standard_normal(len(zz20)) for k, s in sd.items()})
    for how in ("all at once", "gps", "earth", "antenna"):
        path = export(EXPORTS[how](noisy))
        assert max(apart(read_recording(path, propose(path, ship).mapping, ship), noisy).values()) < 0.25, how


def test_the_distance_of_an_antenna_from_midship_is_found(zz20, ship, export):
    made = propose(export(EXPORTS["antenna"](zz20)), ship)
    assert made.settings["position_point"] == pytest.approx(40.0, abs=1.0)


def test_a_sway_that_was_never_recorded_tells_no_distance(zz20, ship, export):
    made = propose(export(plain(zz20) | {"v": 0 * zz20["v"]}), ship)
    assert "position_point" not in made.settings and "reference_point" in made.undecided
    assert any("Never moving" in note and "v (v)" in note for note in made.notes)


def test_units_that_nothing_tells_are_said_to_be_undecided(zz20, export):
    made = propose(export(EXPORTS["no track, knots"](zz20)))
    assert not choice(made, "u").decided
    assert "# undecided: usual unit" in to_yaml(made)
    assert "reference_point: 0.0  # undecided" in to_yaml(made)


def test_a_heading_that_states_the_wrong_unit_is_read_by_the_data_and_marked(proposed):
    made = proposed("headings that lie")
    assert "unit by data, against its heading" in choice(made, "psi").why
    assert choice(made, "u").unit == "m/s" and not choice(made, "u").decided


def test_two_velocities_whose_headings_state_different_units_are_marked(zz20, ship, export):
    """One unit is taken for both: the sway in knots was read as m/s without a word."""
    table = plain(zz20)
    mixed = {
        **{k: v for k, v in table.items() if k not in {"u", "v"}},
        "u [m/s]": table["u"],
        "v [kn]": table["v"] / KNOT,
    }
    made = propose(export(mixed), ship)
    for name in ("u", "v"):
        assert not choice(made, name).decided and "headings state different units" in choice(made, name).why


def test_reasons_show_the_misfit_of_what_was_chosen_and_of_the_next(proposed):
    made = proposed("sway to port")
    sway = choice(made, "v")
    assert sway.sign == -1 and float(sway.misfit) < 0.02 and float(sway.next.split()[0]) > 0.2
    assert sway.next.endswith("v +")


@pytest.mark.parametrize(("sign", "side"), mainly(1, [(-1, "port"), (1, "starboard")]))
def test_the_side_of_the_rudder_is_read_off_the_yaw_rate(zz20, ship, export, sign, side):
    made = propose(export({**plain(zz20), "delta": sign * zz20["delta"]}), ship)
    assert made.settings["rudder_positive_to"] == side and "standard errors" in made.reasons["rudder_positive_to"]


def test_a_rudder_that_rests_decides_no_side(zz20, ship, export):
    made = propose(export({**plain(zz20), "delta": np.zeros(len(zz20))}), ship)
    assert made.undecided == ("reference_point", "rudder_positive_to")
    assert "rudder_positive_to: starboard  # undecided" in to_yaml(made)


def test_a_column_of_orders_is_followed_by_the_rudder(zz20, ship, export):
    columns = {k: v for k, v in plain(zz20).items() if k != "delta"}
    made = propose(export({**columns, "rudder_command": zz20["delta_order"]}), ship)
    assert made.mapping.rudder == "order" and made.settings["rudder_positive_to"] == "starboard"


def test_everything_else_is_read_by_name_and_size(zz20, ship, export):
    n = np.ones(len(zz20))
    wind = {"TWS (kn)": 9 * n, "TWD": 200 * n, "AWA": 100 * n, "apparent wind speed [m/s]": 12 * n}
    others = {"STW": zz20["u"] / KNOT, "RPM": 80 * n, "Roll [deg]": 2 * n, "comment": n}
    made = propose(export({**plain(zz20), **others, **wind}), ship)
    units = {c.channel: c.unit for c in made.choices}
    assert units | {"n": "rpm", "u_log": "kn", "phi": "deg", "wind_speed": "kn", "wind_from": "deg"} == units
    assert units["wind_from_relative"] == "deg" and units["wind_speed_relative"] == "m/s"
    assert made.left_out == ("comment",)


LAYOUTS = {
    "semicolons and commas": ({"sep": ";", "decimal": ","}, ""),
    "tabs": ({"sep": "\t"}, ""),
    "a preamble": ({}, "Ship: Mariner\nDate, place: 1970, at sea\n\n"),
}


@pytest.mark.parametrize("how", LAYOUTS)
def test_the_layout_of_a_text_is_found(zz20, ship, tmp_path, how):
    """Without positions, so that no axes are looked for."""
    settings, preamble = LAYOUTS[how]
    path = tmp_path / "run.txt"
    columns = without("x", "y")(zz20)
    path.write_text(preamble + pd.DataFrame(columns).to_csv(index=False, **settings))
    record = read_recording(path, propose(path, ship).mapping, ship)
    np.testing.assert_allclose(record["v"], zz20["v"])


def test_units_in_a_line_below_the_headings_and_a_sign_of_comment_are_understood(zz20, ship, tmp_path):
    columns = {**plain(zz20), "psi": wrapped(zz20["psi"]), "u": zz20["u"] / KNOT, "v": zz20["v"] / KNOT}
    body = pd.DataFrame(columns).to_csv(index=False, header=False, sep=" ")
    path = tmp_path / "run.dat"
    path.write_text(f"% {' '.join(columns)}\n% s kn kn rad/s m m deg rad\n{body}")
    made = propose(path, ship)
    assert made.mapping.header is False and choice(made, "u").why.startswith("unit by name")
    np.testing.assert_allclose(read_recording(path, made.mapping, ship)["u"], zz20["u"])
    assert "# psi" in to_yaml(made)


def test_gaps_and_outliers_are_said(zz20, ship, export):
    columns = pd.DataFrame(plain(zz20))
    columns.loc[[50, 51], "x"] = np.nan
    columns.loc[90, "u"] = 30.0
    made = propose(export(columns), ship)
    assert made.mapping.fill_gaps is True and any("u 1; outliers: fill" in note for note in made.notes)


def test_channels_without_scale_or_motion_become_a_record(zz20, ship, export):
    made = propose(export({"t_s": zz20.time, "yaw_rate_counts": zz20["r"] * 1e5, "roll_counts": zz20["r"]}))
    assert made.mapping.kind == "record" and {c.unit for c in made.choices} == {"count"}


@pytest.mark.parametrize(("heading", "side"), mainly(1, [("Rudder PS+", "port"), ("rudder stbd", "starboard")]))
def test_a_rudder_called_by_a_side_is_the_only_one_where_there_is_no_other(zz20, ship, export, heading, side):
    columns = {k: v for k, v in plain(zz20).items() if k != "delta"}
    made = propose(export({**columns, heading: (1 if side == "starboard" else -1) * zz20["delta"]}), ship)
    assert choice(made, "delta").column == heading
    assert made.settings["rudder_positive_to"] == side
    both = {"rudder stbd": zz20["delta"], "rudder port": zz20["delta"]}
    assert {c.channel for c in propose(export({**columns, **both}), ship).choices} >= {"delta_port", "delta_starboard"}


def test_angles_of_a_record_that_reach_beyond_a_circle_are_degrees(zz20, export):
    made = propose(export({"t_s": zz20.time, "HDG": 200.0 + zz20["psi"], "ROT": zz20["r"]}))
    assert made.mapping.kind == "record"
    assert (choice(made, "psi").unit, choice(made, "psi").decided) == ("deg", True)
    assert (choice(made, "r").unit, choice(made, "r").decided) == ("count", False)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty file"), ("hello\nworld\n", "no columns of numbers"), (b"\x89PNG\0\0", "not a text file"),
        ("a,b,c\n1,2,3\n1,3,4\n0,3,3\n", "no column of time; it has: a, b, c"),
        ("t,u\n1,2\n2,3\n2,4\n3,5\n", "line 4: column 't' goes from 2 to 2; times must increase"),
        ("t,u\n1,2\n,3\n2,4\n3,5\n", "line 3: column 't' is empty"),
        ("t,a1,b1\n1,2,3\n2,3,4\n3,4,5\n", "no column is called like a known channel"),
        ("t,u,psi\n1,2,3\n2,3,4\n3,4,5\n4,5", "line 5: 2 cells, expected 3 .cut off"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_refused_in_one_line(write, content, message):
    with pytest.raises(InputError, match=message) as error:
        propose(write(content))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("heading", "channel", "unit"),
    [
        ("Rate of turn [°/min]", "r", "deg/min"), ("posN", "x", ""), ("Ruderwinkel_deg", "delta", "deg"),
        ("thrust_N", "thrust", "N"), ("ship.nav.yawRate", "r", ""), ("delta_cmd (deg)", "delta_order", "deg"),
        ("ψ [rad]", "psi", "rad"), ("n_prop [rps]", "n", "1/s"), ("GPS Speed (kts)", "sog", "kn"),
    ],
)  # fmt: skip
def test_headings_of_many_styles_are_understood(heading, channel, unit):
    parted = take_apart(heading)
    assert parted.unit == unit
    assert word_score(channel, parted) > 0


def test_a_unit_that_measures_something_else_rules_a_channel_out():
    assert word_score("psi", take_apart("heading [m/s]")) == 0


@pytest.mark.parametrize("below", [False, True], ids=["as a heading", "in a comment"])
def test_a_heading_cannot_break_out_of_its_line_in_the_yaml(zz20, ship, tmp_path, below):
    hostile = 'psi "} \u2028evil: {"x": 1} # \x85evil: 2'
    columns = {hostile if k == "psi" else k: v for k, v in plain(zz20).items()}
    units = "s\tm/s\tm/s\trad/s\tm\tm\trad\trad\n" if below else ""
    path = tmp_path / "run.txt"
    numbers = pd.DataFrame(columns).to_csv(index=False, header=False, sep="\t")
    path.write_text("\t".join(name.replace('"', "'") for name in columns) + f"\n{units}{numbers}")
    made = propose(path, ship)
    content = yaml.safe_load(to_yaml(made))
    assert set(content) == {"format", *made.settings} and "evil" not in content
    assert content["channels"]["psi"]["column"] == choice(made, "psi").column


def test_times_that_cannot_be_read_are_refused_and_no_other_column_is_taken_for_time(zz20, ship, export):
    table = plain(zz20) | {"x": zz20["u"].mean() * zz20.time}
    table["t"] = np.array([f"31 July 13:{int(t) // 60:02d}:{int(t) % 60:02d}" for t in zz20.time])
    with pytest.raises(InputError, match="column 't' is '31 July 13:00:00'; expected seconds, 13:04:24.5 or"):
        propose(export(table), ship)
    with pytest.raises(InputError, match="no column of time"):
        propose(export({k: v for k, v in table.items() if k != "t"}), ship)


def test_headings_that_stand_twice_are_named(zz20, ship, export):
    path = export(plain(zz20) | {"z": zz20["x"]})
    path.write_text(path.read_text().replace("psi", "y", 1))
    made = propose(path, ship)
    assert made.notes[0] == "Several columns are called 'y' and are left out: rename them."
    assert made.settings["kind"] == "record" and {"y", "psi"}.isdisjoint(c.channel for c in made.choices)


def test_a_channel_that_stands_still_is_named(zz20, ship, export):
    made = propose(export(plain(zz20) | {"psi": 0 * zz20["psi"]}), ship)
    assert "Never moving, so that nothing can be compared with it: psi (psi); name another column." in made.notes


def test_the_unit_of_a_small_rudder_angle_on_a_straight_course_is_the_one_that_is_stated(zz20, ship, export):
    table = plain(zz20) | {"r": 0.001 * zz20["r"], "psi": 0.001 * zz20["psi"], "y": 0.001 * zz20["y"]}
    table["v"] = 0.001 * zz20["v"]
    delta = table.pop("delta") * 0.3 / np.abs(zz20["delta"]).max()
    rudder = choice(propose(export(table | {"rudder_deg": delta}), ship), "delta")
    assert (rudder.unit, rudder.decided) == ("deg", True)
    rudder = choice(propose(export(plain(zz20) | {"rudder_deg": delta}), ship), "delta")
    assert (rudder.unit, rudder.decided) == ("rad", False)


@pytest.mark.parametrize(("heading", "size"), [("COG [rad]", 1.0), ("COG", 1.0), ("COG [deg]", 180 / np.pi)])
def test_a_course_is_written_down_in_the_unit_that_it_was_read_in(zz20, ship, export, heading, size):
    table = EXPORTS["gps"](zz20)
    table[heading] = (np.radians(table.pop("COG")) + np.pi) % (2 * np.pi) - np.pi
    table[heading] = table[heading] * size
    made = propose(export(table), ship)
    record = read_recording(made.file.path, made.mapping, ship)
    assert np.abs(record["u"] - zz20["u"]).max() < 0.05 * zz20["u"].max()


@pytest.mark.parametrize(
    ("heading", "channel"),
    [("vlängs (m/s)", "u"), ("Länge [°]", "lon"), ("Krängung (deg)", "phi"), ("timón", "delta"), ("Ψ", "psi")],
)
def test_letters_with_marks_are_read(heading, channel):
    assert word_score(channel, take_apart(heading)) > 0


@pytest.mark.parametrize(
    "text", ["a,b\n" + "1" * 100_000 + ",2\n", "(" * 100_000 + ",wind" * 3 + "\n1,2,3,4\n2,3,4,5\n"]
)
def test_endless_cells_are_refused_without_a_long_wait(tmp_path, text):
    (tmp_path / "run.csv").write_text(text)
    before = monotonic()
    with pytest.raises(InputError):
        propose(tmp_path / "run.csv")
    assert monotonic() - before < 5.0


def test_numbers_that_no_ship_reaches_are_refused(zz20, ship, export):
    with pytest.raises(InputError, match="run.csv, line 2: column .u. is 7.*e.300, which no motion of a ship does"):
        propose(export({k: v * (1.0 if k == "t" else 1e300) for k, v in plain(zz20).items()}), ship)


def test_reasons_hold_no_empty_or_endless_numbers(zz20, ship, export):
    units = {"t": "s", "u": "m/s", "v": "m/s", "x": "m", "y": "m"}
    table = {f"{k} [{units[k]}]" if k in units else k: v for k, v in (plain(zz20) | {"t": zz20.time * 1e-12}).items()}
    made = propose(export(table), ship)
    said = [*made.reasons.values(), *(c.why for c in made.choices)]
    assert not any("misfit ," in why or re.search(r"\d{6,}%", why) for why in said)
