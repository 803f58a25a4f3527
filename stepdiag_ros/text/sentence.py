"""How a refusal reads: one sentence, whatever kind of error it comes from."""

from stepdiag_ros.text.controls import one_line

PREFIX = "stepdiag: error: "
"""In front of the sentence with which the command line or a node ends."""
LONGEST = 1500
"""Characters of a sentence; one that is longer quotes something that is not part of it."""


def sentence(error: Exception) -> str:
    """Say in one line what is wrong; an operating system's error begins with the file."""
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename is not None else ""
        return f"{where}{error.strerror[:1].lower()}{error.strerror[1:]}"
    words = one_line(str(error)) or type(error).__name__
    # What a file holds may be quoted; nobody is to read pages of it.
    return words if len(words) <= LONGEST else f"{words[:LONGEST]} …"
