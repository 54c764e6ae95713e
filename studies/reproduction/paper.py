"""The papers that can be done again: a folder of studies with a study.yaml, which names the modules of its chapters."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import studies
from manoeuvre_nn.core.data_files import load_yaml
from manoeuvre_nn.core.errors import InputError, check_choice
from studies.reproduction.section import Chapter

FILE = "study.yaml"
PARTS = {"title", "source", "chapters"}


@dataclass(frozen=True)
class Paper:
    """A paper that is done again.

    Attributes:
        name: Name of its folder: ``wang1996``.
        title: Title.
        source: Authors, year, place.
        chapters: Number of each chapter -> module of the folder that does it, in the paper's order.
    """

    name: str
    title: str
    source: str
    chapters: Mapping[str, str]

    def chapter(self, number: str) -> Chapter:
        """What does a chapter again.

        Args:
            number: Number of the chapter.

        Returns:
            The function ``chapter`` of its module.

        Raises:
            InputError: If the module has none.
        """
        module = import_module(f"studies.{self.name}.{self.chapters[number]}")
        found: Chapter | None = getattr(module, "chapter", None)
        if found is None:
            raise InputError(f"chapter {number}: {module.__name__} has no function chapter")
        return found


def paper_folders() -> dict[str, Path]:
    """Folders of studies that do a paper again.

    Returns:
        Name -> folder, by the alphabet.
    """
    found = [path.parent for place in studies.__path__ for path in Path(place).glob(f"*/{FILE}")]
    return {folder.name: folder for folder in sorted(found)}


def read_paper(name: str | None) -> Paper:
    """Read what a study says of its paper.

    Args:
        name: Name of its folder; None is refused with the names that there are.

    Returns:
        The paper.

    Raises:
        InputError: If there is no such study, or its yaml is not as it should be.
    """
    folders = paper_folders()
    if name is None:
        raise InputError(f"which paper? write {' or '.join(f'paper={known}' for known in folders)}")
    check_choice("paper", str(name), list(folders))
    folder = folders[str(name)]
    found = load_yaml(folder / FILE)
    chapters = found.get("chapters") if isinstance(found, Mapping) else None
    if not isinstance(chapters, Mapping) or set(found) != PARTS:
        raise InputError(f"{folder / FILE}: expected title, source and chapters (number: module)")
    for number, module in chapters.items():
        if not re.fullmatch(r"\w+", str(module)) or not (folder / f"{module}.py").is_file():
            raise InputError(f"{folder / FILE}: chapter {number}: there is no module {module} in this folder")
    names = {str(number): str(module) for number, module in chapters.items()}
    return Paper(folder.name, str(found["title"]), str(found["source"]), names)
