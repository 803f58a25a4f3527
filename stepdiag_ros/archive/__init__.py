"""An archive of bags: a folder, or a place in a store, with a catalogue of what the bags show.

The catalogue is Parquet, made of the bags alone, and can be made again from them at any time. Bags
and parts of the catalogue are named by their content and never change, so that any number of
computers may add at once.
"""

from importlib.util import find_spec

from stepdiag_ros.metrology.refusal import Refusal

_LIBRARIES = ("pyarrow", "duckdb", "fsspec", "distributed")


def require_libraries() -> None:
    """Refuse to go on where a library of the extra ``archive`` is missing.

    Raises:
        ValueError: names what is missing, and what to install.
    """
    missing = [name for name in _LIBRARIES if find_spec(name) is None]
    if missing:
        raise Refusal(
            f"an archive needs {', '.join(missing)}, which is not installed: pip install"
            " 'stepdiag_ros[archive]'",
            fault="not_installed",
            about=missing[0],
        )
