"""Light of Sun and Earth on the pixels of a camera."""
