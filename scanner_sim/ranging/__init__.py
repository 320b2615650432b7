"""Ranging: from peaks to ranges and coordinates, each with its σ."""
