"""ROS messages and the data classes that they carry: here, and only here, one becomes the other.

No ROS client here: nodes and bags, embedded client and rclpy share these functions.
"""
