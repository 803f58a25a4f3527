"""Laser measurement of machine tools along step diagonals and linear axes, on ROS 2 nodes.

Nothing here needs ROS 2. ``import stepdiag_ros.client`` makes ``import rclpy`` and the message
packages work on machines without it.

For notebooks and scripts it offers ``open_run``, ``solve``, ``error_map``, ``worst_point``,
``diagnose``, ``compare`` (see ``stepdiag_ros.notebook``) and ``plots``; they are imported when they
are first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepdiag_ros.notebook import compare, diagnose, error_map, open_run, solve, worst_point

__version__ = "0.1.0"
__all__ = ["compare", "diagnose", "error_map", "open_run", "plots", "solve", "worst_point"]


def __getattr__(name: str) -> Any:
    """Return what is offered to notebooks, which is imported only now."""
    if name == "plots":
        return import_module("stepdiag_ros.plots")
    if name in __all__:
        return getattr(import_module("stepdiag_ros.notebook"), name)
    raise AttributeError(f"stepdiag_ros has no '{name}'")
