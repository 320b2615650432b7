"""The light of Sun and Earth that the detectors see behind the spot."""
