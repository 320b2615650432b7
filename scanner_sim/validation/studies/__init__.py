"""Studies of an instrument: its errors, its estimators, its poses, its light along an orbit."""
