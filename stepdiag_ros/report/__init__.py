"""What a person sees of a measurement: tables for a terminal, pictures, JSON of the results.

``publish.publish`` is the one way from results to all three; every command uses it.
"""
