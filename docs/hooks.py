"""What the site needs beside the Markdown of this folder: equations, notebooks, and pages that stand elsewhere.

The Markdown is written to be read where it lies. ``math`` blocks become MathML, which browsers show by themselves.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(\]\()([^)\s#:]+)(#[^)\s]*)?(?=\))")
ROLE = re.compile(r":(?:attr|class|func|meth|mod):<code>~?([\w.]+)</code>")
FETCHED = re.compile(r"<(?:script|img|link|iframe|source)\b[^>]*\b(?:src|href)=[\"']?(?:https?:)?//[^>]*")
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def on_config(config: MkDocsConfig) -> None:
    """Let blocks of ``math`` become equations."""
    fence = {"name": "math", "class": "math", "format": _equation}
    config.mdx_configs.setdefault("pymdownx.superfences", {})["custom_fences"] = [fence]


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the pages that stand elsewhere in the repository."""
    for path in [ROOT / "SECURITY.md", *sorted((ROOT / "studies").rglob("README.md"))]:
        files.append(File.generated(config, _page_of(path), content=path.read_text()))
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text, pictures = MarkdownExporter().from_filename(str(path))
        for name, content in pictures["outputs"].items():
            files.append(File.generated(config, f"notebooks/{path.stem}/{name}", content=content))
        text = COLOUR.sub("", re.sub(r"(!\[\w*\]\()(?=output_)", rf"\g<1>{path.stem}/", text))
        files.append(File.generated(config, _page_of(path), content=text))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead from page to page, whatever folder of the repository these stand in."""
    here = page.file.src_uri if page.file.generated_by else f"docs/{page.file.src_uri}"

    def led(match: re.Match[str]) -> str:
        there = posixpath.normpath(posixpath.join(posixpath.dirname(here), match[2]))
        inside = there.removeprefix("docs/").replace(".ipynb", ".md")
        return match[1] + posixpath.relpath(inside, posixpath.dirname(page.file.src_uri) or ".") + (match[3] or "")

    return LINK.sub(led, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show names in docstrings by their last part, as Sphinx does."""
    return ROLE.sub(lambda match: f"<code>{match[1].rpartition('.')[2]}</code>", html)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> None:
    """Refuse a page that would fetch something from elsewhere.

    Raises:
        PluginError: If there is something.
    """
    fetched = FETCHED.search(output)
    if fetched:
        raise PluginError(f"{page.file.src_uri} would fetch {fetched[0]}: the site must open without a network")


def _page_of(path: Path) -> str:
    """Page of the site of a file of the repository."""
    return path.relative_to(ROOT).with_suffix(".md").as_posix()


def _equation(source: str, *_: Any, **__: Any) -> str:
    """A block of LaTeX as MathML; aligned lines become a table, which site.css aligns."""
    shown = convert(source.replace("{aligned}", "{align*}"), display="block")
    return f'<div class="equation">{shown}</div>'
