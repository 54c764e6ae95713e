"""What a paper claims, as data: a claims.yaml beside a study says what is compared, by which rule, and why it differs.

A chapter computes quantities by name. An entry of the yaml has these keys; texts are templates of quantities,
``{dev:.2g}`` or ``{table[Y_v]}``, and a template that is nothing but one quantity, ``{dev}``, keeps its number:

- ``where``, ``what``: place in the paper, and what is compared there;
- ``paper``: the paper's number, or its statement in our words; ``ours``: ours; ``unit``: of both;
- one rule: ``within`` and ``relative`` (largest difference; with ``same_sign`` it holds in direction if the signs
  agree), ``factor`` (largest ratio), ``holds`` and ``in_direction`` (bounds such as ``<= 0.1``, ``> 0 and < 1`` or
  ``true`` of the quantity ``of``, by default ``ours``), ``share`` and ``chance`` (share of the starts for which a
  statement is true), ``starts`` (a printed number beside the distribution over our starts), or ``verdict`` (what
  reading the paper alone tells);
- ``note``: said in any case; ``why``: said where the claim does not hold (one text, or name -> text with ``values``);
- ``each``: name of a list of quantities for each of which the entry is one claim;
- ``values``: name -> the paper's number, one claim each, beside the quantity of that name in ``of``; ``{name}`` is the
  name.

Beside the chapters stand ``limits``: numbers that are used more than once, in the yaml as ``{limit}`` and in the code.
"""

import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np

from manoeuvre_nn.commands.config import load_yaml
from manoeuvre_nn.core.errors import InputError
from studies.reproduction.paper import paper_folders
from studies.reproduction.section import Claim, Verdict, by_tolerance
from studies.reproduction.template import filled

Quantities = Mapping[str, Any]
"""Name -> number, text, list of them, or mapping of them."""
FILE = "claims.yaml"
RULES: dict[str, frozenset[str]] = {
    "within": frozenset({"within", "relative", "same_sign"}),
    "relative": frozenset({"within", "relative", "same_sign"}),
    "factor": frozenset({"factor"}),
    "holds": frozenset({"holds", "in_direction", "of"}),
    "in_direction": frozenset({"holds", "in_direction", "of"}),
    "share": frozenset({"share", "chance"}),
    "starts": frozenset({"starts"}),
    "verdict": frozenset({"verdict"}),
}
"""Key that names a rule -> all keys that belong to it."""
TEXTS = frozenset({"where", "what", "paper", "ours", "unit", "note", "why"})
KEYS = TEXTS.union(*RULES.values(), {"each", "values"})
MARGIN = 0.75
"""Share of the starts from which on a statement holds."""
COMPARISONS = {"<=": operator.le, "<": operator.lt, ">=": operator.ge, ">": operator.gt, "==": operator.eq}
BOUND = re.compile(r"(<=|<|>=|>|==)\s*(\S+)")


