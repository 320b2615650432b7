"""Tables of pages, for tests of what they say."""

from __future__ import annotations

import re


def cells(page: str) -> list[list[str]]:
    """Return the texts of the cells of a page's rows."""
    rows = re.findall(r"<tr>(.*?)</tr>", page)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]
