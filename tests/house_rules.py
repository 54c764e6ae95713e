"""Rules of the house that are read off the source: who breaks which one."""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "manoeuvre_nn"
MAX_PARAMETERS = 7
VAGUE_CONSTANTS = frozenset(
    "MOST LEAST SMALL SMALLEST ENOUGH SETTLE SUNK RIGHT LEAP HOPE WORTH WIDTH LATEST USUAL FEW FEWEST LONG LONGEST "
    "SHORT SHORTEST LARGEST LOWEST FAR FARTHEST TIGHT CLEAR WIDE WIDEST NARROWEST CLOSE CLOSEST NEAR SOME HARM LOST "
    "STILL WILD HOLE INSTEAD JUDGED JUDGES WAIT ROUGH CRUDE FINE FINEST COARSE COARSEST SLOWEST FAST FASTEST TIP ILL "
    "DOUBT QUIET FIRM TELLING PERHAPS HARDLY SLACK".split()
)
"""Names of constants that do not say what they bound."""
PRIVATE_WORDS = frozenset(
    "bench court contest sheet opinion captain ladder stranger rough swell colour colours doubts doubt honest rung "
    "rungs peers judge judges judged trust".split()
)
"""Words of ours that have a word of the field: see the docs/glossary.md."""
ALLOWED_WORDS = {"swell": ("effect",), "colour": ("report",), "colours": ("report",)}
"""Words that are the field's own in some rooms: waves have a swell, curves have a colour."""

Offences = dict[str, list[str]]
"""Rule -> who breaks it, as ``folder/file.py name``."""


@cache
def offences() -> Offences:
    """Everything in the package that breaks one of the rules below."""
    trees = {str(p.relative_to(PACKAGE)): ast.parse(p.read_text()) for p in sorted(PACKAGE.rglob("*.py"))}
    concrete = concrete_classes(list(trees.values()))
    found: dict[str, set[str]] = defaultdict(set)
    for path, tree in trees.items():
        found["parameters"] |= {f"{path} {name}" for name in long_signatures(tree)}
        found["constants"] |= {f"{path} {name}" for name in constants(tree) if name in VAGUE_CONSTANTS}
        found["words"] |= {f"{path} {word}" for word in private_words(tree, path.split("/", maxsplit=1)[0])}
        found["subclasses"] |= {f"{path} {name}" for name in subclasses_of(tree, concrete)}
    studies = [ast.parse(p.read_text()) for p in (ROOT / "studies").rglob("*.py")]
    found["classes"] = set(repeated_classes([*trees.values(), *studies]))
    return {rule: sorted(who) for rule, who in sorted(found.items())}


@cache
def nodes_of(tree: ast.AST) -> list[ast.AST]:
    """All nodes of a file, which every rule looks at."""
    return list(ast.walk(tree))


@cache
def words_of(name: str) -> frozenset[str]:
    """Words of an identifier in small letters."""
    return frozenset(part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name))


def long_signatures(tree: ast.AST) -> Iterator[str]:
    """Functions with more parameters than a reader can keep apart; ``self`` and ``cls`` do not count."""
    for node in nodes_of(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            a = node.args
            names = [arg.arg for arg in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if arg is not None]
            if len(names) - (names[:1] in (["self"], ["cls"])) > MAX_PARAMETERS:
                yield node.name


def constants(tree: ast.Module) -> Iterator[str]:
    """Names of a module's constants."""
    for node in tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for name in (n for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)):
            if name.id.strip("_").isupper():
                yield name.id.strip("_")


def private_words(tree: ast.AST, room: str) -> set[str]:
    """Words of ours among the words of the identifiers that a file introduces."""
    found = set()
    for node in nodes_of(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            name = node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.arg):
            name = node.arg
        else:
            continue
        found |= PRIVATE_WORDS & words_of(name)
    return {word for word in found if room not in ALLOWED_WORDS.get(word, ())}


def concrete_classes(trees: list[ast.Module]) -> set[str]:
    """Names of classes of the package of which there can be instances: nothing abstract is left in them."""
    classes = {n.name: n for tree in trees for n in nodes_of(tree) if isinstance(n, ast.ClassDef)}
    return {
        name for name, node in classes.items() if not {"ABC", "Protocol"} & _bases(node) and not _left(name, classes)
    }


def _left(name: str, classes: dict[str, ast.ClassDef]) -> set[str]:
    """Abstract methods that a class has neither defined nor inherited defined."""
    methods = [n for n in classes[name].body if isinstance(n, ast.FunctionDef)]
    abstract = {m.name for m in methods if any("abstractmethod" in ast.unparse(d) for d in m.decorator_list)}
    inherited = set().union(*(_left(base, classes) for base in _bases(classes[name]) if base in classes))
    return abstract | (inherited - {m.name for m in methods})


def _bases(node: ast.ClassDef) -> set[str]:
    """Names of a class's bases, without their modules and type arguments."""
    return {ast.unparse(base).partition("[")[0].rpartition(".")[2] for base in node.bases}


def subclasses_of(tree: ast.AST, concrete: set[str]) -> Iterator[str]:
    """Classes whose base is a concrete class of the package."""
    return (n.name for n in nodes_of(tree) if isinstance(n, ast.ClassDef) and _bases(n) & concrete)


def repeated_classes(trees: list[ast.Module]) -> list[str]:
    """Names of public classes that stand more than once in the package and the studies."""
    names = [n.name for tree in trees for n in tree.body if isinstance(n, ast.ClassDef)]
    return sorted(name for name, count in Counter(names).items() if count > 1 and not name.startswith("_"))


def shorten(path: Path) -> None:
    """Take off the list what was mended; what only moved or was renamed keeps its place on it."""
    listed, now = yaml.safe_load(path.read_text()), {**offences()}
    for rule, who in now.items():
        new = [one for one in who if one not in listed.get(rule, [])]
        if len(who) > len(listed.get(rule, [])):
            print(f"{rule}: new are {new}; mend them")
            now[rule] = [one for one in who if one not in new]
    path.write_text(yaml.safe_dump(now, width=200))
    print({rule: len(who) for rule, who in now.items()})


if __name__ == "__main__":
    shorten(ROOT / "tests" / "offenders.yaml")
