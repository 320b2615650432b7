"""From colours for the eye to reflectance at the laser's wavelength, by an assumption that every result states."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files.file_meshes import Colour

MOST_PIXELS = 1 << 26
"""Pixels of a texture: 8192 × 8192."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue: ITU-R BT.709-6, item 3.2."""


def mean_reflectance(colour: Colour, scale: float) -> float:
    """Return the reflectance of a plain colour: scale × luminance."""
    return float(scale * np.dot(_LUMINANCE, colour.factor))


def reflectance_map(colour: Colour, scale: float, source: Path) -> NDArray[np.float32]:
    """Return the reflectance of a texture, shape (rows, columns), the upper row first.

    Notes
    -----
    ρ = scale · (0.2126 R + 0.7152 G + 0.0722 B) of linear red, green and blue, which are decoded from sRGB: c/12.92 up
    to c = 0.04045, else ((c + 0.055)/1.055)^2.4 (IEC 61966-2-1). Transparency is not used.

    Raises
    ------
    InputError
        If the image is no PNG or JPEG file, is broken, or has more than :data:`MOST_PIXELS` pixels.
    """
    shown = f"a texture of the mesh {str(source)!r}"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            # What the file says to be, out of two kinds: others have readers that are less well kept.
            picture = Image.open(io.BytesIO(colour.image or b""), formats=("PNG", "JPEG"))
            if picture.width * picture.height > MOST_PIXELS:
                raise InputError(
                    f"{shown} has {picture.width} × {picture.height} pixels; {MOST_PIXELS} are possible.",
                    remedy="Make it smaller.",
                )
            coded = np.asarray(picture.convert("RGB"), dtype=np.float32) / np.float32(255.0)
    except InputError:
        raise
    except Exception:  # Pillow's readers raise of everything
        raise InputError(f"{shown} is no PNG or JPEG file that can be read.", remedy="Convert it.") from None
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    weights = scale * np.array(_LUMINANCE) * np.array(colour.factor)
    return np.ascontiguousarray(np.clip(linear @ weights, 0.0, 1.0), dtype=np.float32)
