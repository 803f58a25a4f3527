"""How somebody ends a command that measures: with Ctrl-C, or with a request to end."""


class Terminated(KeyboardInterrupt):
    """Somebody asked the process to end (SIGTERM); handled as Ctrl-C is, until it has ended."""
