"""The ROS floor: one file a node."""
