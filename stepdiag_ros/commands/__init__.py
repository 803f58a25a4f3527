"""The commands of ``stepdiag``, one a module, found by the ``COMMAND`` that it holds.

``run(arguments) -> int`` returns the exit code. What is slow to import is imported there. Options
that several commands have are declared in ``arguments.COMMON`` and taken by name.
"""
