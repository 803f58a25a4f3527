"""The identity of a run."""

import secrets
from datetime import datetime, timezone


def new_run_id() -> str:
    """Return a new identity: time of day (UTC) and a random part, fit for a file name."""
    return f"{datetime.now(timezone.utc):%Y%m%dT%H%M%SZ}-{secrets.token_hex(3)}"
