"""Scenes and meshes from files: read, checked against what is allowed, and built."""
