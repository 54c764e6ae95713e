"""A network that knows how ships are built: symmetric sides, a hull that does not see the rudder, forces that scale."""

import copy
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Factor, Weight, as_seed
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.numerics.semilinear import SemiLinear

SpeedLaw = Literal["approach", "shaft"]
Library = Literal["none", "linear", "quadratic"]

OUTPUTS, EVEN = 3, (1.0, -1.0, -1.0)
"""Surge does not change when the ship is mirrored; sway and yaw change sign."""
MIN_SPEED_PRIME = 0.05
"""Forward speed over U0 below which ratios to it are taken as there: far outside of every manoeuvre [-]."""


@dataclass(frozen=True)
class HullRudderSettings:
    """Size of a :class:`HullRudder`, and what it knows of ships.

    Attributes:
        hidden: Nodes of a member.
        members: Members.
        symmetric: Whether port and starboard are alike but for the library.
        modular: Whether hull nodes do not see the rudder.
        speed_law: ``approach`` or ``shaft``.
        library: ``none``, ``linear`` or ``quadratic``.
        spread: Standard deviation of the first weights [-].
        shrink: Ridge on the nodes' linear weights in a fit over the size of a column of ones [-]: where the library is
            the better guess, the nodes should only say what it cannot.
    """

    hidden: int = 12
    members: int = 16
    symmetric: bool = True
    modular: bool = True
    speed_law: SpeedLaw = "approach"
    library: Library = "linear"
    spread: Factor = 0.3
    shrink: Weight = 0.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense.

        Raises:
            InputError: If a setting is unknown or out of its range.
        """
        check_choice("network.speed_law", self.speed_law, ["approach", "shaft"])
        check_choice("network.library", self.library, ["none", "linear", "quadratic"])
        if self.hidden < 2 or self.members < 1:
            given = f"network.hidden={self.hidden}, network.members={self.members}"
            raise InputError(f"{given}: expected at least 2 nodes, 1 member")
        if not self.spread > 0:
            raise InputError(f"network.spread={self.spread}: expected a standard deviation, more than 0")
        if not self.shrink >= 0:
            raise InputError(f"network.shrink={self.shrink}: expected a ridge, 0 or more")


class HullRudder(Network):
    """Members that learn the same forces from different first weights; together they answer with their median.

    Output o of a member is, with nodes ``f_h(z) = tanh(w_h z + w_h0)`` and z~ the inputs of the mirrored ship,

        ``y_o = sum_hj c_ohj b_j(u, n) [f_h(z) + s_o f_h(z~)] + sum_e d_oe t_e``.

    - ``symmetric``: s = (1, -1, -1); what a propeller or an odd hull adds to sway and yaw is left to the t_e, which
      then hold ``b_j``, or 1, u', u'^2, in every output. Else s = 0 and t = 1, or ``b_j``.
    - ``modular``: every second node is a hull node, which does not see the rudder.
    - ``speed_law``: ``approach`` sees u', v', r', delta, and ``b = 1``. ``shaft`` sees v/u, rL/u, delta, and lets
      forces be quadratic in speeds, ``b = (u^2, u n, n^2)``; hull nodes have u^2 alone. It carries to other speeds and
      shaft speeds as far as Reynolds and Froude numbers do not count; a source that makes its forces non-dimensional by
      a constant U0 breaks this law.
    - ``library``: ``linear`` adds v, r and delta, times b, to the t_e of sway and yaw, ``quadratic`` also the cross
      flow's ``|v| v, |v| r, |r| v, |r| r`` (times u^2 where v and r are ratios to u).

    The outputs are linear in c and d, which a fit may therefore solve exactly.

    Attributes:
        input_weights: w, bias last, shape (members, nodes, inputs + 1); what a node does not see is 0.
        output_weights: c and then d, shape (members, 3, columns).
        trained: Members that have been trained; the others do not answer. Before any has, all do.
        shaft: n over that of the training [-].

    Source:
        Parity: Abkowitz 1964. Forces quadratic in speed, with n: Norrbin 1970; MMG: Yasukawa & Yoshimura 2015, eqs 8-29
        (hull and rudder apart). Means of networks: Breiman 1996; a median ignores a member gone astray.
    """

    any_fit = False
    trained: Tensor
    shaft: Tensor
    sees: Tensor
    node: Tensor
    factor: Tensor

    def __init__(
        self, settings: HullRudderSettings | None = None, *, seed: int = 0, dtype: torch.dtype = torch.float64
    ) -> None:
        """Draw the first weights.

        Args:
            settings: Its size and what it knows; None is the usual.
            seed: Seed of the first weights; member k of any ensemble of this seed starts alike.
            dtype: Floating type.
        """
        super().__init__()
        s = settings or HullRudderSettings()
        hidden, speed_law = s.hidden, s.speed_law
        self.symmetric, self.speed_law, self.library, self.shrink = s.symmetric, speed_law, s.library, s.shrink
        self._spread, self._seed = s.spread, seed
        inputs = 4 if speed_law == "approach" else 3
        sees = torch.ones(hidden, inputs + 1, dtype=torch.bool)
        hull = torch.arange(hidden) % 2 == 0 if s.modular else torch.zeros(hidden, dtype=torch.bool)
        sees[hull, inputs - 1] = False
        pairs = [(h, j) for h in range(hidden) for j in range(1 if speed_law == "approach" or hull[h] else 3)]
        self.register_buffer("sees", sees)
        self.register_buffer("node", torch.tensor([h for h, _ in pairs]))
        self.register_buffer("factor", torch.tensor([j for _, j in pairs]))
        self.register_buffer("trained", torch.tensor(0))
        self.register_buffer("shaft", torch.ones((), dtype=dtype))
        self.input_weights = nn.Parameter(torch.stack([self.drawn(k, dtype=dtype) for k in range(s.members)]))
        columns = len(pairs) + self._library(torch.ones(1, 4, dtype=dtype)).shape[1]
        self.output_weights = nn.Parameter(torch.zeros(s.members, OUTPUTS, columns, dtype=dtype))

    @property
    def members(self) -> int:
        """Members, trained or not."""
        return self.input_weights.shape[0]

    @property
    def scalings(self) -> tuple[str, ...]:
        """Scalings of the inputs that keep the mirrored ship a mirrored ship and ratios of speeds ratios."""
        return ("mirrored",) if self.speed_law == "approach" else ("speed",)

    def drawn(self, member: int, trial: int = 0, dtype: torch.dtype | None = None) -> Float[Tensor, "h w"]:
        """First weights of a member at a start of some number; 0 where a node does not see."""
        seed = as_seed((self._seed * 1_009 + trial) * 1_000_003 + member)
        generator = torch.Generator().manual_seed(seed)
        drawn = self._spread * torch.randn(self.sees.shape, generator=generator, dtype=torch.float64)
        return torch.where(self.sees.cpu(), drawn, 0.0).to(dtype or self.input_weights.dtype).to(self.sees.device)

    def least_squares(self, x: Float[Tensor, "n 4"], y: Float[Tensor, "n 3"]) -> SemiLinear:
        """The fit of a member to scaled forces: its outputs are linear in all but the weights of its nodes."""
        columns = self._factors(x), self.node, self.factor, self._library(x)
        return SemiLinear(y, self._features(x), self.sees, self._mirror(x), self._parity(x), *columns, self.shrink)

    def columns(self, x: Float[Tensor, "n 4"], member: int) -> list[Float[Tensor, "c n"]]:
        """What a member's weights c and d are multiplied by, output by output."""
        z, mirror = self._features(x), self._mirror(x)
        z, mirror = torch.cat([z, torch.ones_like(z[:, :1])], 1), torch.cat([mirror, mirror.new_ones(1)])
        weights, factors = self.input_weights[member].T, self._factors(x)[self.factor]
        columns = []
        for sign, library in zip(self._parity(x), self._library(x), strict=True):
            nodes = (z @ weights).tanh() + sign * (z * mirror @ weights).tanh()
            columns.append(torch.cat([nodes.T[self.node] * factors, library]))
        return columns

    def forward(self, x: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
        """Median of the trained members."""
        flat = x.reshape(-1, 4)
        y = self.each(flat.expand(self.members, -1, -1), int(self.trained))
        # torch.median of an even number would be the lower of the two in the middle.
        return y.quantile(0.5, dim=0).reshape(*x.shape[:-1], OUTPUTS)

    def each(self, x: Float[Tensor, "m n 4"], first: int = 0) -> Float[Tensor, "k n 3"]:
        """Every member, or the first few, on scaled inputs of its own."""
        count = first or self.members
        return self._answers(x[:count], self.input_weights[:count], self.output_weights[:count])

    def of(self, x: Float[Tensor, "n 4"], member: Int[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        """Every input by a member of its own."""
        return self._answers(x[:, None], self.input_weights[member], self.output_weights[member])[:, 0]

    def _answers(
        self, x: Float[Tensor, "k n 4"], first: Float[Tensor, "k h w"], last: Float[Tensor, "k o c"]
    ) -> Float[Tensor, "k n 3"]:
        """Forces by a set of weights for every row of inputs."""
        flat = x.reshape(-1, 4)
        z = self._features(flat).view(*x.shape[:2], -1)
        nodes = _nodes(z, first)
        mirrored = _nodes(z * self._mirror(x), first) if self.symmetric else None
        factors = self._factors(flat).view(-1, *x.shape[:2])
        library = self._library(flat).view(OUTPUTS, -1, *x.shape[:2])
        outputs = []
        for o, sign in enumerate(EVEN):
            c, t = last[:, o].split([len(self.node), library.shape[1]], 1)
            columns = nodes if mirrored is None else nodes + sign * mirrored
            total = torch.einsum("ke,ekn->kn", t, library[o])
            for j in range(len(factors)):
                own = self.factor == j
                share = c.new_zeros(len(c), nodes.shape[-1]).index_add(1, self.node[own], c[:, own])
                total = total + factors[j] * (columns @ share[..., None])[..., 0]
            outputs.append(total)
        return torch.stack(outputs, -1)

    def at_shaft(self, ratio: float) -> Network:
        """Forces that scale with the approach speed know no shaft."""
        return self if self.speed_law == "approach" else super().at_shaft(ratio)

    def with_weights(
        self, input_weights: Float[Tensor, "k h w"], output_weights: Float[Tensor, "k 3 c"]
    ) -> "HullRudder":
        """A network of the same kind with other members, all of which answer."""
        other = copy.copy(self)
        weights = {"input_weights": input_weights, "output_weights": output_weights}
        other._parameters = {name: nn.Parameter(values.detach().clone()) for name, values in weights.items()}
        other._buffers = {**self._buffers, "trained": torch.full_like(self.trained, len(input_weights))}
        return other

    def _mirror(self, x: Tensor) -> Tensor:
        """Sign of every feature when the ship is mirrored."""
        return x.new_tensor([1.0, -1.0, -1.0, -1.0] if self.speed_law == "approach" else [-1.0, -1.0, -1.0])

    def _parity(self, x: Tensor) -> Tensor:
        """Sign of every output then; 0 where none is imposed."""
        return x.new_tensor(EVEN if self.symmetric else (0.0,) * OUTPUTS)

    def _features(self, x: Tensor) -> Tensor:
        if self.speed_law == "approach":
            return x
        return torch.cat([x[:, 1:3] / x[:, :1].clamp(min=MIN_SPEED_PRIME), x[:, 3:]], 1)

    def _factors(self, x: Tensor) -> Tensor:
        if self.speed_law == "approach":
            return torch.ones_like(x[:, :1]).T
        u = x[:, 0].clamp(min=MIN_SPEED_PRIME)
        return torch.stack([u.square(), u * self.shaft, self.shaft.square().expand_as(u)])

    def _library(self, x: Tensor) -> Tensor:
        """Columns t_e of the three outputs; those of surge are filled up with zeros."""
        one = torch.ones_like(x[:, 0])
        speeds = self._factors(x) if self.speed_law == "shaft" else torch.stack([one, x[:, 0], x[:, 0].square()])
        always = speeds if self.symmetric or self.speed_law == "shaft" else one[None]
        odd = self._features(x)[:, -3:].T[:, None] * self._factors(x)
        more = odd.new_zeros(0, len(x)) if self.library == "none" else odd.flatten(0, 1)
        if self.library == "quadratic":
            v, r = self._features(x)[:, -3:-1].T
            flow = torch.stack([v.abs() * v, v.abs() * r, r.abs() * v, r.abs() * r])
            more = torch.cat([more, flow * self._factors(x)[0]])
        across, along = torch.cat([always, more]), torch.cat([always, torch.zeros_like(more)])
        return torch.stack([along, across, across])


def _nodes(z: Float[Tensor, "k n i"], weights: Float[Tensor, "k h w"]) -> Float[Tensor, "k n h"]:
    return torch.baddbmm(weights[..., -1][:, None], z, weights[..., :-1].mT).tanh()
