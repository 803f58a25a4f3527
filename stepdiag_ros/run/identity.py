"""The identity of a run, and names of files made from it."""

import hashlib
import re
import secrets
from datetime import datetime, timezone

_LONGEST = 100
"""Characters, so that endings and parts fit into the 255 bytes of a name on any file system."""
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that are devices on Windows, whatever their ending."""


def new_run_id() -> str:
    """Return a new identity: time of day (UTC) and a random part, fit for a file name."""
    return f"{datetime.now(timezone.utc):%Y%m%dT%H%M%SZ}-{secrets.token_hex(3)}"


def file_name_of(run_id: str) -> str:
    """Return a name for the files of a run, whatever its identity, which anybody may choose.

    An identity of ASCII letters, digits, ``.``, ``_`` and ``-`` that begins with a letter or digit
    stays as it is. Of any other the rest is replaced, and a part of its SHA-256 added, so that
    different runs keep different names. The result is not a path, no option of a command, no hidden
    file and no device.
    """
    name = re.sub("[^A-Za-z0-9._-]+", "_", run_id[:_LONGEST]).lstrip("._-")
    if name == run_id and name and not _RESERVED.fullmatch(name) and not name.endswith("."):
        return name
    digest = hashlib.sha256(run_id.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"run_{name.rstrip('.')}_{digest}" if name.rstrip(".") else f"run_{digest}"
