"""One figure of a machine over years of runs: its level, trend, changes, and when it is too large.

Generalised least squares on numbers alone; where they come from, others know.
"""
