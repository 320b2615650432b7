"""The line sensor of triangulation: exposure, noise and speckle."""
