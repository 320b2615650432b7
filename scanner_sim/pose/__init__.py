"""Pose: from the angles and ranges of surveyed targets to the position and attitude of their object.

The door is :func:`scanner_sim.pose.estimate.estimate_pose`. Positions are metres in the scanner frame, rotations
``scanner_from_object``; a covariance is that of the six numbers (translation of the object's origin, rotation
vector), both along the scanner's axes: see :mod:`scanner_sim.pose.transforms`.

Inside, the batch is the last axis of every array, so that each step of the adjustment is one pass over many poses.
"""
