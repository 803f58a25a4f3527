"""The nodes: parameters, topics and wiring, one node a module; what they do is done elsewhere."""
