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
    words = " ".join(str(error).split()) or type(error).__name__
    # What a file holds may be quoted: no terminal is to execute it, and nobody to read pages of it.
    shown = "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in words)
    return shown if len(shown) <= LONGEST else f"{shown[:LONGEST]} …"
