"""Scanning: where the beam points, and when."""
