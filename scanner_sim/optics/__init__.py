"""Optics: the laser beam, the two deflecting mirrors, the receiver and its filter."""
