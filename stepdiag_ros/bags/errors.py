"""What can be wrong with a bag or a table, each in one sentence that says what to do."""

from stepdiag_ros.metrology.refusal import Refusal


class BagError(Refusal):
    """A bag cannot be read or written; the text names the file, the place and what to do."""


class BagCutError(BagError):
    """The file ends in the middle: its writer was stopped. ``stepdiag recover`` makes it whole."""


class BagCorruptError(BagError):
    """The file's bytes are not those that were written; the text names the offset."""


class BagWriteError(BagError):
    """Writing failed (disk full, medium gone). What was written before stays readable."""


class TableError(Refusal):
    """A run table is refused; the text names the file, the row and the reason."""
