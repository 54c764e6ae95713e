"""What a page of :mod:`.latex` says, computed: its formulas and tables are read back from the text alone."""

import re
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

Column = Float[np.ndarray, " points"] | float
Values = Mapping[str, Column]
"""Symbol as it is written -> its value at every point."""
BLOCK = re.compile(
    r"\\begin\{align\*\}\n(?P<lines>.*?)\n\\end\{align\*\}|\\\[ (?P<formula>.*?) \\\]"
    r"|\\begin\{longtable\}\{(?P<columns>[^}]*)\}\n(?P<rows>.*?)\n\\end\{longtable\}",
    re.DOTALL,
)
LISTED = re.compile(
    r"(?P<name>(?:\{\}\^\{\*\})?[A-Za-z]+)_\{(?P<first>\d+)\}(?P<sign>,| \+) \\ldots"
    r"(?P=sign) (?P=name)_\{(?P<last>\d+)\}"
)
NUMBER = r"\d+(?:\.\d+)?(?: \\cdot 10\^\{-?\d+\})?"
OPENING, CLOSING = {r"\left", r"\bigl"}, {r"\right", r"\bigr"}
FUNCTIONS: dict[str, Callable] = {
    r"\tanh": np.tanh,
    r"\cos": np.cos,
    r"\sin": np.sin,
    r"\log": np.log,
    r"\max": lambda *values: np.maximum.reduce(np.broadcast_arrays(*values)),
    r"\min": lambda *values: np.minimum.reduce(np.broadcast_arrays(*values)),
    r"\sigma": lambda x: 0.5 + 0.5 * np.tanh(0.5 * x),
    r"\operatorname{atan2}": np.arctan2,
    r"\operatorname{median}": lambda *values: np.median(np.broadcast_arrays(*values), axis=0),
}
"""Functions of mathematics and what they do."""


class _Reader:
    """A formula, read from left to right: sums of products of factors."""

    def __init__(self, text: str, values: Values) -> None:
        symbols = "|".join(re.escape(s) for s in sorted(values, key=len, reverse=True)) or r"(?!)"
        pattern = rf"(?P<symbol>{symbols})|(?P<number>{NUMBER})|\\operatorname\{{\w+\}}|\\[a-zA-Z]+|\\[,!;]|\S"
        self.tokens = [(m.lastgroup, m[0]) for m in re.finditer(pattern, text)]
        self.values, self.place = values, 0

    @property
    def next(self) -> str:
        return self.tokens[self.place][1] if self.place < len(self.tokens) else ""

    def take(self, wanted: str = "") -> str:
        token = self.next
        assert token and (not wanted or token == wanted), f"{wanted} expected at {token} of a formula"
        self.place += 1
        return token

    def sum(self) -> Column:
        total = self._signed()
        while self.next in {"+", "-"}:
            total = total + self._signed()
        return total

    def _signed(self) -> Column:
        sign = {"+": 1.0, "-": -1.0}.get(self.next)
        if sign is not None:
            self.take()
        return (sign or 1.0) * self._product()

    def _product(self) -> Column:
        value = self._power()
        while self.next and self.next not in {"+", "-", "}", ")", "|", ","} | CLOSING:
            if self.next == r"\,":
                self.take()
            value = value * self._power()
        return value

    def _power(self) -> Column:
        value = self._factor()
        if self.next == "^":
            self.take()
            return value ** self._group()
        return value

    def _group(self) -> Column:
        self.take("{")
        value = self.sum()
        self.take("}")
        return value

    def _factor(self) -> Column:
        kind = self.tokens[self.place][0]
        token = self.next
        if token == "{" and kind is None:
            return self._group()
        self.take()
        if kind == "symbol":
            return self.values[token]
        if kind == "number":
            return read_number(token)
        if token == r"\frac":
            return self._group() / self._group()
        if token == r"\sqrt":
            return self._group() ** 0.5
        if token == "e":
            self.take("^")
            return np.exp(self._group())
        if token in OPENING:
            return self._bracket(self.take())[0] if self.next == "(" else np.abs(self._bracket(self.take())[0])
        return self._call(token)

    def _call(self, name: str) -> Column:
        braced = self.next == "{"
        if braced:
            self.take()
        assert self.take() in OPENING
        value = FUNCTIONS[name](*self._bracket(self.take("(")))
        if braced:
            self.take("}")
        return value

    def _bracket(self, opened: str) -> list[Column]:
        found = [self.sum()]
        while self.next == ",":
            self.take()
            found.append(self.sum())
        assert self.take() in CLOSING
        self.take({"(": ")", "|": "|"}[opened])
        return found


def _listed(some: re.Match[str]) -> str:
    """``q_{1}`` to ``q_{3}`` with those between."""
    return f"{some['sign']} ".join(f"{some['name']}_{{{k}}}" for k in range(int(some["first"]), int(some["last"]) + 1))


def read_number(text: str) -> float:
    """A number as it is written in a formula."""
    return float(re.sub(r" \\cdot 10\^\{(-?\d+)\}", r"e\1", text.strip("$ ")))


