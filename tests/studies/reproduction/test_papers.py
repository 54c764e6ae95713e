"""Studies beside the package: each names its paper and the modules of its chapters; wrong ones are refused."""

import sys
import types

import pytest

import studies
from manoeuvre_nn.core.errors import InputError
from studies.reproduction.paper import paper_folders, read_paper

PAPERS = list(paper_folders())


@pytest.fixture
def place(monkeypatch, tmp_path):
    """The folder of one more study, with a module ``good``."""
    folder = tmp_path / "fake1996"
    folder.mkdir()
    (folder / "good.py").write_text("")
    monkeypatch.setattr(studies, "__path__", [*studies.__path__, str(tmp_path)])
    return folder


@pytest.mark.parametrize("paper", PAPERS)
def test_every_paper_names_itself_and_chapters_of_its_own_folder(paper):
    found = read_paper(paper)
    assert found.name == paper and found.title and found.source
    assert all(callable(found.chapter(number)) for number in found.chapters)


def test_there_are_the_papers_that_are_known():
    assert PAPERS == ["cepowski2007", "hess2000", "rajesh2009", "wang1996"]


@pytest.mark.parametrize(
    "content, told",
    [
        ("title: t", "expected title, source and chapters"),
        ("title: t\nsource: s\nchapters: 3", "expected title, source and chapters"),
        ("title: t\nsource: s\nchapters: {1: os.system}", "chapter 1: there is no module os.system in this folder"),
        ("title: t\nsource: s\nchapters: {1: ../wang1996/chapter3}", "there is no module ../wang1996/chapter3"),
        ("title: t\nsource: s\nchapters: {1: nope}", "there is no module nope in this folder"),
        ("title: t\nsource: s\nchapters: {1: good}\nmore: 1", "expected title, source and chapters"),
        ("title: {", "is no valid yaml"),
    ],
)
def test_a_study_that_is_not_as_it_should_be_is_refused_in_one_line(place, content, told):
    (place / "study.yaml").write_text(content)
    with pytest.raises(InputError, match="study.yaml") as refused:
        read_paper("fake1996")
    assert told in str(refused.value) and "\n" not in str(refused.value)


def test_a_module_without_a_chapter_is_refused(place, monkeypatch):
    (place / "empty.py").write_text("")
    monkeypatch.setitem(sys.modules, "studies.fake1996.empty", types.ModuleType("studies.fake1996.empty"))
    (place / "study.yaml").write_text("title: t\nsource: s\nchapters: {1: empty}")
    with pytest.raises(InputError, match="chapter 1: studies.fake1996.empty has no function chapter"):
        read_paper("fake1996").chapter("1")
