"""How long tests wait for what must come."""

PATIENCE = 300.0
"""Real seconds. Only a fault uses them up, however busy the computer is: tests wait for conditions.

Where a test asserts that something happens within some seconds, it says why.
"""
