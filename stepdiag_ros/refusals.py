"""How a refusal reads: one sentence, whatever kind of error it comes from."""

PREFIX = "stepdiag: error: "
"""In front of the sentence with which the command line or a node ends."""
LONGEST = 1500
"""Characters of a sentence; one that is longer quotes something that is no part of it."""


def sentence(error: Exception) -> str:
    """Say in one line what is wrong; an operating system's error begins with the file."""
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename is not None else ""
        return f"{where}{error.strerror[:1].lower()}{error.strerror[1:]}"
    words = printable(" ".join(str(error).split())) or type(error).__name__
    return words if len(words) <= LONGEST else f"{words[:LONGEST]} …"


def printable(text: str) -> str:
    """Return a text that no terminal takes for a command; what a file holds may be quoted in it."""
    return "".join(
        one if one.isprintable() or one == "\n" else "\N{REPLACEMENT CHARACTER}" for one in text
    )
