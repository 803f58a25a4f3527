"""Measurement uncertainty by the GUM (JCGM 100), checked by Monte Carlo (JCGM 101)."""
