"""Formulas without a name: every term means what its words say; the remainder is the network that it is called."""

import re
from math import cos, pi, radians, sin, sqrt, tanh

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from shelf import at, recorded

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.effect.formula import Formula, in_time, is_ordinary, library, mark_of, places_of
from manoeuvre_nn.effect.remainder import HIDDEN, INPUTS, Remainder

SHIP = "great_lakes_bulker"
P = ship_named(SHIP).particulars
STATE = dict(u=4.3, v=-0.61, r=0.0117, psi=2.3, delta=0.27, x=730.0, y=-410.0, time=431.0)
NEEDED = dict(memory_s=45.0, period_s=37.0, north_per_km=1.7, east_per_km=-0.6)
"""Scales that terms in time share."""
TIGHT = {
    "u": (STATE["u"] / P.speed - 1) / 0.3,
    "v": STATE["v"] / P.speed / 0.25,
    "r": STATE["r"] * P.length / P.speed / 0.7,
    "d": STATE["delta"] / 0.35,
}
"""The motion in units of a tight turn."""
WAVES = {"periodic": 431.0 / 37.0, "periodic_by_run": 431.0 / 37.0, "stripes": (730.0 * 1.7 + 410.0 * 0.6) / 1000}
"""Turns of what comes again."""


def value_of(shape: str) -> float:
    """A shape by its letters: ``r|r| cos 2psi``, ``|v||r|``, ``u v``, ``r t``, ``sin periodic``; memory holds .4."""
    words, total = shape.split(" "), 1.0
    if "lag" in words:
        return 0.4
    if words[-1] in WAVES:
        return (cos if words[0] == "cos" else sin)(2 * pi * WAVES[words[-1]])
    while words:
        word = words.pop(0)
        if word in ("cos", "sin"):
            angle = words.pop(0).removesuffix("psi") or "1"
            total *= (cos if word == "cos" else sin)(float(angle) * STATE["psi"])
        elif word == "t":
            total *= 431.0 / 600.0
        elif word != "1":
            for size, letter, power in re.findall(r"\|([uvrd])\||([uvrd])(?:\^(\d))?", word):
                total *= abs(TIGHT[size]) if size else TIGHT[letter] ** int(power or 1)
    return total


def formula(*terms: str, **values: float) -> Formula:
    scales = {p: NEEDED[p] for p in NEEDED}
    made = Formula(ship_named(SHIP), terms, scales=scales)
    started = {p.name: p.starts[0] for p in made.declared if p.name in NEEDED}
    return Formula(ship_named(SHIP), terms, scales=scales, **started, **values)


FORCES = [term for term in library() if term[0] in "XYN" and term[1] == " "]


def test_every_force_of_the_library_is_the_product_that_its_words_name():
    s, size = at(SHIP, **STATE), typical(ship_named(SHIP)).tolist()
    with unchecked():
        for term in FORCES:
            equation, shape = term.split(" ", maxsplit=1)
            effect = formula(term, w1=0.7)
            memory = torch.full((1, effect.memory), 0.4, dtype=torch.float64)
            expected = [0.7 * size[k] * value_of(shape) * (e == equation) for k, e in enumerate("XYN")]
            assert effect.acceleration(s, memory)[0].tolist() == approx(expected, rel=1e-9, abs=1e-18), term
            assert effect.unit_of(term, s, memory)[0][0].tolist() == approx([e / 0.7 for e in expected]), term


def test_the_library_holds_each_term_once_and_in_its_place():
    terms = library()
    assert (len(terms), len(set(terms)), len(FORCES)) == (210, 210, 180)
    assert {places_of(t) for t in FORCES} == {("X",), ("Y",), ("N",)}
    assert places_of("rudder to port") == ("actuator:rudder",) and places_of("sensor u_log |v|") == ("sensor:u_log",)
    assert places_of("sensor north t^2") == places_of("sensor east t^2") == ("sensor:x", "sensor:y")
    marks = {term: mark_of(term) for term in in_time()}
    assert marks["N lag r"] == "lag" and marks["Y sin stripes"] == "stripes" and marks["X t"] == "t"
    assert (
        marks["N r t"] == "t" and mark_of("sensor r t") == "" == mark_of("N r") and set(marks.values()) > {"periodic"}
    )


