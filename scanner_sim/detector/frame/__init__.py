"""The video camera: its settings, and how light becomes the numbers of a frame."""
