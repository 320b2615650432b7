"""Results as bytes, to be compared."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def content(value: Any) -> Any:
    """Return a record as bytes and plain values."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: content(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple | list):
        return [content(one) for one in value]
    if isinstance(value, np.ndarray | np.generic | float):
        return np.asarray(value).shape, np.asarray(value).tobytes()
    return value
