"""Catalogue of effects: every module here is one effect; packages may add theirs by entry point."""

from stepdiag_ros.metrology.effects.catalogue import ENTRY_POINTS, catalogue

__all__ = ["ENTRY_POINTS", "catalogue"]
