"""Tests of the ROS node on real rclpy, in an environment of their own: `make test-ros`."""
