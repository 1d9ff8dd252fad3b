"""contactwrench as a ROS 2 node; everything but `node` is plain Python, without ROS."""
