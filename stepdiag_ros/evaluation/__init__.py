"""From a recorded run to one result class for each question that is asked of it.

Assemble, solve, evaluate, diagnose, compare, compensate: commands, notebook, nodes, pages and
reports call these functions, and nothing else solves. Nothing here knows how a result is shown.
"""
