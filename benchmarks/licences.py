"""Write docs/licences.md: under which licence each package is that an installation brings, as its metadata say.

    python benchmarks/licences.py

It tells what is installed where it runs: install constraints.txt first.
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
RECIPROCAL = re.compile(r"GPL|GNU|MPL|Mozilla|EUPL|CDDL|Eclipse|EPL|CeCILL|\bSSPL|CC-BY-(SA|NC)", re.IGNORECASE)
"""Licences that ask something of those who pass on what is made with the work, not of the work alone."""
HARMLESS = {
    "certifi": "MPL-2.0 holds for changed copies of its own files; it is used as it is, by notebooks in the site",
    "hypothesis": "MPL-2.0 holds for changed copies of its own files; it is used as it is, by tests alone",
    "tqdm": "MPL-2.0 holds for changed copies of its own files; it is used as it is",
    "pathspec": "MPL-2.0 holds for changed copies of its own files; it is used as it is, by mkdocs alone",
}
"""Package under such a licence -> why it may be installed beside a package under MIT."""
SILENT = {"fmpy": "BSD-2-Clause"}
"""Package whose metadata name no licence -> which its LICENSE.txt is."""
INTRODUCTION = """# Licences

This package is under MIT. Its wheel holds its own files and one other: the basic bundle of plotly.js 4.1.1, under MIT
with its notice, which every page with figures to zoom carries on. What it needs is installed beside it from where its
authors publish it. Whoever passes on an environment or an image with all of that passes on these packages too, under
their licences. They are listed as the metadata of the packages say, of the versions of `constraints.txt`;
`python benchmarks/licences.py` writes this page.

Wheels of compiled packages carry further libraries, whose licences lie in each wheel's `dist-info`. Those of numpy and
scipy carry libgfortran, which is under GPL 3 with GCC's exception for programs that use it. A CUDA build of torch
brings NVIDIA's libraries, which are not free software.
"""


def needed(*extras: str) -> dict[str, Distribution]:
    """Installed packages that the package needs, directly or through others.

    Args:
        *extras: Extras of the package that are wanted too.

    Returns:
        Normalised name -> distribution. PackageNotFoundError is raised if one is not installed.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    own, offered = canonicalize_name(project["name"]), {"": project["dependencies"], **project["optional-dependencies"]}
    left = [Requirement(f"{own}[{','.join(extras)}]")]
    wanted: dict[str, set[str]] = {}
    found: dict[str, Distribution] = {}
    while left:
        requirement = left.pop()
        name = canonicalize_name(requirement.name)
        new = {"", *requirement.extras} - wanted.get(name, set())
        wanted[name] = wanted.get(name, set()) | new
        if name == own:
            left += [Requirement(text) for extra in new for text in offered[extra]]
        elif new:
            found[name] = part = distribution(name)
            further = map(Requirement, part.requires or [])
            left += [r for r in further if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in new)]
    return found


def licence(package: Distribution) -> str:
    """A package's licence as its metadata say: an SPDX expression, else a short name, else its classifiers.

    Args:
        package: The package.

    Returns:
        The licence; empty if the metadata are silent.
    """
    said = package.metadata
    name = " ".join((said.get("License") or "").split())
    classes = [c.rpartition(" :: ")[2] for c in said.get_all("Classifier", []) if c.startswith("License ::")]
    whole_text = name == "UNKNOWN" or len(name) > 40
    known = SILENT.get(canonicalize_name(said["Name"]), "")
    return said.get("License-Expression") or ("" if whole_text else name) or ", ".join(classes) or known


def page() -> str:
    """The page."""
    own = needed()
    of_tests = {name: part for name, part in needed("test").items() if name not in own}
    parts = [INTRODUCTION]
    for heading, packages in (("What the package needs", own), ("What its tests need beside", of_tests)):
        cells = [(name, Version(part.version).public, licence(part)) for name, part in sorted(packages.items())]
        rows = [f"| {' | '.join(row)} |" for row in cells]
        parts.append("\n".join([f"## {heading}\n", "| package | version | licence |", "|---|---|---|", *rows, ""]))
    noted = [f"- {name}: {why}." for name, why in sorted(HARMLESS.items()) if name in own | of_tests]
    return "\n".join([*parts, "## Remarks\n", *noted, ""])


def main() -> int:
    """Write the page; the exit code is 1 if a package needs a remark or says no licence."""
    try:
        everything = needed("test")
    except PackageNotFoundError as missing:
        print(f'error: {missing.name} is not installed: pip install -c constraints.txt -e ".[test]"', file=sys.stderr)
        return 2
    silent = [name for name, part in everything.items() if not licence(part)]
    reciprocal = [n for n, part in everything.items() if RECIPROCAL.search(licence(part)) and n not in HARMLESS]
    PAGE.write_text(page())
    print(f"{PAGE.relative_to(ROOT)}: {len(everything)} packages; no licence said: {silent}; to judge: {reciprocal}")
    return int(bool(silent or reciprocal))


if __name__ == "__main__":
    sys.exit(main())
