"""What is thought of before anything moves: duration, expected uncertainty, plans, NC programs."""
