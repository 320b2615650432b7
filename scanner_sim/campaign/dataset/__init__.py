"""Data sets for learning, made of the runs that a campaign has kept."""