def mirrored(shape: str) -> int:
    """Sign that a shape takes in the mirrored motion."""
    letters = shape.replace("|v||r|", "").replace("|v|", "").replace("|r|", "").replace("|d|", "").replace("r^2", "")
    return (-1) ** sum(letters.count(c) for c in "vrd")


def test_ordinary_terms_are_those_that_a_ship_alike_to_both_sides_has():
    for term in FORCES:
        equation, shape = term.split(" ", maxsplit=1)
        plain = not {"psi", "lag", "periodic", "periodic_by_run", "stripes", "t"} & set(
            shape.replace("2psi", "psi").replace("3psi", "psi").split()
        )
        assert is_ordinary(term) == (plain and mirrored(shape) == (1 if equation == "X" else -1)), term
    assert not any(is_ordinary(t) for t in library() if t not in FORCES)


def test_a_motion_that_is_followed_late_is_a_first_order_lag_of_it():
    effect, s = formula("N lag r", "Y r", "X lag |v|"), at(SHIP, **STATE)
    wanted = [TIGHT["r"], abs(TIGHT["v"])]
    assert effect.memory == 2 and effect.memory_at_start(s)[0].tolist() == approx(wanted)
    rate = effect.memory_rate(s, torch.tensor([[0.1, 0.2]], dtype=torch.float64))[0].tolist()
    assert rate == approx([(wanted[0] - 0.1) / 45.0, (wanted[1] - 0.2) / 45.0])
    memory = torch.tensor([[0.1, 0.2]], dtype=torch.float64)
    size = typical(ship_named(SHIP)).tolist()
    weights = effect.at(torch.cat([torch.tensor([2.0, 0.0, 3.0]).double(), effect.values[3:]]))
    assert weights.acceleration(s, memory)[0].tolist() == approx([3.0 * 0.2 * size[0], 0.0, 2.0 * 0.1 * size[2]])
    with pytest.raises(ValueError, match="its memory is needed"):
        effect.unit_of("N lag r", s)


RUDDERS = {
    "rudder to starboard": lambda d: max(d, 0.0), "rudder to port": lambda d: min(d, 0.0),
    **{f"rudder at {m} deg": lambda d, m=m: d * max(0.0, 1 - abs(abs(d) - m) / 5) for m in (6, 11, 16, 21, 28)},
}  # fmt: skip


@pytest.mark.parametrize("term", RUDDERS)
@pytest.mark.parametrize("deg", [8.3, -8.3, 13.1, -18.6, 25.2])
def test_a_strange_rudder_acts_as_if_it_stood_further_over(term, deg):
    ship = ship_named(SHIP)
    s = at(SHIP, **{**STATE, "delta": radians(deg)})
    felt = torch.tensor([radians(deg + 0.3 * RUDDERS[term](deg))], dtype=torch.float64)
    change = ship.acceleration(s.nu, felt) - ship.acceleration(s.nu, s.delta)
    found = formula(term, w1=0.3).acceleration(s, torch.zeros(1, 0).double())
    torch.testing.assert_close(found, change, rtol=1e-9, atol=1e-15)
    small, _ = formula(term).unit_of(term, s)
    torch.testing.assert_close(small * 1e-3, formula(term, w1=1e-3).acceleration(s, torch.zeros(1, 0).double()))


LATE = 431.0 / 600.0
SIZES = {"psi": radians(5.0), "r": 0.1 * P.speed / P.length, "u_log": 0.1 * P.speed}


