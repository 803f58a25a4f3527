"""Physics and estimation of the step-diagonal measurement: numpy and scipy only.

Conventions: m, rad, s, degC, Pa, relative humidity 0..1; X, Y, Z right-handed; errors are motions
of the tool relative to the workpiece under their ISO 230-1 names; a reading grows when the
mirror moves along the beam.
"""
