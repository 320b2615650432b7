"""The light of the laser: beamlets, what they meet, and where their light falls on pixels or in time."""
