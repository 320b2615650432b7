"""Tables that code makes and pages hold between two marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def marked(maker: str, parts: Sequence[str]) -> str:
    """Return what stands on a page from the mark of what a program makes, named by its path, to that of its end."""
    begin, end = f"<!-- made by {maker} -->", f"<!-- end of what {maker} makes -->"
    return "\n\n".join((begin, *parts, end))


def rewrite(page: Path, made: str) -> None:
    """Put what was made in the place of what stands between its marks on a page."""
    begin, *_, end = made.splitlines()
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(begin)
    page.write_text(before + made + rest.split(end)[1], encoding="utf-8")


def rewrite_table(page: Path, maker: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Put a table in the place of the one that a program made before."""
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    rewrite(page, marked(maker, ("\n".join(lines),)))
