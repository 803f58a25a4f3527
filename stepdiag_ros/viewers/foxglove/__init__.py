"""What a Foxglove viewer is served over a WebSocket, live or from a bag; no ROS client here."""
