"""The formats of pictures, known before matplotlib is imported, which is slow."""

from pathlib import Path

from stepdiag_ros.metrology.refusal import Refusal

PICTURE_FORMATS = ("png", "svg", "pdf")


def format_of(picture: Path) -> str:
    """Return the format of a picture by the ending of its path.

    Raises:
        Refusal: another ending than that of a picture.
    """
    ending = picture.suffix[1:]
    if ending not in PICTURE_FORMATS:
        *some, last = (f".{one}" for one in PICTURE_FORMATS)
        raise Refusal(
            f"{picture}: pictures are written as {', '.join(some)} or {last}", fault="unknown"
        )
    return ending
