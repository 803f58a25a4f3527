"""The files inside a bag, back onto the disk: byte for byte what was attached."""

from pathlib import Path, PurePosixPath

from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.header import Attachment


def write_attachments(
    bag: str | Path, folder: str | Path, *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write every attachment of a bag as a file, under its name in the bag.

    Args:
        bag: the bag.
        folder: where the files go; made if it is not there.
        overwrite: replace files that exist.

    Returns:
        the files.

    Raises:
        BagError: the bag cannot be read, a file exists, or an attachment's name leads out of the
            folder.
        BagWriteError: a file cannot be written.
    """
    folder = Path(folder)
    with open_bag(bag) as opened:
        files = [(folder / _inside(opened.path, found), found) for found in opened.attachments]
    for path, _ in files:
        if path.exists() and not overwrite:
            raise BagError(f"{path} exists already; choose another folder or allow overwriting")
    try:
        for path, found in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_name(f".{path.name}.partial")
            try:
                partial.write_bytes(found.data)
                partial.replace(path)
            finally:
                partial.unlink(missing_ok=True)
    except OSError as error:
        raise BagWriteError(f"{folder} cannot be written: {error.strerror}") from error
    return tuple(path for path, _ in files)


def _inside(bag: Path, attachment: Attachment) -> PurePosixPath:
    """Return the name as a path that stays in the folder: a bag may come from anywhere."""
    name = PurePosixPath(attachment.name.replace("\\", "/"))
    if name.is_absolute() or not name.parts or ".." in name.parts or "\0" in attachment.name:
        raise BagError(
            f"{bag}: the attachment '{attachment.name}' has a name that is not a file name",
            fault="malformed",
        )
    return name
