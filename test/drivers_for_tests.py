"""Drivers of a test, brought as another package brings its own: by entry points."""

from importlib.metadata import EntryPoint, EntryPoints

from stepdiag_ros import devices


def bring_drivers(monkeypatch, *entries):
    """Let a package bring drivers, instead of those that are installed.

    Args:
        monkeypatch: of the test.
        entries: group without ``stepdiag_ros.``, name of the driver, ``module:function``.
    """
    points = EntryPoints(
        EntryPoint(name, place, f"stepdiag_ros.{kind}") for kind, name, place in entries
    )
    monkeypatch.setattr(devices, "entry_points", points.select)
