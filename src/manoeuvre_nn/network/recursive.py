"""A recursive network: forces and its own last outputs in, the velocities of the next step out."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network

FREEDOMS = {3: ("u", "v", "r"), 4: ("u", "v", "p", "r"), 6: ("u", "v", "w", "p", "q", "r")}
"""Number of degrees of freedom -> the velocities that are predicted, in u, v and w over U0 and rates over U0/L."""
EVEN = ("u", "w", "q")
"""Velocities that stay when port and starboard change places; the others change sign."""
MAX_SHARE = 0.999
"""Share of its range up to which a last output is carried on [-]."""
STEP = 0.09
"""Time step of the source over L/U."""


@dataclass(frozen=True)
class ForceSettings:
    """Constants of the force modules that are no ship's particulars.

    Attributes:
        thrust: c1 and c2 of ``K_T = c1 + c2 J`` [-]; the source's ship 1.
        wake: Wake fraction [-].
        deduction: Thrust deduction [-].
        diameter: Diameter of one propeller over the draught [-].
        aspect: Height of a rudder squared over its area [-].
    """

    thrust: Sequence[float] = (0.6, -0.4)
    wake: float = 0.2
    deduction: float = 0.1
    diameter: float = 0.55
    aspect: float = 1.8

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range.
        """
        if len(self.thrust) != 2:
            raise InputError(f"network.forces.thrust={list(self.thrust)}: expected two numbers, c1 and c2")
        for name in ("diameter", "aspect"):
            if not getattr(self, name) > 0:
                raise InputError(f"network.forces.{name}={getattr(self, name)}: expected a number more than 0")
        for name in ("wake", "deduction"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"network.forces.{name}={getattr(self, name)}: expected a fraction from 0 to below 1")


