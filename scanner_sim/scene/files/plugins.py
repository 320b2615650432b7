"""Which plugins the renderer may load: those that came with it, and this package's own.

The renderer looks for ``plugins/NAME.so`` in every folder where it looks for files, and the working folder is the first
of them: a folder that somebody shares could bring code. So nothing is built but within :func:`installed_plugins_only`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import mitsuba as mi

from scanner_sim.foundation.errors import InputError

T = TypeVar("T")

OWN = frozenset({"retroreflector", "orbit_sky", "brown_camera"})
"""Plugins of this package, written in Python."""
SHAPE_LIST = "shape_list"
"""Plugin that only holds shapes, see :func:`register_shape_list`."""


@cache
def installed_plugins() -> frozenset[str]:
    """Return the names of the plugins that came with the renderer, and of this package's own."""
    return OWN | {path.stem for path in (_home() / "plugins").iterdir()} | {"scene"}


@contextmanager
def installed_plugins_only() -> Iterator[None]:
    """Keep the renderer from every folder but its own while it builds objects, and from saying more than errors."""
    renderer: Any = mi  # its type stubs lack the resolver
    before, level = renderer.file_resolver(), mi.log_level()
    own = renderer.FileResolver()
    own.clear()
    own.append(str(_home()))
    renderer.set_file_resolver(own)
    mi.set_log_level(mi.LogLevel.Error)
    try:
        yield
    finally:
        renderer.set_file_resolver(before)
        mi.set_log_level(level)


def build_plugin(description: Mapping[str, Any]) -> Any:
    """Build what ``mitsuba.load_dict`` builds from a description, with this package's own plugins within it.

    The renderer's own function asks for the kind of each plugin. It does not know ours in the variant that it asks for,
    and then takes a library of that name from the working folder.
    """
    with installed_plugins_only():
        return _build(description)


def once_per_variant(register: Callable[[], T]) -> Callable[[], T]:
    """Return a function that registers a plugin once in each of Mitsuba's variants: a plugin belongs to one."""
    registered = cache(lambda _: register())
    return wraps(register)(lambda: registered(str(mi.variant())))


def vectorised_only(plugin: str) -> None:
    """Refuse a variant that has no arrays of rays.

    Raises
    ------
    InputError
        In a scalar variant.
    """
    if str(mi.variant()).startswith("scalar"):
        raise InputError(
            f"{plugin} computes for arrays of rays, and the variant {mi.variant()} has none.",
            remedy="Set llvm_ad_mono or cuda_ad_mono.",
        )


@once_per_variant
def register_shape_list() -> None:
    """Make a plugin known to Mitsuba's present variant that holds the shapes of a file, as its ``shapes``.

    In its place a scene would sort all triangles for its rays, and the scene that the shapes go into does so again.
    """

    class ShapeList(mi.Texture):  # any kind that may be written in Python
        def __init__(self, settings: Any) -> None:
            super().__init__(settings)
            self.shapes = [part for _, part in settings.objects() if isinstance(part, mi.Shape)]

    mi.register_texture(SHAPE_LIST, ShapeList)


def _build(description: Mapping[str, Any]) -> Any:
    parts = {name: _build(part) if _holds_own(part) else part for name, part in description.items()}
    if parts["type"] not in OWN:
        return mi.load_dict(parts, optimize=False)
    settings = mi.Properties(parts.pop("type"))
    for name, part in parts.items():
        value = mi.load_dict(part) if isinstance(part, dict) else part
        settings[name] = mi.ScalarVector3d(value) if isinstance(value, list) else value
    return mi.PluginManager.instance().create_object(settings)


def _holds_own(part: Any) -> bool:
    """Return whether a description is one of this package's own plugins, or holds one."""
    return isinstance(part, dict) and (part.get("type") in OWN or any(map(_holds_own, part.values())))


def _home() -> Path:
    return Path(str(mi.__file__)).parent
