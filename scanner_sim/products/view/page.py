"""The page of a result: its parts put together, so that it opens from the disk and asks for nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

from scanner_sim.foundation.errors import printable
from scanner_sim.products.page_template import page_template

_HERE = Path(__file__).parent
_SCRIPTS = ("common.js", "pace.js", "space.js", "frame.js", "plot.js")
_SCRIPTS_OF = {"scan": ("cloud.js", "voxel.js", "scan.js"), "track": ("track.js",)}


def page_of(data: dict[str, Any]) -> str:
    """Return the page of what :mod:`~scanner_sim.products.view.scan` or ``track`` made of a result.

    Data stand in it as JSON that no parser of HTML takes for anything else, and texts reach the page as texts alone.
    Its policy (Content Security Policy, level 3) lets these scripts run, which it knows by their hashes, and nothing
    else, and fetches nothing.
    """
    scripts = [_read("three/three.min.js"), "\n".join(_read(name) for name in _names(data["kind"]))]
    hashes = " ".join(f"'sha256-{_hash(script)}'" for script in scripts)
    return page_template(_HERE / "page.html").render(
        title=data["title"],
        kind=data["kind"],
        policy=f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data:",
        style=_read("page.css"),
        scripts=scripts,
        data=inert_json(data),
    )


def inert_json(data: dict[str, Any]) -> str:
    """Return JSON without a character that means anything to a parser of HTML; numbers that are none become null."""
    text = json.dumps(_plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _plain(value: Any) -> Any:
    """Return data as JSON can hold them: texts printable, floats that are no numbers as null."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return printable(value, lines=True) if isinstance(value, str) and len(value) < 10_000 else value


def _names(kind: str) -> tuple[str, ...]:
    return (*_SCRIPTS, *_SCRIPTS_OF[kind])


@cache
def _read(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


@cache
def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
