from functools import cache

import numpy as np
import pytest
import torch
from fleet import SHIPS, ship_named, unchecked, without_offsets
from hydra.utils import instantiate
from jaxtyping import config as config_of_checks
from omegaconf import OmegaConf
from shelf import DEEP, FILES, config, draws, kind_of, made, outcome, recorded, situation

from manoeuvre_nn.core.effect import SITES, Effect, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.ship.known import no_part

FAMILIES = {"wind and waves", "current", "depth", "loading", "rudder", "propeller and resistance", "sensors"}
FAMILIES |= {"local force", "heel", "formula", "remainder"}
MOVING = [n for n in FILES if kind_of(n).site != "sensor" and n != "rudder_offset"]
HULL = ["shallow_water", "squat", "displacement_change", "loading", "trim_change"]


@pytest.fixture(autouse=True, scope="module")
def fast():
    with unchecked():
        yield


@cache
def nothing(ship: str) -> dict:
    """What an effect that does nothing says about a situation."""

    class Nothing(Effect):
        name, site, declared = "nothing", "sensor", ()

    return outcome(Nothing(ship_named(ship)), situation(ship))


@pytest.mark.parametrize("name", FILES)
def test_null_values_change_nothing(name):
    for ship in DEEP:
        s = situation(ship)
        effect = made(name, ship)
        effect = effect.at(effect.null())
        memory = effect.memory_at_start(s) if effect.memory else None
        found = outcome(effect, s, memory)
        for key, expected in nothing(ship).items():
            unit = ship_named(ship).acceleration_units if key == "acceleration" else 1.0
            tolerance = 2e-4 if name in {"shallow_water", "squat"} else 1e-12
            if key != "blade" or name != "rudder_slow":  # its null is a rudder that moves as the indicator should
                torch.testing.assert_close(found[key] / unit, expected / unit, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("name", FILES)
def test_a_signed_size_says_in_words_what_its_sign_means(name):
    reported = [p for p in kind_of(name).declared if not p.form and p.unit not in {"-", "1/km"}]
    assert [p.name for p in reported if (p.low < 0) != bool(p.sides)] == []


@pytest.mark.parametrize("name", FILES)
def test_many_rows_of_values_at_once_are_the_same_one_at_a_time(name):
    for ship in DEEP:
        s = situation(ship)
        effect = made(name, ship)
        values = draws(effect, 3)
        together = outcome(effect.at(values), s)
        assert together["acceleration"].shape == (3, 4, 3)
        for row in range(3):
            for key, alone in outcome(effect.at(values[row]), s).items():
                rows = torch.broadcast_to(together[key], (3, *alone.shape))
                torch.testing.assert_close(rows[row], alone, rtol=1e-12, atol=1e-14)


FIELDS = {"nu": None, "nudot": None, "psi": 1.0, "x": 10.0, "y": 10.0, "delta": 1.0, "shaft": 1.0}


def sums(effect: Effect, s: Situation, values: torch.Tensor, *fields: torch.Tensor) -> dict[str, torch.Tensor]:
    """One number of every answer in which no part can hide."""
    results = outcome(effect.at(values), s.with_(**dict(zip(FIELDS, fields, strict=True))))
    results["acceleration"] = results["acceleration"] / effect.ship.acceleration_units
    return {k: (c * (1 + torch.arange(c.shape[-1]))).sum() for k, c in results.items()}


def slopes_agree(effect: Effect, s: Situation, h: float = 1e-6) -> None:
    """Derivatives along one random direction in values and situation."""
    generator, ship = torch.Generator().manual_seed(5), effect.ship
    point = [draws(effect, 2, seed=2), *(getattr(s, f) for f in FIELDS)]
    sizes = [effect.values.new_tensor([p.spread for p in effect.declared])]
    sizes += [ship.velocity_units, ship.acceleration_units, *list(FIELDS.values())[2:]]
    along = [torch.randn(p.shape, generator=generator, dtype=p.dtype) * q for p, q in zip(point, sizes, strict=True)]
    leaves = [p.clone().requires_grad_() for p in point]
    plus, minus = (sums(effect, s, *(p + k * h * d for p, d in zip(point, along, strict=True))) for k in (1, -1))
    for key, result in sums(effect, s, *leaves).items():
        if result.requires_grad:
            grads = torch.autograd.grad(result, leaves, allow_unused=True, retain_graph=True)
            slope = sum((g * d).sum() for g, d in zip(grads, along, strict=True) if g is not None)
            expected, size = (plus[key] - minus[key]) / (2 * h), 1 + float(result.detach().abs())
            torch.testing.assert_close(slope, expected, rtol=2e-5, atol=2e-6 * size, msg=f"{effect.name}: {key}")


@pytest.mark.parametrize("name", FILES)
def test_gradients_are_central_differences(name):
    for ship in DEEP:
        slopes_agree(made(name, ship), situation(ship, seed=3))


@pytest.mark.parametrize("ship", ["great_lakes_bulker", "esso_190k"])
def test_shapes_and_types_are_as_declared(ship):
    config_of_checks.update("jaxtyping_disable", False)
    try:
        for name in FILES:
            effect = made(name, ship, **config(name))
            outcome(effect.at(draws(effect, 3)), situation(ship))
            outcome(effect, situation(ship))
    finally:
        config_of_checks.update("jaxtyping_disable", True)


MIRRORED = {"from_deg": -1, "toward_deg": -1, "along_deg": -1, "angle_deg": -1, "force_kN": -1, "trim_m": 1}
MIRRORED["gust_across"] = -1


def mirrored(name: str, values: torch.Tensor, names: list[str]) -> torch.Tensor:
    """Values of the mirrored effect."""
    one_way = {"tow": {"force_kN"}, "ice_resistance": {"force_kN"}, "rudder_stall": {"angle_deg"}}.get(name, set())
    signs = [MIRRORED.get(n, 1) if n not in one_way else 1 for n in names]
    if name == "remainder":  # what goes in or comes out across the ship
        signs = [-1 if n[0] in "YN" or n.endswith(("_v", "_r", "_delta", "sin_psi")) else 1 for n in names]
    return values * values.new_tensor(signs)


@pytest.mark.parametrize("name", MOVING)
def test_the_mirrored_situation_has_the_mirrored_effect(name):
    for ship in DEEP:
        ship = without_offsets(ship_named(ship))
        s, flip, odd = situation(ship), torch.tensor([1.0, -1.0, -1.0]), torch.tensor([1.0, -1.0])
        other = Situation(s.nu * flip, s.nudot * flip, s.x, -s.y, -s.psi, -s.delta, s.shaft, s.time)
        sides = [{"side": side} if name == "bank" else {} for side in ("starboard", "port")]
        effect, turned = (made(name, ship, **side) for side in sides)
        values = draws(effect, 1)[0]
        changed = turned.at(mirrored(name, values, [p.name for p in effect.declared]))
        effect = effect.at(values)
        sign = -1.0 if name == "roll_coupling" else 1.0
        memory = 0.1 * torch.ones(4, effect.memory, dtype=torch.float64)
        torch.testing.assert_close(
            changed.acceleration(other, sign * memory), effect.acceleration(s, memory) * flip, rtol=1e-9, atol=1e-15
        )
        torch.testing.assert_close(changed.stream(other), effect.stream(s) * odd, rtol=1e-9, atol=1e-12)
        angles = [torch.full((4,), a, dtype=torch.float64) for a in (0.1, 0.3, 0.25)]
        blade = effect.blade(*angles, torch.ones(4, dtype=torch.float64))
        torch.testing.assert_close(changed.blade(*(-a for a in angles), torch.ones(4, dtype=torch.float64)), -blade)


@pytest.mark.parametrize("name", FILES)
def test_every_config_builds_its_class_on_every_ship(name):
    text = FILES[name].read_text()
    assert text.startswith(f"# @package effect.{name}\n")
    for ship in DEEP:
        effect = instantiate(OmegaConf.create(text), ship=ship_named(ship))
        assert effect.name == name
        blank = {p.name: p.starts[0] for p in effect.declared} if name == "remainder" else {}
        given = [float((blank | config(name))[p.name]) for p in effect.declared]
        assert effect.values.tolist() == given
        assert all(config(name)[p.name] == p.null for p in effect.declared if p.form)


@pytest.mark.parametrize("name", FILES)
def test_every_effect_says_what_it_is(name):
    kind = kind_of(name)
    assert kind.site in SITES and kind.family in FAMILIES and kind.equations
    assert all(len(text) > 5 for text in (kind.fingerprint, kind.source, kind.label)) and kind.fingerprint[-1] == "."
    assert len({p.name for p in kind.declared}) == len(kind.declared)


@pytest.mark.parametrize("name", FILES)
def test_starts_lie_within_bounds_and_form_parameters_start_at_their_null(name):
    for ship in DEEP:
        for p in made(name, ship).declared:
            assert all(p.low <= t <= p.high or (p.per_run and t == np.inf) for t in p.starts) and p.spread > 0
            assert p.null is None or p.low <= p.null <= p.high
            assert not p.form or p.starts[0] == p.null
            assert (p.period is None) == (p.unit != "deg" or p.name not in MIRRORED or name == "rudder_stall")


@pytest.mark.parametrize("name", FILES)
def test_values_out_of_bounds_and_unknown_parameters_are_refused(name):
    ship = ship_named("mariner")
    for p in made(name, ship).declared:
        for wrong in (p.low - 1.0, p.high + 1.0):
            with pytest.raises(InputError, match=f"effect.{name}.{p.name}=.*expected"):
                kind_of(name)(ship, **{p.name: wrong})
    with pytest.raises(InputError, match="unknown parameter"):
        kind_of(name)(ship, weather=1.0)


def test_a_force_without_a_formula_is_refused():
    class Nothing(Effect):
        name, site, declared = "nothing", "force", ()

    with pytest.raises(InputError, match="effect.nothing acts as a force and says none"):
        Nothing(ship_named("mariner"))


@pytest.mark.parametrize("name", HULL)
def test_a_ship_without_coefficients_has_no_hull_to_change(name):
    with pytest.raises(InputError, match="no coefficients"):
        kind_of(name)(no_part(ship_named("mariner")))


@pytest.mark.parametrize("name", HULL)
def test_a_hull_effect_goes_along_with_the_ship_to_another_speed(name):
    ship = ship_named("mariner")
    slow = ship.on_approach(4.0)
    moved, s = made(name, ship), situation(slow)
    moved = moved.at(moved.values)
    moved._ship = [slow]
    fresh, memory = made(name, slow), s.nu.new_zeros(4, 0)
    torch.testing.assert_close(moved.acceleration(s, memory), fresh.acceleration(s, memory))


@pytest.mark.parametrize("name", [n for n in FILES if kind_of(n).site == "sensor"])
def test_a_sensor_effect_keeps_all_channels_and_adds_none(name):
    s = situation("mariner")
    channels = recorded(s)
    assert list(made(name, "mariner").record(channels, s)) == list(channels)
    assert list(made(name, "mariner").record({"psi": s.psi}, s)) == ["psi"]


def test_all_ships_are_covered():
    assert set(DEEP) == {name for name in SHIPS if "shallow" not in name} and len(FILES) > 35
