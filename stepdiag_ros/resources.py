"""Where the files beside the code lie: interface definitions and configuration."""

from importlib import resources
from pathlib import Path
from typing import Literal

Kind = Literal["msg", "srv", "action", "config"]


def directory(kind: Kind) -> Path:
    """Return the folder of definitions (``msg``, ``srv``, ``action``) or of ``config``.

    Looked for in an installed wheel, in a source tree, then in a ROS 2 share folder.

    Raises:
        FileNotFoundError: the package was installed without these files.
    """
    package = Path(str(resources.files("stepdiag_ros")))
    for candidate in (package / "share" / kind, package.parent / kind):
        if candidate.is_dir():
            return candidate
    try:
        from ament_index_python.packages import get_package_share_directory

        candidate = Path(get_package_share_directory("stepdiag_ros")) / kind
    except (ImportError, LookupError):
        candidate = package.parent / kind
    if not candidate.is_dir():
        raise FileNotFoundError(
            f"stepdiag_ros was installed without its '{kind}' files; "
            "install it again with pip or colcon"
        )
    return candidate
