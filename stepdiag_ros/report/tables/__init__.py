"""Tables for a terminal, and what a command prints around them."""
