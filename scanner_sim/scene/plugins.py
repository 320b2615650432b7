"""Which plugins the renderer may load: those that came with it, and this package's own.

The renderer looks for ``plugins/NAME.so`` in every folder where it looks for files, and the working folder is the first
of them: a folder that somebody shares could bring code. So nothing is built but within :func:`installed_plugins_only`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import mitsuba as mi

OWN = frozenset({"retroreflector", "orbit_sky"})
"""Plugins of this package, written in Python."""


@cache
def installed_plugins() -> frozenset[str]:
    """Return the names of the plugins that came with the renderer, and of this package's own."""
    return OWN | {path.stem for path in (_home() / "plugins").iterdir()} | {"scene"}


@contextmanager
def installed_plugins_only() -> Iterator[None]:
    """Keep the renderer from every folder but its own while it builds objects."""
    renderer: Any = mi  # its type stubs lack the resolver
    before = renderer.file_resolver()
    own = renderer.FileResolver()
    own.clear()
    own.append(str(_home()))
    renderer.set_file_resolver(own)
    try:
        yield
    finally:
        renderer.set_file_resolver(before)


def _home() -> Path:
    return Path(str(mi.__file__)).parent