@pytest.mark.parametrize("term", [t for t in library() if t.startswith("sensor")])
def test_errors_of_instruments_have_the_sizes_and_shapes_that_are_stated(term):
    _, channel, shape = term.split(" ", maxsplit=2)
    s = at(SHIP, **STATE)
    true = recorded(s)
    added = {k: float(c - true[k]) for k, c in formula(term, w1=0.5).record(true, s).items()}
    if channel in ("north", "east"):
        drift = 0.1 * P.length * LATE**2  # half of a fifth of a length in ten minutes
        place, rate = ("x", "vn") if channel == "north" else ("y", "ve")
        expected = {place: drift, rate: 2 * drift / 431.0}
    else:
        value = LATE ** int(shape[2:] or 1) if shape in ("t", "t^2") else value_of(shape)
        value *= STATE["u"] / P.speed if channel == "u_log" and "psi" in shape else 1.0  # a share of the speed
        expected = {channel: 0.5 * SIZES[channel] * value}
    assert {k: v for k, v in added.items() if abs(v) > 1e-12} == approx(expected)
    force, errors = formula(term).unit_of(term, s)
    assert float(force.abs().max()) == 0.0
    assert {k: float(c) for k, c in errors.items()} == approx({k: v / 0.5 for k, v in expected.items()})


def test_weights_and_scales_start_where_they_are_told():
    effect = Formula(ship_named(SHIP), ("N r", "N sin periodic", "Y cos stripes"), (0.2, 0.3, 0.4), {"period_s": 80.0})
    said = {p.name: (p.low, p.high, p.null, p.spread, p.starts[0], p.heavy_tailed) for p in effect.declared}
    assert said["w1"] == (-100.0, 100.0, 0.0, 0.2, approx(0.02), False) and said["w3"][3] == 0.4
    assert said["period_s"] == (4.0, 6000.0, None, approx(0.4), 80.0, True)
    assert said["north_per_km"][:5] == (-20.0, 20.0, None, 0.5, 1.0) and said["east_per_km"][4] == 0.0
    lag = Formula(ship_named(SHIP), ("N lag v",)).declared
    assert [(p.name, p.low, p.high, p.spread, p.starts) for p in lag] == [
        ("w1", -100.0, 100.0, 0.3, (approx(0.03),)), ("memory_s", 1.0, 3000.0, 15.0, (30.0,)),
    ]  # fmt: skip
    with pytest.raises(InputError, match="'N q' is unknown"):
        Formula(ship_named(SHIP), ("N q",))


def test_the_remainder_is_a_perceptron_of_the_motion_and_the_heading():
    generator = np.random.default_rng(4)
    into, out = generator.normal(0, 1, (HIDDEN, len(INPUTS) + 1)), generator.normal(0, 0.5, (3, HIDDEN))
    values = torch.tensor([*into.ravel(), *out.ravel()], dtype=torch.float64)
    z = [*TIGHT.values(), cos(STATE["psi"]), sin(STATE["psi"]), 1.0]
    nodes = [tanh(sum(w * x for w, x in zip(row, z, strict=True))) for row in into]
    expected = [a * float(row @ nodes) for a, row in zip(typical(ship_named(SHIP)).tolist(), out, strict=True)]
    effect = Remainder(ship_named(SHIP))
    found = effect.at(values).acceleration(at(SHIP, **STATE), torch.zeros(1, 0).double())[0].tolist()
    assert found == approx(expected)
    names = [p.name for p in effect.declared]
    assert names[: len(INPUTS) + 1] == [f"w0_{i}" for i in (*INPUTS, "bias")] and names[-1] == f"N{HIDDEN - 1}"
    hidden, weights = effect.declared[:35], effect.declared[35:]
    assert {(p.low, p.high, p.null, p.spread) for p in hidden} == {(-8.0, 8.0, None, 1.0)}
    assert {(p.low, p.high, p.null, p.spread) for p in weights} == {(-3.0, 3.0, 0.0, 0.1 / sqrt(5))}
    starts = [p.starts[0] for p in hidden]
    assert len(set(starts)) == 35 and 0.7 < np.std(starts) < 1.3 and not any(p.heavy_tailed for p in effect.declared)
