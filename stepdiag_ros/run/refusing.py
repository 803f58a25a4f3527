"""What is refused because of the state that a run is in."""

from enum import IntEnum

from stepdiag_ros.metrology.refusal import Refusal


def in_wrong_state(request: str, state: IntEnum) -> Refusal:
    """Return the refusal of a request, such as ``resume``, that the state does not allow."""
    what = state.name.lower().replace("_", " ")
    words = f"cannot {request}: the run is {what}"
    return Refusal(words, fault="not_ready", aspect=request)
