"""The avalanche photodiode of time of flight: waveforms, noise and speckle."""
