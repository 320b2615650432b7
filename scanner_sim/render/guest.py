"""Being a guest: what a public function changes in the process that calls it, it gives back.

Mitsuba's variant, Dr.Jit's threads and default backend, and the environment variable that names LLVM are settings of
the whole process. Arrays of another variant stay valid throughout: the variant says only what new ones are.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any, NamedTuple

import drjit as dr
import drjit.auto
import mitsuba as mi

from scanner_sim.render.libraries import LLVM_VARIABLE


class _Settings(NamedTuple):
    """Settings of the process; variant and backend are None until somebody chooses one."""

    variant: str | None
    backend: Any
    threads: int


_found: list[tuple[str | None, _Settings]] = []
"""What the guests that are at work found when they came, the first of them first: name of LLVM, and settings."""


@contextlib.contextmanager
def guest() -> Iterator[None]:
    """Give back what the work within has changed; may decorate a function.

    Guests within a guest give nothing back: its work goes on under the settings that they chose. A process that had
    chosen no variant keeps ours: Mitsuba cannot go back to none.
    """
    _found.append((os.environ.get(LLVM_VARIABLE), _settings()))
    try:
        yield
    finally:
        environment, before = _found.pop()
        if not _found:
            _restore(before)
            if environment is None:
                os.environ.pop(LLVM_VARIABLE, None)
            else:
                os.environ[LLVM_VARIABLE] = environment


class Stay:
    """Settings under which something was begun, to be taken up again whenever it goes on."""

    def __init__(self) -> None:
        self._settings = _settings()

    @contextlib.contextmanager
    def resume(self) -> Iterator[None]:
        """Work on under these settings, and give back what the host has chosen since."""
        if _settings() == self._settings:
            # Nothing to change, and nothing to give back.
            yield
            return
        with guest():
            _restore(self._settings)
            yield


def _settings() -> _Settings:
    variant = mi.variant()
    backend = None if variant is None else dr.backend_v(drjit.auto.Float)
    return _Settings(variant, backend, dr.thread_count())


def _restore(settings: _Settings) -> None:
    now = _settings()
    if settings.variant is not None and settings.variant != now.variant:
        mi.set_variant(settings.variant)
    if settings.backend is not None and settings.backend != now.backend:
        dr.set_backend(settings.backend)
    if settings.threads != now.threads:
        dr.set_thread_count(settings.threads)
