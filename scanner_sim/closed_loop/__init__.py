"""The second mode of operation: targets followed in a closed loop, and the poses of what carries them."""
