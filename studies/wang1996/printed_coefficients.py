"""Wang 1996, section 5.3, as printed: Tables 5.1 to 5.3 and eqs 5.1 to 5.3. Positive rudder turns to port."""

from dataclasses import dataclass

RHO = 1000.0
"""Density that turns the second column of the tables into the third [kg/m^3]; it is not stated."""


@dataclass(frozen=True)
class Row:
    """A coefficient in one of the tables.

    Attributes:
        table: Number of the table.
        equation: X, Y or N.
        term: Variables of the derivative; ``0`` for the constant.
        regression: Second column, in SI units.
        prime: Third column.
        clarke: Fourth column; None where it is empty.
        estimated: Fifth column.
        original: Sixth column.
        printed: False if the row stands in the equation only.
    """

    table: str
    equation: str
    term: str
    regression: float
    prime: float
    clarke: float | None
    estimated: float
    original: float
    printed: bool = True


INERTIA = {
    "m - X_udot": ("Table 5.1", "mx", 0.17993, 0.177),
    "m - Y_vdot": ("Table 5.2", "my", 0.364741, 0.327),
    "Y_rdot": ("Table 5.2", "Yrdot", -0.01209, -0.0007704),
    "N_vdot": ("Table 5.3", "Nvdot", -0.00796, 0.00221),
    "I_z - N_rdot": ("Table 5.3", "mz", 0.024085, 0.0175),
}
"""Name -> table, key of a Taylor ship's inertia, Clarke's value, original."""

_SURGE = {
    "u": (782.0, 0.000165623, -0.0253, -0.02513, -0.0253),
    "uu": (18048.2, 0.029104573, None, 0.029105, 0.01896),
    "uuu": (2574.0, 0.03160448, None, 0.031604, -0.01302),
    "vv": (-226472.0, -0.365209325, None, -0.36521, -0.378),
    "dd": (-18208.0, -0.0005065, -0.04008, -0.04059, -0.04),
    "udd": (2862.2, 0.0006062, None, 0.000606, 0.0),
    "vr": (16698306.0, 0.176691147, None, 0.176691, 0.168),
    "vd": (90865.0, 0.019244698, None, 0.019245, 0.0196),
    "0": (-1364.9, -0.000037966, None, -3.8e-5, 0.0),
}
_SWAY = {
    "v": (181042.0, 0.0383, -0.27543, -0.23709, -0.244),
    "vvv": (-2549592.0, -31.304, None, -31.304, -10.212),
    "vdd": (-1851248.0, -0.098020989, None, -0.09802, -0.0016),
    "uv": (-59167.0, -0.00954, None, -0.00954, 0.0),
    "r": (0.0, 0.0, -0.1043, -0.1043, -0.105),
    "vvr": (0.0, 0.0, None, 0.0, 6.46),
    "rdd": (-140688832.0, -0.1955, None, -0.19552, 0.0),
    "ur": (-1419969.0, -0.015025233, None, -0.01503, 0.0),
    "d": (-270453.0, -0.007523, 0.06, 0.052477, 0.0586),
    "ddd": (-5290458.0, -0.1471617, None, -0.14716, -0.0585),
    "vvd": (762876.0, 1.2302, None, 1.2302, -0.5),
    "0": (-30334.0, -0.000843783, None, -0.00084, -0.0008),
}
_YAW = {
    "v": (16850178.0, 0.023417147, -0.10538, -0.08196, -0.0555),
    "vvv": (20248674.0, 1.631, None, 1.631368, 2.07),
    "vdd": (-17542416.0, -0.024379169, None, -0.02438, 0.00528),
    "r": (-1391213568.0, -0.0126864, -0.04602, -0.05871, -0.03747),
    "vvr": (-4781049344.0, -2.52751, None, -2.52751, -2.316),
    "ur": (-102215384.0, -0.00709698, None, -0.0071, 0.0),
    "d": (-50902672.0, -0.00929088, -0.03, -0.03929, -0.0293),
    "ddd": (177863376.0, 0.032464, None, 0.032464, 0.02892),
    "vvd": (58221352.0, 0.6160602341, None, 0.616062, 0.2064),
    "ud": (-1203891.0, -0.001673079, None, -0.00167, 0.0),
    "0": (4127219.0, 0.00075331, None, 0.000753, 0.00059),
}
_EMPTY = {"X": "uvv urr rd uvr uvd urd", "Y": "vrr uuv rrr uur rrd ud uud vrd u uu", "N": "vrr uv uuv rrr rdd uur"}
_EMPTY["N"] += " rrd uud vrd u uu"
_FILLED = {"X": _SURGE, "Y": _SWAY, "N": _YAW}
_NOTHING = (0.0, 0.0, None, 0.0, 0.0)

ROWS = tuple(
    Row(table, equation, term, *values)
    for table, equation in (("Table 5.1", "X"), ("Table 5.2", "Y"), ("Table 5.3", "N"))
    for term, values in {**_FILLED[equation], **dict.fromkeys(_EMPTY[equation].split(), _NOTHING)}.items()
)
"""Every row of the three tables but those of the inertia."""
SURGE_RR = Row("eq 5.1", "X", "rr", 17236738.0, 0.0, None, 0.0, 0.01272, printed=False)
"""The term of eq 5.1 that Table 5.1 lacks."""

SLIPS = {
    ("Y", "vdd"): "slip: the regression value makes -.392, four times what is printed",
    ("Y", "uv"): "slip, a zero too many: the regression value makes -.0954",
}
"""Coefficients whose third column does not follow from the second."""
ORIGINAL_SLIPS = {("Y", "vvd"): "the sign is a slip: Table 3.2 has +.5, which the thesis' own simulations used"}
"""Originals that are printed wrongly."""
