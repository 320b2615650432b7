"""Self-calibration: from sightings of boards to the parameters of the instrument, with their covariance."""
