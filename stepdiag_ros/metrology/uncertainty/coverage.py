"""How expanded uncertainties are made of standard uncertainties."""

COVERAGE_FACTOR = 1.96
"""U = 1.96 u holds the true value with a probability of 95 % (normal distribution)."""
