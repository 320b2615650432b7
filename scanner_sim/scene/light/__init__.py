"""Where the light comes from: the Sun, the Earth, and the orbit that turns them."""
