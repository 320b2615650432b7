"""Results as JSON."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(content: object, indent: int = 2) -> str:
    """Return plain data as JSON: numbers in full, null for what is not finite, letters as they are."""
    return json.dumps(_plain(content), indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: object) -> Any:
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
