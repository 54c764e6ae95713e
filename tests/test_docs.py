"""What README and docs say holds: links lead somewhere, commands know their settings, Python runs, names exist."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import torch
from fleet import unchecked

from manoeuvre_nn.commands import import_recording
from manoeuvre_nn.commands.config import chosen_effects, training_manoeuvres
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.job import blank_network
from manoeuvre_nn.commands.main import OF_FILES, task_of, with_folder
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.ship.mariner import mariner

ROOT = Path(__file__).parents[1]
LAUNCHERS = {"hydra/launcher=slurm": "submitit", "hydra/launcher=ray_cluster": "ray"}
"""Choice of a launcher -> what it needs."""
PAGES = [ROOT / "README.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").rglob("*.md"))]
PYTHON = re.compile(r"(<!-- run(?: slow)? -->\n)?```python\n(.*?)```", re.DOTALL)
OWN_FILE = re.compile(r"```(?:python|yaml)\n((?:# @package [^\n]*\n)?# mine/([\w/]+\.(?:py|yaml)).*?)```", re.DOTALL)
"""A block that is a file of the reader's own folder ``mine``, and its path there."""
LINK = re.compile(r"\]\(([^)\s]+)\)")
COMMAND = re.compile(r"\s*(?:python (?:scripts/)?(\w+)\.py|manoeuvre (\w+)) ([\w'-].*)")
SCRIPTS = {"check_recordings": "check", "import_recording": "import"}
"""Script -> command, where their names differ from each other."""
WALKS = re.split(r"^## ", (ROOT / "docs" / "architecture.md").read_text(), flags=re.MULTILINE)
STEPS = [
    pytest.param(step, id=f"{part[:6].lower()} step {number}")
    for part in WALKS
    if part.startswith("Walk ")
    for number, step in enumerate(re.split(r"^\d+\. ", part, flags=re.MULTILINE)[1:], 1)
]


def blocks(mark: str) -> list:
    """Blocks of Python that follow a mark; all of them where it is empty."""
    found = [(page, *match.groups(default="")) for page in PAGES for match in PYTHON.finditer(page.read_text())]
    return [pytest.param(code, id=f"{page.name} {k}") for k, (page, m, code) in enumerate(found) if mark in m]


def commands() -> list:
    """Commands in blocks and in the text of pages and notebooks that have a config: name and words."""
    found = []
    for page in [*PAGES, *sorted((ROOT / "notebooks").glob("*.ipynb"))]:
        for line in quoted(written_in(page).replace("\\\n", " ")):
            words = COMMAND.match(line.rpartition("&& ")[2].partition("  #")[0])
            if words and "[...]" not in line:
                name = SCRIPTS.get(words[1], words[1]) or words[2]
                label = f"{page.name}: {line.strip()[:60]}"
                found.append(pytest.param(name, shlex.split(words[3], comments=True), id=label))
    return found


def written_in(page: Path) -> str:
    """The text of a page, of a notebook that of its cells."""
    text = page.read_text()
    return text if page.suffix == ".md" else "\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"])


def quoted(text: str) -> list[str]:
    """Lines of blocks: those between fences, and those set in by four blanks; commands with settings in the text."""
    inside, found = False, re.findall(r"`((?:manoeuvre|python) [^`\n]*=[^`\n]*)`", text)
    for line in text.splitlines():
        inside ^= line.startswith("```")
        if inside or line.startswith("    "):
            found.append(line)
    return found


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_to_a_file_and_a_heading(page):
    for target in LINK.findall(page.read_text()):
        if "://" not in target:
            path, _, anchor = target.partition("#")
            there = (page.parent / path).resolve() if path else page
            assert there.exists(), target
            assert not anchor or anchor in anchors(there), target


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_files_that_a_page_names_exist(page):
    for word in re.findall(r"`([\w/]+/\w+\.(?:py|yaml|ipynb))`", page.read_text()):
        if "mine" not in word:
            _path(word)


