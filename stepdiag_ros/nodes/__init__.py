"""The nodes: parameters, topics and wiring, one node a module; what they do is done elsewhere."""

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
