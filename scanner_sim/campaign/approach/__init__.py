"""An approach: a campaign along a trajectory, under the light of its orbit, whose runs are tries of a pose."""
