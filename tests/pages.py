"""What every page must have."""

import json
import re
from html.parser import HTMLParser
from typing import Any


class Scripts(HTMLParser):
    """Scripts of a page, apart: those that run, and the data."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.run: list[str] = []
        self.data: list[Any] = []
        self._into: str | None = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self._into = dict(attrs).get("type", "run") if tag == "script" else None

    def handle_data(self, data):
        if self._into == "run":
            self.run.append(data)
        elif self._into:
            self.data.append(json.loads(data))

    def handle_endtag(self, tag):
        self._into = None


def unexplained(page: str) -> set[str]:
    """Headings of columns that nothing on the page explains."""
    return set(re.findall(r'<th scope="col"(?: class="number")?>([^<]*)</th>', page))
