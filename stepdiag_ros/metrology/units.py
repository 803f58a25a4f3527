"""Factors between SI and the units that people and files use, each with one meaning.

A value in SI times ``IN_MICRO`` is the number of micrometres or microradians; a number of
micrometres times ``MICRO`` is the value in SI. (A division would differ in the last bit.)
"""

MILLI = 1e-3
MICRO = 1e-6
NANO = 1e-9
IN_MILLI = 1e3
IN_MICRO = 1e6
NANOSECONDS = 1_000_000_000
"""In a second; times are whole numbers of them."""
