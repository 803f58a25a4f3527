"""Laser step-diagonal measurement of machine tools on ROS 2 nodes.

Importing the package makes ``import rclpy`` and the message packages work on machines without ROS
2,
by the client in ``stepdiag_ros.embedded``; a sourced ROS 2 always wins.
"""

from stepdiag_ros.embedded import activate

__version__ = "0.1.0"

activate()
