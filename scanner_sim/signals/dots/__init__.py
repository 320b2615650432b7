"""Black dots on white in the frames of a camera: found, and fitted for their centres with their σ."""