@dataclass(frozen=True)
class RecursiveSettings:
    """Shape of a recursive network.

    Attributes:
        freedom: Degrees of freedom: 3 (u, v, r), 4 (with p) or 6 (with w and q, the source's).
        hidden: Nodes of each hidden layer.
        biases: Whether the hidden nodes have a bias; output nodes have none.
        past: Past values of lift and moments that are kept.
        past_thrust: Past values of thrust, and of the wind's forces.
        wind: Whether it takes force and moments of the recorded true wind.
        about_last: Whether output nodes work about the last outputs: the network gives the change, and where it gives
            nothing, velocities stay; else it gives the velocities, as in the source.
        symmetric: Whether port and starboard are alike: the answer is the mean of the network's and its mirror image's.
        margin: How far outputs may go beyond the data, over half their range [-].
        step: Time step over L/U [-].
    """

    freedom: int = 4
    hidden: Sequence[int] = (54, 54)
    biases: bool = True
    past: int = 7
    past_thrust: int = 1
    wind: bool = False
    about_last: bool = True
    symmetric: bool = True
    margin: float = 0.3
    step: float = STEP

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range.
        """
        check_choice("network.freedom", str(self.freedom), [str(count) for count in FREEDOMS])
        layers = list(self.hidden) if isinstance(self.hidden, Sequence) else []
        if not layers or not all(isinstance(nodes, int) and nodes > 0 for nodes in layers):
            raise InputError(f"network.hidden={self.hidden}: expected a list, the nodes of each layer: [54,54]")
        if not 0 <= self.past_thrust <= self.past:
            raise InputError(
                f"network.past_thrust={self.past_thrust}, network.past={self.past}: expected 0 <= past_thrust <= past"
            )
        if not 0 < self.step <= 1:
            raise InputError(f"network.step={self.step}: expected a time step over L/U, more than 0 and at most 1")
        if not self.margin >= 0:
            raise InputError(f"network.margin={self.margin}: expected a share of the range, at least 0")

    @property
    def velocities(self) -> tuple[str, ...]:
        """What is predicted."""
        return FREEDOMS[self.freedom]

    @property
    def long_kept(self) -> tuple[str, ...]:
        """Forces whose past values are kept for long."""
        rolls, pitches = "p" in self.velocities, "q" in self.velocities
        return ("lift_starboard", "lift_port", *["K"] * rolls, *["M"] * pitches, "N")

    @property
    def columns(self) -> tuple[str, ...]:
        """Forces of one step, in their order."""
        wind = ("wind_X", "wind_Y", "wind_N") if self.wind else ()
        return ("thrust_starboard", "thrust_port", *self.long_kept, *wind)


Folded = tuple[list[Tensor], list[Tensor | None]]
"""Weights and biases of each layer as they act on unscaled inputs; the first layer twice, the second time mirrored."""


class RecursiveNetwork(Network):
    """Logistic layers with feedback: ``y(t + dt) = f(forces(t), past forces, y(t), y(t - dt))``.

    ``h1 = s(W1 x + b1)``, ``h2 = s(W2 h1 + b2)``, ``y = m + d (2 s(2 W3 h2) - 1)`` with the logistic s, the middle m of
    the data's range and half of it, d, with a margin: outputs are bounded. Inputs are standardised by the data. With
    ``about_last`` output nodes are given in addition what would make them repeat the last outputs,
    ``atanh((y(t) - m) / d)``. With ``symmetric`` they are given ``(f(x) + S f(M x)) / 2``, where M mirrors inputs and S
    outputs.

    Attributes:
        settings: Its shape.
        forces: Constants of the force modules.
        weights: Of each layer, a column a node.
        biases: Of each hidden layer; none without biases.

    Source:
        Hess & Faller 2000, eqs 1-3 and Table 2. With 6 degrees of freedom there are 56 inputs: 54-54 nodes with biases
        have 6372 weights; 56-56 without have 6608, the number that is printed. Symmetry stands for mirrored runs.
    """

    any_fit = False
    shift: Tensor
    scale: Tensor
    middle: Tensor
    half_range: Tensor
    partners: Tensor
    signs: Tensor
    output_signs: Tensor
    both_signs: Tensor

    def __init__(
        self,
        settings: RecursiveSettings | None = None,
        forces: ForceSettings | None = None,
        *,
        seed: int = 0,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        """Draw the first weights.

        Args:
            settings: Shape.
            forces: Constants of the force modules, for the ship that it is joined to.
            seed: Seed of the weights.
            dtype: Floating type.
        """
        super().__init__()
        self.settings = s = settings or RecursiveSettings()
        self.forces = forces or ForceSettings()
        sizes = [self.inputs_count, *s.hidden, len(s.velocities)]
        # Drawn in float64 whatever the type, so that float32 and float64 networks start alike.
        draw = torch.Generator().manual_seed(seed)
        # Logistic nodes have a quarter of the slope of a line: after them weights are larger.
        spreads = [1.0, *[2.0] * (len(s.hidden) - 1), 0.1 if s.about_last else 1.0]
        self.weights = nn.ParameterList(
            nn.Parameter((gain / sqrt(a) * torch.randn(a, b, generator=draw, dtype=torch.float64)).to(dtype))
            for gain, a, b in zip(spreads, sizes[:-1], sizes[1:], strict=True)
        )
        first = 0.5 * torch.randn(s.hidden[0], generator=draw, dtype=torch.float64)
        offsets = [first, *(torch.zeros(h, dtype=torch.float64) for h in s.hidden[1:])] if s.biases else []
        self.biases = nn.ParameterList(nn.Parameter(b.to(dtype)) for b in offsets)
        zero = torch.zeros((), dtype=dtype)
        self.register_buffer("shift", zero.expand(sizes[0]).clone())
        self.register_buffer("scale", zero.expand(sizes[0]) + 1.0)
        self.register_buffer("middle", zero.expand(sizes[-1]).clone())
        self.register_buffer("half_range", zero.expand(sizes[-1]) + 1.0)
        self._mirror()

    def _mirror(self) -> None:
        """Where each input is found in the mirror, and with what sign; signs of the outputs."""
        s = self.settings
        names = self.input_names
        flip = {"starboard": "port", "port": "starboard"}
        place = {name: k for k, name in enumerate(names)}
        partners, signs = [], []
        for name in names:
            quantity, _, delay = name.partition("-")
            kind, _, side = quantity.partition("_")
            partners.append(place[f"{kind}_{flip[side]}-{delay}"] if side in flip else place[name])
            odd = kind in {"lift", "K", "N"} or side in {"Y", "N"} or (kind in s.velocities and kind not in EVEN)
            signs.append(-1.0 if odd else 1.0)
        self.register_buffer("partners", torch.tensor(partners), persistent=False)
        self.register_buffer("signs", self.shift.new_tensor(signs), persistent=False)
        outputs = [1.0 if name in EVEN else -1.0 for name in s.velocities]
        self.register_buffer("output_signs", self.shift.new_tensor(outputs), persistent=False)
        both = torch.stack([torch.ones_like(self.output_signs), self.output_signs])
        self.register_buffer("both_signs", both, persistent=False)

    @property
    def takes(self) -> tuple[str, ...]:
        """Shaft speeds always, the wind if it was told to."""
        return ("shaft", "wind_north", "wind_east") if self.settings.wind else ("shaft",)

    @property
    def scalings(self) -> tuple[str, ...]:
        """Its own: by the data that it is trained on."""
        return ("approach",)

    @property
    def input_names(self) -> tuple[str, ...]:
        """``quantity-delay``, in the order of the inputs."""
        s = self.settings
        names = [f"{name}-{k}" for k in range(s.past_thrust + 1) for name in s.columns]
        names += [f"{name}-{k}" for k in range(s.past_thrust + 1, s.past + 1) for name in s.long_kept]
        return (*names, *(f"{name}-{k}" for k in range(2) for name in s.velocities))

    @property
    def inputs_count(self) -> int:
        """Number of inputs."""
        return len(self.input_names)

    @property
    def weights_count(self) -> int:
        """Number of weights and biases."""
        return sum(p.numel() for p in self.parameters())

    def join(
        self, forces: Sequence[Float[Tensor, "*batch columns"]], velocities: Sequence[Float[Tensor, "*batch freedom"]]
    ) -> Float[Tensor, "*batch inputs"]:
        """One input vector.

        Args:
            forces: Those of this step and of the past ones, the latest first.
            velocities: Outputs of the last step, and of the one before.

        Returns:
            What the network sees.
        """
        s = self.settings
        last = 2 + len(s.long_kept)
        whole, old = forces[: s.past_thrust + 1], forces[s.past_thrust + 1 : s.past + 1]
        return torch.cat([*whole, *(f[..., 2:last] for f in old), *velocities], dim=-1)

    @torch.no_grad()
    def scale_to(self, x: Float[Tensor, "n inputs"], y: Float[Tensor, "n freedom"]) -> None:
        """Set the scaling of inputs and the range of outputs by data, both alike to port and starboard if symmetric.

        Args:
            x: Inputs as they will be.
            y: Velocities.
        """
        if self.settings.symmetric:
            x, y = torch.cat([x, self.mirrored(x)]), torch.cat([y, y * self.output_signs])
        size = x.std(0)
        # An input that never changes, such as the thrust of one approach speed, keeps its size.
        constant = size <= 1e-4 * x.abs().amax(0).clamp(min=1e-12)
        self.shift.copy_(x.mean(0))
        self.scale.copy_(torch.where(constant, x.abs().amax(0).clamp(min=1e-3), size))
        low, high = y.amin(0), y.amax(0)
        self.middle.copy_((low + high) / 2)
        self.half_range.copy_(((high - low) / 2).clamp(min=1e-3) * (1 + self.settings.margin))

    def mirrored(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch inputs"]:
        """Inputs with port and starboard exchanged."""
        return x[..., self.partners] * self.signs

    def folded(self) -> Folded:
        """The scaling drawn into the first layer, and its mirror image beside it: once before many steps."""
        first = self.weights[0] / self.scale[:, None]
        offset = -(self.shift / self.scale) @ self.weights[0]
        if self.settings.biases:
            offset = offset + self.biases[0]
        if self.settings.symmetric:
            # W x' = W (signs * x[partners]): the mirror is its own inverse, so it may be drawn into the weights.
            first = torch.cat([first, (first * self.signs[:, None])[self.partners]], dim=1)
            offset = torch.cat([offset, offset])
        others = list(self.biases)[1:] if self.settings.biases else [None] * (len(self.weights) - 2)
        return [first, *list(self.weights)[1:]], [offset, *others, None]

    def answer(self, x: Float[Tensor, "n inputs"], folded: Folded) -> Float[Tensor, "n freedom"]:
        """Velocities of the next step, with weights that were folded before."""
        weights, biases = folded
        count = len(x)
        assert biases[0] is not None
        nodes = torch.addmm(biases[0], x, weights[0])
        if self.settings.symmetric:
            nodes = nodes.view(2 * count, -1)
        for weight, bias in zip(weights[1:], biases[1:], strict=True):
            values = nodes.sigmoid()
            nodes = values @ weight if bias is None else torch.addmm(bias, values, weight)
        nodes, _ = self._given(x, nodes)
        # tanh is twice the logistic of twice its argument, less 1.
        return torch.addcmul(self.middle, nodes.tanh(), self.half_range)

    def nodes(self, x: Float[Tensor, "*batch inputs"], folded: Folded) -> tuple[list[Tensor], list[Tensor]]:
        """Values of hidden nodes at some inputs, and derivatives of all nodes' functions, for :meth:`pulled_back`.

        Args:
            x: Inputs.
            folded: Folded weights.

        Returns:
            Values of each hidden layer, mirrored rows beside the others; derivatives of each hidden layer, of the
            outputs, and of the outputs by what they are about.
        """
        weights, biases = folded
        values, slopes = [], []
        assert biases[0] is not None
        nodes = x @ weights[0] + biases[0]
        if self.settings.symmetric:
            nodes = nodes.unflatten(-1, (2, -1)).flatten(-3, -2)
        for weight, bias in zip(weights[1:], biases[1:], strict=True):
            values.append(nodes.sigmoid())
            slopes.append(values[-1] * (1 - values[-1]))
            nodes = values[-1] @ weight if bias is None else values[-1] @ weight + bias
        nodes, share = self._given(x, nodes)
        slopes.append(self.half_range * (1 - nodes.tanh().square()))
        # From there on what the output is about moves no more.
        moves = (share.abs() < MAX_SHARE) if self.settings.about_last else torch.zeros_like(share, dtype=torch.bool)
        return values, [*slopes, torch.where(moves, 1 / (self.half_range * (1 - share.square())), 0.0)]

    def _given(
        self, x: Float[Tensor, "*batch inputs"], nodes: Float[Tensor, "*more freedom"]
    ) -> tuple[Float[Tensor, "*batch freedom"], Float[Tensor, "*batch freedom"]]:
        """What output nodes are given, and the last outputs over their range."""
        count = nodes.shape[-1]
        if self.settings.symmetric:
            nodes = 0.5 * (nodes.unflatten(-2, (-1, 2)) * self.both_signs).sum(-2)
        share = (x[..., -2 * count : -count] - self.middle) / self.half_range
        return nodes + share.clamp(-MAX_SHARE, MAX_SHARE).atanh() if self.settings.about_last else nodes, share

    def pulled_back(
        self, cotangent: Float[Tensor, "rows freedom"], slopes: Sequence[Tensor], folded: Folded
    ) -> tuple[Float[Tensor, "rows inputs"], list[Tensor]]:
        """Transposed Jacobian times a cotangent of the answer.

        ``W1 (s1' (W2 (s2' (W3 (d s' l)))))``, from the output backwards; in the mirror image with signs.

        Args:
            cotangent: l.
            slopes: By :meth:`nodes`.
            folded: Folded weights.

        Returns:
            Cotangent of the inputs, and of what the nodes of each layer are given, the last layer first.
        """
        *layers, out, about = slopes
        count, nodes = cotangent.shape[1], cotangent * out
        passed = [(0.5 * nodes[:, None] * self.both_signs).view(-1, count) if self.settings.symmetric else nodes]
        for weight, slope in zip(reversed(folded[0][1:]), reversed(layers), strict=True):
            passed.append((passed[-1] @ weight.T) * slope)
        passed[-1] = passed[-1].view(len(cotangent), -1)
        back = passed[-1] @ folded[0][0].T
        if self.settings.about_last:
            back[:, -2 * count : -count] += nodes * about
        return back, passed

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Velocities of the next step."""
        return self.answer(x.reshape(-1, x.shape[-1]), self.folded()).view(*x.shape[:-1], -1)
