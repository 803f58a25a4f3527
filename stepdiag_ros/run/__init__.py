"""What makes a run, without ROS: the sequence of commands, the watch over nodes, the processes."""
