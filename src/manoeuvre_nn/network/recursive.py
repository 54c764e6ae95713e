"""A recursive network: forces and its own last outputs in, the velocities of the next step out."""

from collections.abc import Sequence
from math import sqrt

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.network import Network
from manoeuvre_nn.network.recursive_settings import EVEN, ForceSettings, RecursiveSettings
from manoeuvre_nn.network.recursive_settings import STEP as STEP  # of those who know the network alone

LINK = 0.05
"""What a link of 1 gives an output node at the usual size of the wind's force [-]."""
MAX_SHARE = 0.999
"""Share of its range up to which a last output is carried on [-]."""
Folded = tuple[list[Tensor], list[Tensor | None], Tensor | None]
"""Weights and biases of each layer as they act on unscaled inputs; the first layer twice, the second time mirrored; and
what the wind's forces act on the output nodes by."""


class RecursiveNetwork(Network):
    """Logistic layers with feedback: ``y(t + dt) = f(forces(t), past forces, y(t), y(t - dt))``.

    ``h1 = s(W1 x + b1)``, ``h2 = s(W2 h1 + b2)``, ``y = m + d (2 s(2 W3 h2) - 1)`` with the logistic s, the middle m of
    the data's range and half of it, d, with a margin: outputs are bounded. Inputs are standardised by the data. With
    ``about_last`` output nodes are given in addition what would make them repeat the last outputs,
    ``atanh((y(t) - m) / d)``. With ``symmetric`` they are given ``(f(x) + S f(M x)) / 2``, where M mirrors inputs and S
    outputs. Of the wind's forces w they are given ``A w`` in addition; with ``symmetric`` X acts on u, w, q alone and Y
    and N on v, p, r.

    Attributes:
        settings: Its shape.
        forces: Constants of the force modules.
        weights: Of each layer, a column a node.
        biases: Of each hidden layer; none without biases.
        links: A, over the sizes of the wind's forces; 0 at first.

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
    through: Tensor
    allowed: Tensor

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
        names, linked = self.input_names, s.wind and not s.wind_nodes
        through = [k for k, name in enumerate(names) if not (linked and name.startswith("wind"))]
        sizes = [len(through), *s.hidden, len(s.velocities)]
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
        self.links = nn.Parameter(zero.expand(3, sizes[-1]).clone()) if linked else None
        self.register_buffer("through", torch.tensor(through), persistent=False)
        self.register_buffer("shift", zero.expand(len(names)).clone())
        self.register_buffer("scale", zero.expand(len(names)) + 1.0)
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
        forces = self.shift.new_tensor([1.0, -1.0, -1.0])[:, None]
        allowed = forces * self.output_signs > 0 if s.symmetric else torch.ones_like(forces * self.output_signs)
        self.register_buffer("allowed", allowed.to(self.shift), persistent=False)

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
        """Number of weights and biases, and of links that may act."""
        links = 0 if self.links is None else self.links.numel() - int(self.allowed.sum())
        return sum(p.numel() for p in self.parameters()) - links

    @property
    def wind_places(self) -> slice:
        """Where the wind's forces of this step stand among the inputs."""
        return slice(len(self.settings.columns) - 3, len(self.settings.columns))

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
        rows = self.through
        scaled = self.weights[0] / self.scale[rows, None]
        offset = -self.shift[rows] @ scaled
        first = scaled.new_zeros(self.inputs_count, scaled.shape[1]).index_copy(0, rows, scaled)
        if self.settings.biases:
            offset = offset + self.biases[0]
        if self.settings.symmetric:
            # W x' = W (signs * x[partners]): the mirror is its own inverse, so it may be drawn into the weights.
            first = torch.cat([first, (first * self.signs[:, None])[self.partners]], dim=1)
            offset = torch.cat([offset, offset])
        others = list(self.biases)[1:] if self.settings.biases else [None] * (len(self.weights) - 2)
        sizes = self.scale[self.wind_places, None] / LINK
        links = None if self.links is None else self.links * self.allowed / sizes
        return [first, *list(self.weights)[1:]], [offset, *others, None], links

    def answer(self, x: Float[Tensor, "n inputs"], folded: Folded) -> Float[Tensor, "n freedom"]:
        """Velocities of the next step, with weights that were folded before."""
        weights, biases, links = folded
        count = len(x)
        assert biases[0] is not None
        nodes = torch.addmm(biases[0], x, weights[0])
        if self.settings.symmetric:
            nodes = nodes.view(2 * count, -1)
        for weight, bias in zip(weights[1:], biases[1:], strict=True):
            values = nodes.sigmoid()
            nodes = values @ weight if bias is None else torch.addmm(bias, values, weight)
        nodes, _ = self._given(x, nodes, links)
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
        weights, biases, links = folded
        values, slopes = [], []
        assert biases[0] is not None
        nodes = x @ weights[0] + biases[0]
        if self.settings.symmetric:
            nodes = nodes.unflatten(-1, (2, -1)).flatten(-3, -2)
        for weight, bias in zip(weights[1:], biases[1:], strict=True):
            values.append(nodes.sigmoid())
            slopes.append(values[-1] * (1 - values[-1]))
            nodes = values[-1] @ weight if bias is None else values[-1] @ weight + bias
        nodes, share = self._given(x, nodes, links)
        slopes.append(self.half_range * (1 - nodes.tanh().square()))
        # From there on what the output is about moves no more.
        moves = (share.abs() < MAX_SHARE) if self.settings.about_last else torch.zeros_like(share, dtype=torch.bool)
        return values, [*slopes, torch.where(moves, 1 / (self.half_range * (1 - share.square())), 0.0)]

    def _given(
        self, x: Float[Tensor, "*batch inputs"], nodes: Float[Tensor, "*more freedom"], links: Tensor | None
    ) -> tuple[Float[Tensor, "*batch freedom"], Float[Tensor, "*batch freedom"]]:
        """What output nodes are given, and the last outputs over their range."""
        count = nodes.shape[-1]
        if self.settings.symmetric:
            nodes = 0.5 * (nodes.unflatten(-2, (-1, 2)) * self.both_signs).sum(-2)
        if links is not None:
            nodes = nodes + x[..., self.wind_places] @ links
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
        if folded[2] is not None:
            back[:, self.wind_places] += nodes @ folded[2].T
        return back, passed

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Velocities of the next step."""
        return self.answer(x.reshape(-1, x.shape[-1]), self.folded()).view(*x.shape[:-1], -1)
