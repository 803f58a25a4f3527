"""The course of a run, without ROS: its sequence of commands, the watch over nodes, its time."""
