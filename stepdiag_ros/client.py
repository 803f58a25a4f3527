"""Importing this makes ``import rclpy`` and the message packages work where no ROS 2 is sourced.

A sourced ROS 2 always wins; without one there is the client in ``stepdiag_ros.embedded``. Nodes and
sessions import it themselves. Import it before rclpy in a node of your own::

    import stepdiag_ros.client
    import rclpy
"""

from stepdiag_ros.embedded import activate

activate()
