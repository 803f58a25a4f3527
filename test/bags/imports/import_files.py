"""What the tests of imports share."""

from pathlib import Path

DATA = Path(__file__).parents[2] / "data" / "imports"
RTL = DATA / "made_up_axis.rtl"


def changed(path, old, new, tmp_path, count=1):
    """Write a copy of a file with one thing changed, and return it."""
    data = path.read_bytes()
    assert old.encode() in data
    copy = tmp_path / path.name
    copy.write_bytes(data.replace(old.encode(), new.encode(), count))
    return copy
