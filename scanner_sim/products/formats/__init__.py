"""Results as other programs read them: LAS and LAZ, E57, PCD, bags of ROS 2."""
