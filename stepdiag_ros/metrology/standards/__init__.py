"""Tests of machine tools as the standards write them: ISO 230-2, ISO 230-6, squareness, volume.

Deviations are actual less commanded positions, m. Names of parameters are those of the standards.
"""
