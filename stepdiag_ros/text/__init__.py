"""Text that crosses the border: read from outside, said to people, written for controls."""
