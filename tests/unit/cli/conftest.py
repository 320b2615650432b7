"""What commands print, caught before it is laid out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], list[Any]]:
    """Return what catches all that a module tells, tables, rows, lines and warnings, in its order, in the list that
    comes back."""

    def catch(module: Any) -> list[Any]:
        found: list[Any] = []
        for name in ("print_rows", "print_table", "warn"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, lambda what, **_: found.append(what))
        if hasattr(module, "typer"):
            monkeypatch.setattr(module.typer, "echo", lambda text="", **_: found.append(text))
        return found

    return catch
