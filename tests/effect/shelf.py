"""Every effect as its config names it, and situations in which ships can be."""

import importlib
from functools import cache
from pathlib import Path

import torch
import yaml
from fleet import SHIPS, ship_named

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.ship import Ship

FILES = {path.stem: path for path in sorted((Path(__file__).parents[2] / "conf" / "effect").glob("*.yaml"))}
DEEP = [name for name in SHIPS if "shallow" not in name]
CHANNELS = ("x", "y", "vn", "ve", "psi", "r", "u_log", "delta", "shaft_recorded")


@cache
def config(name: str) -> dict:
    """What the config of an effect says, without its target."""
    return {k: v for k, v in yaml.safe_load(FILES[name].read_text()).items() if k != "_target_"}


@cache
def kind_of(name: str) -> type[Effect]:
    """The class that the config of an effect names."""
    module, _, member = yaml.safe_load(FILES[name].read_text())["_target_"].rpartition(".")
    return getattr(importlib.import_module(module), member)


def made(name: str, ship: Ship | str, **values) -> Effect:
    """An effect on a ship."""
    return kind_of(name)(ship_named(ship) if isinstance(ship, str) else ship, **values)


def situation(ship: Ship | str, n: int = 4, seed: int = 0, slow: float = 0.6) -> Situation:
    """Different turns to both sides, rudder over, on all headings, with the accelerations of the ship."""
    ship = ship_named(ship) if isinstance(ship, str) else ship
    g = torch.Generator().manual_seed(seed)

    def draw(size: float, middle: float = 0.0):
        return middle + size * (2 * torch.rand(n, generator=g, dtype=torch.float64) - 1)

    speed, length = ship.particulars.speed, ship.particulars.length
    u, v, r = speed * draw(0.3, slow), speed * draw(0.2), speed / length * draw(0.5)
    nu, delta = torch.stack([u, v, r], dim=-1), draw(0.4)
    time = 3.7 + torch.arange(n, dtype=torch.float64)
    return Situation(
        nu, ship.acceleration(nu, delta), draw(60.0), draw(60.0), draw(3.0), delta, 1 + 0 * draw(1.0), time
    )


def at(ship: Ship | str, u: float, v: float = 0.0, r: float = 0.0, **more: float) -> Situation:
    """One situation, all else zero and the shaft at its nominal speed."""
    ship = ship_named(ship) if isinstance(ship, str) else ship
    given = dict.fromkeys(("x", "y", "psi", "delta", "time"), 0.0) | {"shaft": 1.0} | more
    nu = torch.tensor([[u, v, r]], dtype=torch.float64)
    rest = {k: torch.tensor([c], dtype=torch.float64) for k, c in given.items()}
    return Situation(nu=nu, nudot=ship.acceleration(nu, rest["delta"]), **rest)


def draws(effect: Effect, rows: int, seed: int = 0):
    """Values inside the bounds, away from their ends; intervals that begin and end among the situations' times."""
    g = torch.Generator().manual_seed(seed)
    times = {"start_s": (3.0, 6.0), "end_s": (5.0, 8.0)}
    bounds = [times.get(p.name, (p.low, p.high)) for p in effect.declared]
    low, high = torch.tensor(bounds, dtype=torch.float64).unbind(-1)
    return low + (high - low) * (0.2 + 0.6 * torch.rand(rows, 1, len(low), generator=g, dtype=torch.float64))


def recorded(s: Situation) -> dict[str, torch.Tensor]:
    """What perfect sensors write without current."""
    cos, sin = torch.cos(s.psi), torch.sin(s.psi)
    values = (s.x, s.y, s.u * cos - s.v * sin, s.u * sin + s.v * cos, s.psi, s.r, s.u, s.delta, s.shaft)
    return dict(zip(CHANNELS, values, strict=True))


def outcome(effect: Effect, s: Situation, memory: torch.Tensor | None = None) -> dict[str, torch.Tensor]:
    """Everything that an effect says about a situation, rows of values in front."""
    batch = torch.broadcast_shapes(s.psi.shape, effect.values.shape[:-1])
    memory = s.nu.new_full((*batch, effect.memory), 0.9) if memory is None else memory
    angles = (0.8 * s.delta, s.delta, 0.9 * s.delta, 0 * s.time + 0.7)
    said = {"stream": effect.stream(s), "blade": effect.blade(*(a.expand(batch) for a in angles))}
    said |= {k: c.expand(batch) for k, c in effect.record(recorded(s), s).items()}
    # The base class answers in the shape of the situation.
    fields = {f: getattr(s, f) for f in s.__dataclass_fields__ if getattr(s, f) is not None}
    wide = Situation(**{f: c.expand(*batch, *c.shape[1:]) for f, c in fields.items()})

    def ask(method: str) -> torch.Tensor:
        own = getattr(type(effect), method) is not getattr(Effect, method)
        return getattr(effect, method)(s if own else wide, memory)

    said |= {"acceleration": ask("acceleration")}
    return said | ({m: ask(m) for m in ("shaft", "memory_rate")} if effect.memory else {})
