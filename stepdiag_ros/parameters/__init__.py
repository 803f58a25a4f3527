"""Parameters of nodes: declared once, with unit, bounds and description."""
