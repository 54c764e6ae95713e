"""Words from files of others: what a terminal, a page or a path would obey is taken out or refused."""

import re
from collections.abc import Sequence

from manoeuvre_nn.core.errors import InputError

OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that are no letters: what moves a cursor, colours, rings, turns the order of letters round, or is half of
a letter. The tab and the end of a line are none of them."""
MAX_NAME = 150
"""Letters of a name; with an ending it must fit the 255 bytes of a file's name."""

LISTED, MOST_LISTED = 25, 20
"""Letters of a name, and names, that an error lists."""


def harmless(text: str) -> str:
    r"""A text that can be shown anywhere: what would be obeyed stands as ``\x1b`` instead."""
    return OBEYED.sub(lambda found: repr(found[0])[1:-1], text)


def listed(names: Sequence[str]) -> str:
    """Names for a line of an error: the first 20, each up to 25 letters, and how many more there are."""
    shown = [name if len(name) <= LISTED else f"{name[: LISTED - 3]}..." for name in names[:MOST_LISTED]]
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return (", ".join(shown) or "none") + more


def check_name(what: str, name: object) -> str:
    r"""Read a name that files are called after.

    Args:
        what: What it is the name of, for the message.
        name: What was given.

    Returns:
        The name.

    Raises:
        InputError: If it is no word, or would lead to another folder: it holds ``/`` or ``\``, or begins with a dot.
    """
    good = isinstance(name, str) and 0 < len(name) <= MAX_NAME and name.strip() == name and not name.startswith(".")
    if not good or OBEYED.search(str(name)) or re.search(r"[/\\\n\t]", str(name)):
        raise InputError(
            f"{what} {harmless(repr(name))[:80]} is no plain name; write one of up to {MAX_NAME} letters, such as r01, "
            "without strokes and not beginning with a dot"
        )
    return str(name)


def as_file_name(text: str) -> str:
    r"""A text as a part of a file's name: a blank, ``/``, ``\`` and what would be obeyed become ``_``."""
    return re.sub(r"[/\\\s]", "_", OBEYED.sub("_", text))
