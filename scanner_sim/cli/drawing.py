"""Pictures that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path

from scanner_sim.errors import InputError


def drawn(path: Path, draw: Callable[[Path], None]) -> Path:
    """Draw a picture beside its place and move it there; return the path.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    unfinished = path.with_name(f".{secrets.token_hex(4)}.partial.png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw(unfinished)
        os.replace(unfinished, path)
    except PermissionError as error:
        raise InputError(
            f"{path.parent} cannot be written to: {error.strerror}.", remedy="Choose another folder with -o."
        ) from None
    finally:
        unfinished.unlink(missing_ok=True)
    return path
