"""Reference problems with known answers, drawn at random, and a record of how they were solved.

In the spirit of PTB's TraCIM: users who rely on a result can test the software where it
is installed. The problems come from a simulation of their own (``bodies``), which shares no formula
with ``metrology.forward``; a wrong sign there would not cancel here.
"""
