"""Products: what is written for people and for other programs."""
