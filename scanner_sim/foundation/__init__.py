"""What every room stands on: units, errors, constants, frames, statuses, random streams, named files."""
