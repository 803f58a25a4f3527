"""Node processes started, followed and ended from the command line."""

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
