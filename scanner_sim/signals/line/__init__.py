"""Peaks: where the spot lies on the line, and how surely."""
