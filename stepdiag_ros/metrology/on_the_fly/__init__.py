"""Lines measured while the axes move: from readings and positions of a pass to its nodes."""