def computed(formula: str, values: Values) -> Column:
    """The value of a formula at every point."""
    if formula in values:
        return values[formula]
    whole = LISTED.sub(_listed, formula)
    reader = _Reader(whole, {symbol: value for symbol, value in values.items() if symbol in whole})
    value = reader.sum()
    assert not reader.next, f"{reader.next} is left over of a formula"
    return value


def evaluate(text: str, points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n outputs"]:
    """The outputs that a page gives.

    Args:
        text: The page.
        points: Values of its inputs, in the order of its table of symbols.

    Returns:
        Values of its outputs.
    """
    table = text[text.index(r"\hline") : text.index(r"\end{tabular}")]
    rows = re.findall(r"^\$(.*?)\$ & .*? & .*? &(.*?)\\\\$", table, re.MULTILINE)
    inputs, outputs = ([s for s, ends in rows if bool(ends.strip()) == given] for given in (True, False))
    values: dict[str, Column] = dict(zip(inputs, points.T, strict=True))
    sums: dict[str, _Sum] = {}
    for block in BLOCK.finditer(text):
        if block["lines"] is not None:
            for line in block["lines"].replace(r" \\ &\quad ", " ").split(" \\\\\n"):
                target, _, formula = line.partition(" &= ")
                values[target] = computed(formula, values)
        elif block["rows"] is not None:
            last = list(sums.values())[-1]
            last.add(block["rows"], values)
        elif "sum_{j}" in block["formula"]:
            one = _Sum(block["formula"])
            known = sums.get(one.label)
            if known is None:
                sums[one.label] = one
            else:
                one.use(known, values)
        elif r"+ \ldots +" in block["formula"]:
            target, _, formula = block["formula"].partition(" = ")
            values[target] = computed(formula, values)
        elif r"\ldots" in block["formula"]:
            _fill(block["formula"], values)
    return np.stack([np.broadcast_to(values[name], len(points)) for name in outputs], axis=1)


def _fill(formula: str, values: dict[str, Column]) -> None:
    """Values ``y_i = f(z_i)`` for all i."""
    equation, _, count = formula.partition(r", \qquad i = 1, \, \ldots, \, ")
    for k in range(1, int(count) + 1):
        target, _, right = equation.replace("_{i}", f"_{{{k}}}").partition(" = ")
        values[target] = computed(right, values)


class _Sum:
    """``h_i = f(sum_j A_ij z_j)`` with its table."""

    def __init__(self, formula: str) -> None:
        self.left, _, right = formula.partition(" = ")
        self.right, _, listed = right.partition(r", \qquad z = ")
        self.inputs = listed.removeprefix(r"\bigl(").removesuffix(r"\bigr)").split(r", \, ") if listed else []
        self.label = re.findall(r"A\^\{\((\d+)\)\}", formula)[0]
        self.numbers: dict[str, dict[str, float]] = {}

    def add(self, rows: str, values: dict[str, Column]) -> None:
        """Take a table of numbers, and compute the values when all are there."""
        head, *lines = [line.removesuffix(r" \\") for line in rows.split("\n")]
        names = [cell.strip("$ ") for cell in head.removesuffix(r" \\ \hline \endhead").split(" & ")]
        cells = [[cell.strip("$ ") for cell in line.split(" & ")] for line in lines]
        if names[0] == "z_{j}":
            pairs = [(row[k], row[k + 1]) for row in cells for k in range(0, len(row), 2)]
            self.numbers[self.left] = {z: read_number(a) for z, a in pairs}
        else:
            turned = names[0].endswith("j$, $i")
            for row in cells:
                for name, cell in zip(names[1:], row[1:], strict=True):
                    target, z = (name, row[0]) if turned else (row[0], name)
                    self.numbers.setdefault(target, {})[z] = read_number(cell)
        self._compute(list(self.numbers), values)

    def use(self, known: "_Sum", values: dict[str, Column]) -> None:
        """Compute with the numbers of another sum."""
        targets = [re.sub(r"\{i\}$", _index(name), self.left) for name in known.numbers]
        rows = [dict(zip(self.inputs, row.values(), strict=True)) for row in known.numbers.values()]
        self.numbers = dict(zip(targets, rows, strict=True))
        self._compute(targets, values)

    def _compute(self, targets: list[str], values: dict[str, Column]) -> None:
        pattern = r"(B\S* \\, )?\\sum_\{j\} (\\bigl\(z_\{j\} - A\S*?\\bigr\)\^\{2\}|A\S* \\, z_\{j\})"
        term = re.search(pattern, self.right)
        assert term is not None
        number = re.findall(r"A\^\{\(\d+\)\}_\{i?j\}", term[2])[0]
        for target in targets:
            total: Column = 0.0
            row = dict(self.numbers[target])
            factor = row.pop("B_{i}", 1.0)
            for z, a in row.items():
                at = {number: a, "z_{j}": computed(z, values)}
                total = total + computed(term[2], at)
            right = self.right.replace(term[0], "TOTAL")
            values[target] = computed(right, {"TOTAL": factor * total})


def _index(symbol: str) -> str:
    found = re.search(r"\{[^{}]*\}$", symbol)
    assert found is not None
    return found[0]
