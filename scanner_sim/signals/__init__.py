"""Signals: from the digital line of the sensor to the position of the peak and its σ."""
