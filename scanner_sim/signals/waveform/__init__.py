"""Delays: when the echo comes, and how surely."""
