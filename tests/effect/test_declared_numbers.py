"""What effects declare, against a table: the results of docs/results.md were measured with these priors and bounds.

Whoever changes a number changes the diagnosis: measure anew, then write the table with
``PYTHONPATH=tests python tests/effect/test_declared_numbers.py``. Bounds are what is possible at sea; the median of a
Cauchy prior, .67 of its spread, lies in the range that is usual (offsets .5 to 3 deg, play .2 to 2 deg, delays .5 to
5 s, a compass .2 to 2 deg, fouling 10 to 80 %, ramps 40 s); form parameters spread as the published curves do.
"""

from pathlib import Path

from fleet import unchecked
from pytest import approx
from shelf import FILES, kind_of, made, outcome, situation

from manoeuvre_nn.core.effect import UNIT_POWERS, Effect, Parameter

TABLE = Path(__file__).with_name("declared.txt")
LEARNT = ("formula", "remainder")
"""Their parameters are weights."""


def numbers(p: Parameter) -> str:
    """One parameter in a line."""
    null = "none" if p.null is None else f"{p.null:g}"
    starts = " ".join(f"{s:g}" for s in p.starts)
    flags = {
        "form": p.form,
        "per_run": p.per_run,
        "random": p.random,
        "gaussian": not p.heavy_tailed,
        "vector": p.vector,
    }
    flags |= {f"of {p.within}": bool(p.within), f"period {p.period}": bool(p.period), f"power {p.power}": bool(p.power)}
    words = " ".join([*(name for name, is_so in flags.items() if is_so), "/".join(p.sides)]).strip()
    return f"{p.name} [{p.unit}] {p.low:g} to {p.high:g}, null {null}, spread {p.spread:g}, from {starts} {words}"


def kinds(effect: type[Effect]) -> str:
    """What else an effect says of itself."""
    flags = ("candidate", "fittable", "acts_indoors")
    said = [effect.site, effect.family, *(flag for flag in flags if getattr(effect, flag))]
    more = {"exclusive": effect.exclusive, "variant of": effect.variant_of, "measured by": effect.measured_by}
    said += [f"{what} {word}" for what, word in more.items() if word]
    return "; ".join([*said, f"memory {effect.memory}", " ".join(effect.equations)])


def declared() -> list[str]:
    """What is declared, every line with the effects that it holds for."""
    lines: dict[str, list[str]] = {}
    for name in FILES:
        lines.setdefault(kinds(kind_of(name)), []).append(name)
        for p in () if name in LEARNT else kind_of(name).declared:
            lines.setdefault(numbers(p).rstrip(), []).append(name)
    return sorted(f"{' '.join(names)}: {line}" for line, names in lines.items())


def test_effects_declare_the_numbers_that_results_were_measured_with():
    """And are finite where a fit begins."""
    assert declared() == TABLE.read_text().splitlines()
    with unchecked():
        for name in FILES:
            said = outcome(made(name, "mariner"), situation("mariner"))
            assert all(bool(value.isfinite().all()) for value in said.values()), name


def test_sizes_go_with_length_by_froudes_law_and_what_is_on_board_with_the_ship():
    """A model of 3 m: lengths by 3/160, speeds and times by its root, forces by its cube; instruments stay."""
    assert UNIT_POWERS == {"m": 1.0, "m/s": 0.5, "kN": 3.0}
    share, model = 3.0 / 160.0, made("current", "mariner").ship.particulars
    small = type(model)("model", 3.0, 0.5, 0.2, 0.8, 0.4, 0.5, 0.6)
    by = {p.name: p.on(small) for n in ("side_force", "current", "first_order_waves", "gps_lever_arm", "rate_bias")
          for p in kind_of(n).declared}  # fmt: skip
    assert by["speed"].spread == approx(0.6 * share**0.5)
    assert by["speed"].starts == approx((0.5 * share**0.5, 2.5 * share**0.5))
    assert (by["Hs"].spread, by["period_s"].spread) == approx((2.5 * share, 4.0 * share**0.5))
    assert by["force_kN"].spread == approx(250 * share**3) and by["bias_deg_s"].spread == 0.05
    assert (by["dx_m"].low, by["dx_m"].high, by["dy_m"].high) == approx((-1.8, 1.8, 0.3))
    assert by["start_2_s"].starts == (float("inf"),) and by["period_s"].starts == (4.0,), "starts stay within bounds"
    assert (by["lever_m"].spread, by["dy_m"].spread) == approx((0.9, 0.15)) and by["lever_m"].starts == approx((
        0.0, 0.45, -0.45, 0.9, -0.9,
    ))  # fmt: skip
    trims = [made("trim_change", ship) for ship in ("mariner", "esso_190k")]
    of_draught = [t.declared[0].spread / t.ship.particulars.draught for t in trims]
    assert of_draught == approx([0.2, 0.2]), "1.5 m of a cargo ship, 3.7 m of a tanker"


def test_a_slow_rudder_is_measured_by_the_ships_own_gear():
    (rate,) = made("rudder_slow", "esso_190k").declared
    assert (rate.low, rate.high, rate.null, rate.spread) == approx((0.0233, 2.33, 2.33, 0.6 * 2.33))
    assert rate.starts == approx((0.5 * 2.33, 0.2 * 2.33, 0.08 * 2.33))


def test_a_depth_is_tried_from_under_the_keel_to_deep_water():
    depth, *_ = made("squat", "esso_190k").declared
    shares = [value / 18.46 for value in (depth.low, depth.high, depth.spread, *depth.starts)]
    assert shares == approx([1.03, 50.0, 1.0, 1.2, 1.5, 2.5, 5.0])
    effect = made("shallow_water", "esso_190k")
    assert float(effect.null()[0]) == approx(1000 * 18.46), "deep water"


if __name__ == "__main__":
    TABLE.write_text("\n".join(declared()) + "\n")
