"""Reference problems with known answers, drawn at random, and a record of how they were solved.

In the spirit of PTB's TraCIM: whoever relies on a result can have the software tested where it is
installed. The problems come from a simulation of their own (``bodies``), which shares no formula
with ``metrology.forward``; a wrong sign there would not cancel here.
"""
