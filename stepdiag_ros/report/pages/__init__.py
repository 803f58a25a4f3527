"""The report of a measurement that is handed to a customer: HTML, PDF and JSON of one material.

``material`` gathers what the other packages find out about a run; ``sections`` says in which order
and words it is told, one section a module; ``page`` and ``pdf`` turn sections into files. Nothing
is computed here.
"""
