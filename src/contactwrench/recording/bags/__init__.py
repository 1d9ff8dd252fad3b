"""ROS bags, with no ROS."""
