"""Physical constants (SI, exact by definition: BIPM, *The International System of Units*, 9th ed., 2019)."""

from __future__ import annotations

from typing import Final

SPEED_OF_LIGHT: Final = 299_792_458.0
"""Speed of light in vacuum [m/s]."""

PLANCK: Final = 6.626_070_15e-34
"""Planck constant [J s]."""
