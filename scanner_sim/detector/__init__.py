"""Detectors: from light to a digital signal, with every noise a real one has."""