@dataclass(frozen=True)
class Statement:
    """An entry of a claims.yaml.

    Attributes:
        place: File, chapter and number of the entry, for messages.
        content: Its keys, those of ``values`` set apart into one statement each.
        rule: Key of the rule.
        name: Name of the value; empty without ``values``.
    """

    place: str
    content: Mapping[str, Any]
    rule: str
    name: str = ""

    def claims(self, quantities: Quantities) -> Iterator[Claim]:
        """Set what was computed beside what the paper says.

        Args:
            quantities: What was computed, and the limits.

        Yields:
            One claim, with ``each`` one for each of its items.
        """
        items: Sequence[Quantities] = [{}]
        if "each" in self.content:
            items = self._found(quantities, str(self.content["each"]))
        for item in items:
            yield self._claim({**quantities, **item, "name": self.name})

    def _claim(self, quantities: Quantities) -> Claim:
        """The claim with these quantities."""
        texts = {key: filled(self._of_name(key), quantities, self.place) for key in TEXTS - {"note", "why"}}
        judged = JUDGES[self.rule](self, quantities, texts)
        said = [judged.why] if judged.why else []
        for key in ("note", "why"):
            if key == "note" or judged.verdict != "holds":
                text = str(filled(self._of_name(key), quantities, self.place))
                said += [text] if text else []
        return Claim(
            str(texts["where"]), str(texts["what"]), judged.paper, judged.ours, judged.verdict, "; ".join(said),
            str(texts["unit"]),
        )  # fmt: skip

    def _of_name(self, key: str) -> Any:
        """A text, or that of this name where a text is given for some names only."""
        text = self.content.get(key, "")
        return text.get(self.name, "") if isinstance(text, Mapping) else text

    def _found(self, quantities: Quantities, key: str) -> Any:
        """A quantity by its name."""
        return filled(f"{{{key}}}", quantities, self.place)

    def _by_tolerance(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """A number beside the paper's, with a tolerance."""
        within, relative = self.content.get("within"), self.content.get("relative")
        paper, ours = self._number(texts["paper"], "paper"), self._number(texts["ours"], "ours")
        same_sign = bool(self.content.get("same_sign", False))
        found = by_tolerance(paper, ours, within=within, relative=relative, same_sign=same_sign)
        return Claim("", "", paper, ours, found)

    def _by_factor(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """A number beside the paper's, of which it is to be less than a factor apart."""
        paper, ours = self._number(texts["paper"], "paper"), self._number(texts["ours"], "ours")
        factor = float(self.content["factor"])
        return Claim("", "", paper, ours, "holds" if 1 / factor < ours / paper < factor else "does not hold")

    def _by_bound(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """A statement, true where a quantity is within a bound."""
        value = self._found(quantities, str(self.content["of"])) if "of" in self.content else texts["ours"]
        verdict: Verdict = "does not hold"
        if self._is_within("in_direction", value, quantities):
            verdict = "holds in direction"
        if self._is_within("holds", value, quantities):
            verdict = "holds"
        return Claim("", "", texts["paper"], texts["ours"], verdict)

    def _by_share(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """A statement: it holds if true for 3/4 of the starts, in direction for half of them or twice the chance."""
        share = self._number(self._found(quantities, str(self.content["share"])), "share")
        chance = None if "chance" not in self.content else float(Fraction(str(self.content["chance"])))
        direction = share > 0.5 or (chance is not None and share >= 2 * chance)
        verdict: Verdict = "holds" if share >= MARGIN else "holds in direction" if direction else "does not hold"
        odds = "" if chance is None else f" (chance {chance:.2f})"
        return Claim("", "", texts["paper"], f"true for {share:.2f} of the starts{odds}", verdict)

    def _by_starts(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """A printed number: it holds between our best and worst start, in direction within a factor of 3 of them."""
        ours, paper = self._found(quantities, str(self.content["starts"])), self._number(texts["paper"], "paper")
        low, high = float(np.min(ours)), float(np.max(ours))
        near = low / 3 <= paper <= 3 * high
        verdict: Verdict = "holds" if low <= paper <= high else "holds in direction" if near else "does not hold"
        told = f"{len(ours)} starts: {low:.3g} to {high:.3g}"
        return Claim("", "", paper, float(np.median(ours)), verdict, told)

    def _by_reading(self, quantities: Quantities, texts: Mapping[str, Any]) -> Claim:
        """What reading the paper alone tells."""
        return Claim("", "", texts["paper"], texts["ours"], self.content["verdict"])

    def _number(self, value: Any, what: str) -> float:
        """A number, or a line that says that it is none."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{self.place}: {what} is {value!r}: expected a number")
        return float(value)

    def _is_within(self, key: str, value: Any, quantities: Quantities) -> bool:
        """Whether a quantity is within ``holds`` or ``in_direction``; bounds are joined by ``and``."""
        bound = self.content.get(key)
        if bound is None or isinstance(bound, bool):
            return bound is not None and value == bound
        number, inside = self._number(value, "what is judged"), True
        for part in str(filled(bound, quantities, self.place)).split(" and "):
            found = BOUND.fullmatch(part.strip())
            if found is None:
                raise InputError(f"{self.place}: {key}: {bound}: expected a bound such as <= 0.1, or true")
            inside = inside and COMPARISONS[found[1]](number, float(Fraction(found[2])))
        return inside


JUDGES = {
    "within": Statement._by_tolerance,
    "relative": Statement._by_tolerance,
    "factor": Statement._by_factor,
    "holds": Statement._by_bound,
    "in_direction": Statement._by_bound,
    "share": Statement._by_share,
    "starts": Statement._by_starts,
    "verdict": Statement._by_reading,
}
"""Key of a rule -> what applies it."""


@dataclass(frozen=True)
class ChapterClaims:
    """What a chapter of a paper claims.

    Attributes:
        statements: In the order of the yaml.
        limits: Numbers that are used more than once.
    """

    statements: Sequence[Statement]
    limits: Mapping[str, float]

    def beside(self, quantities: Quantities) -> list[Claim]:
        """Set what was computed beside all that the chapter says.

        Args:
            quantities: What was computed.

        Returns:
            The claims.
        """
        known = {**self.limits, **quantities}
        return [claim for statement in self.statements for claim in statement.claims(known)]

    def at(self, *places: str) -> "ChapterClaims":
        """What is said in some tables, figures or sections only.

        Args:
            places: Beginnings of ``where``.

        Returns:
            Their statements.
        """
        some = [s for s in self.statements if str(s.content["where"]).startswith(places)]
        return ChapterClaims(some, self.limits)


def read_claims(study: str, chapter: str) -> ChapterClaims:
    """Read what a paper claims in a chapter.

    Args:
        study: Name of the study's folder.
        chapter: Number of the chapter.

    Returns:
        Its claims. A yaml that is not as it should be is refused in one line.

    Raises:
        InputError: If there is no such chapter.
    """
    path = paper_folders()[study] / FILE
    found = _read(path)
    if chapter not in found["chapters"]:
        raise InputError(f"{path}: chapter {chapter} has no claims; there are: {', '.join(found['chapters'])}")
    return ChapterClaims(found["chapters"][chapter], found["limits"])


@cache
def _read(path: Path) -> dict[str, Any]:
    """The whole file, checked."""
    content = load_yaml(path)
    if not isinstance(content, Mapping) or not set(content) <= {"limits", "chapters"} or "chapters" not in content:
        raise InputError(f"{path}: expected chapters, and limits if there are any")
    limits = content.get("limits") or {}
    wrong = [name for name, value in limits.items() if isinstance(value, bool) or not isinstance(value, int | float)]
    if wrong:
        raise InputError(f"{path}: limits: {wrong[0]} is no number")
    chapters = {}
    for chapter, entries in content["chapters"].items():
        if not isinstance(entries, list):
            raise InputError(f"{path}: chapter {chapter}: expected a list of claims")
        named = [(f"{path.parent.name}/{path.name}, chapter {chapter}, claim {k}", e) for k, e in enumerate(entries, 1)]
        chapters[str(chapter)] = [s for place, entry in named for s in _statements(place, entry)]
    return {"limits": limits, "chapters": chapters}


def _statements(place: str, entry: Any) -> Iterator[Statement]:
    """An entry, checked; one statement for each of its values."""
    if not isinstance(entry, Mapping):
        raise InputError(f"{place}: expected keys and values")
    place = f"{place} ({entry.get('where', 'nowhere')})"
    unknown = [str(key) for key in entry if key not in KEYS]
    if unknown:
        raise InputError(f"{place}: {unknown[0]!r} is unknown; choose from: {', '.join(sorted(KEYS))}")
    rules = [key for key in RULES if key in entry]
    belongs = frozenset().union(*(RULES[key] for key in rules[:1])) | TEXTS | {"each", "values", "of"}
    strange = [str(key) for key in entry if key not in belongs]
    if not rules or strange:
        raise InputError(
            f"{place}: expected one rule, {', '.join(sorted(set(RULES)))}" + (f"; not {strange[0]}" if rules else "")
        )
    if entry.get("verdict", "holds") not in get_args(Verdict):
        raise InputError(
            f"{place}: verdict {entry['verdict']!r} is unknown; choose from: {', '.join(get_args(Verdict))}"
        )
    own_ours = rules[0] in {"share", "starts"}
    entry = {
        key: _as_number(place, key, value) if key in {"within", "relative"} else value for key, value in entry.items()
    }
    needed = {"where", "of"} if "values" in entry else {"where", "what", "paper"} | (set() if own_ours else {"ours"})
    missing = sorted(needed - set(entry))
    if missing:
        raise InputError(f"{place}: {missing[0]} is missing")
    if "values" not in entry:
        yield Statement(place, entry, rules[0])
        return
    if not isinstance(entry["values"], Mapping):
        raise InputError(f"{place}: values: expected name: number")
    shared = {key: value for key, value in entry.items() if key not in {"values", "of"}}
    for name, value in entry["values"].items():
        own = {"what": "{name}", "ours": f"{{{entry['of']}[{name}]}}", "paper": _as_number(place, name, value)}
        yield Statement(place, own | shared, rules[0], str(name))


def _as_number(place: str, key: Any, value: Any) -> float:
    """A number; yaml takes 1e-9 for a text."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{place}: {key}: {value!r}: expected a number") from None
