"""Texts with quantities in them: Python's format strings, for lists too, and numbers that stay numbers."""

import re
from collections.abc import Mapping, Sequence
from string import Formatter
from typing import Any

import numpy as np

from manoeuvre_nn.core.errors import InputError

ALONE = re.compile(r"\{([^{}:!]+)\}")
"""A template that is nothing but one quantity."""


class _Joining(Formatter):
    """Python's own, but a list is formatted item by item and joined: by commas, or by ``/`` with ``{list:/.2g}``."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """A quantity as text."""
        if isinstance(value, Sequence) and not isinstance(value, str):
            slash = format_spec.startswith("/")
            return ("/" if slash else ", ").join(format(item, format_spec.lstrip("/")) for item in value)
        return str(format(value, format_spec))


def filled(template: Any, quantities: Mapping[str, Any], place: str) -> Any:
    """A template with its quantities.

    Args:
        template: ``{dev:.2g} L off``; ``{dev}`` alone gives the quantity itself; what is no text is left as it is.
        quantities: Name -> number, text, list or mapping; ``{table[Y_v]}`` takes an item of a mapping.
        place: Where the template stands, for messages.

    Returns:
        The text, or the quantity as a plain number, text or list.

    Raises:
        InputError: If there is no such quantity, or it cannot be written so.
    """
    if not isinstance(template, str):
        return template
    alone = ALONE.fullmatch(template)
    try:
        if alone:
            return _plain(_Joining().get_field(alone[1], (), quantities)[0])
        return _Joining().vformat(template, (), quantities)
    except (KeyError, IndexError, AttributeError) as error:
        raise InputError(f"{place}: {template!r}: there is no quantity {error}") from None
    except (ValueError, TypeError) as error:
        raise InputError(f"{place}: {template!r}: {error}") from None


def _plain(value: Any) -> Any:
    """Numbers of numpy and torch as Python's."""
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, np.floating | np.integer) or getattr(value, "ndim", None) == 0:
        return float(value)
    return value
