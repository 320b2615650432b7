"""Tracking: from the voxels of a pattern to the centre of a target, and from one pattern to the next."""
