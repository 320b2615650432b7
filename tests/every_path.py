"""A small scenario that takes every path through an imaging program, for tests of its bytes."""

from __future__ import annotations

CONFIG = "lighting_full_shadow.yaml"
CHANGES = [
    "scan.rows=16",
    "scan.columns=24",
    "scan.horizontal=[-10 deg, 10 deg]",
    "scan.vertical=[-9 deg, 9 deg]",
    "ranging=both",
    "transport.bounces=2",
    "transport.background_samples=2",
    "transport.background_bounces=2",
]
"""Relief, edges, two bounces, sunlight and both ways of ranging."""