@pytest.mark.parametrize(("name", "words"), commands())
def test_a_command_of_the_pages_knows_its_settings(name, words):
    script = ROOT / ("" if name in {"train", "diagnose"} else "scripts") / f"{name}.py"
    if name == "import":
        import_recording.request(words)
    elif name in OF_FILES:  # of folders that the reader has
        assert all("=" not in word or word.startswith("out=") for word in words)
    elif any(word.startswith("config_dir=") for word in words):
        pytest.skip("needs a folder of the reader's own")
    elif name in {"train", "simulate", "diagnose", "check", "coefficients", "excite", "export"}:
        for plugin in (plugin for word, plugin in LAUNCHERS.items() if word in words):
            pytest.importorskip(plugin, reason="this launcher is an extra")
        words, config = task_of(with_folder(words, name), name)
        left_open = [word for word in words if word.endswith("...") or word in {"-m", "--help"}]
        several = [word for word in words if "," in word.partition("=")[2].partition("[")[0]]
        compose(config, [word for word in words if word not in (*left_open, *several)])
    else:
        assert script.is_file()


@pytest.mark.parametrize("code", blocks(""))
def test_a_block_of_python_compiles(code):
    compile(code, "README.md", "exec")


@pytest.mark.parametrize("code", blocks("run -->"))
def test_a_block_of_python_runs(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with unchecked():  # a person writes 120 where an annotation says float
        exec(compile(code, "README.md", "exec"), {})


@pytest.mark.slow
@pytest.mark.parametrize("code", blocks("run slow -->"))
def test_a_slow_block_of_python_runs(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with unchecked():  # a person writes 120 where an annotation says float
        exec(compile(code, "README.md", "exec"), {})


@pytest.fixture
def mine(tmp_path):
    """The reader's own folder as the pages write it."""
    for page in PAGES:
        for text, path in OWN_FILE.findall(page.read_text()):
            (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path).write_text(text)
    return tmp_path


def test_ships_and_an_effect_of_ones_own_are_built_as_the_pages_write_them(mine):
    cfg = compose("simulate", [f"config_dir={mine}", "plugins=[kite]", "ship=ferry", "effect=[kite]"])
    assert build(cfg.ship, "ship").name == "ferry"
    coaster = build(compose("simulate", [f"config_dir={mine}", "ship=coaster"]).ship, "ship")
    assert coaster.particulars.name == "coaster" and isinstance(coaster, Ship)
    (kite,) = chosen_effects(cfg.effect, mariner())
    assert kite.name == "kite" and float(kite.value("pull_kN")) == 100.0


def test_manoeuvres_of_ones_own_are_sailed_as_the_pages_write_them(mine):
    words = [f"config_dir={mine}", "plugins=[harder]", "ship=mariner", "manoeuvre=[zz7,harder]"]
    with unchecked():
        zigzag, turn = training_manoeuvres(compose("simulate", words).manoeuvre)
    assert zigzag.name == "zz7" and [round(np.degrees(stage.order)) for stage in turn.stages] == [10, 35]


@pytest.mark.parametrize(
    "page, words", [("README.md", "{} effects in all"), ("docs/glossary.md", "one of {} on the shelf")]
)
def test_a_page_counts_the_effects_that_there_are(page, words):
    there = {path.stem for path in (ROOT / "conf" / "effect").glob("*.yaml")} - {"formula", "remainder"}
    assert words.format(len(there)) in (ROOT / page).read_text()


def test_a_network_of_ones_own_is_built_as_the_pages_write_it(mine):
    words = [f"config_dir={mine}", "plugins=[deep]", "ship=mariner", "manoeuvre=zz35", "network=deep"]
    network, scaling, dtype = blank_network(compose("train", words))
    assert network(torch.zeros(5, 4, dtype=dtype)).shape == (5, 3) and scaling == "centred"


@pytest.mark.parametrize("step", STEPS)
def test_a_step_of_a_walk_names_what_exists(step):
    words = re.findall(r"`([^`]+)`", step)
    paths = [_path(word) for word in words if "/" in word]
    files = "\n".join(path.read_text() for path in paths if path.is_file())
    names = [word.partition("(")[0] for word in words if re.fullmatch(r"[A-Za-z_][\w.]*(\(.*\))?", word)]
    assert paths and names, "a step names a file and what it calls there"
    for part in (part for name in names for part in name.split(".")):
        assert re.search(rf"\b(def|class) {part}\b|^\s*{part}\b\s*[:=]", files, re.MULTILINE), f"{part} in {paths}"


def _path(word: str) -> Path:
    """A file that a walk names, from the top of the repository or of the package."""
    found = next((p for p in (ROOT / word, ROOT / "src" / "manoeuvre_nn" / word) if p.exists()), None)
    assert found is not None, word
    return found
