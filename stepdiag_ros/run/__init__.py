"""Logic of a run, without ROS: its sequence of commands, the supervision of nodes, its time."""
