"""Autotracking laser interferometer: lengths between a tracker and a reflector on the machine.

A station is the tracker's centre in machine coordinates: the place to which the machine would have
to go for the reflector's centre to meet it. So the reflector's offset from the tool need not be
known, and it makes no difference to a length which of the two is on the table and which on the
carriage. A length change is the present length less that where the counter was zeroed.

ATLI stands for Chen, Ho, Lee, Pan and Hsieh 2018 (Sensors and Materials 30, "Geometric error
measurement of machine tools using autotracking laser interferometer").
"""
