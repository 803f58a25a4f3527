"""The commands of ``stepdiag``, one a module.

Each module has ``add_parser(subparsers)``, which adds its arguments and sets ``run`` as their
default, and ``run(arguments) -> int``, which returns the exit code. What is slow to import is
imported in ``run``.
"""
