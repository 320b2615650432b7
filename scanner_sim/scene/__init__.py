"""What stands in front of the scanner: materials, targets and objects."""
