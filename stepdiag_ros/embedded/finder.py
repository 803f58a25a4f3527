"""Import hook: serves ``std_msgs.msg``, ``std_srvs.srv``, ``stepdiag_ros.msg`` … as modules.

The classes of a module are made when they are asked for, so an import costs next to nothing.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from .packages import OWN, is_served

#: Parts of the real rclpy which the embedded client does not have, with what to do instead.
_ABSENT = {
    "rclpy.action": "actions",
    "rclpy.lifecycle": "lifecycle nodes",
}


class InterfaceFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the modules of message packages; everything else is left to Python."""

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002 - Python's signature
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the spec of a message package or of its ``msg`` or ``srv`` module."""
        if fullname in _ABSENT:
            raise ModuleNotFoundError(
                f"The embedded ROS 2 client has no {_ABSENT[fullname]} ({fullname});"
                " source a ROS 2 installation to use them.",
                name=fullname,
            )
        package, _, kind = fullname.partition(".")
        if kind not in ("", "msg", "srv"):
            return None
        if not is_served(package) or (not kind and package == OWN):
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=not kind)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        """Return the module, which makes its classes when they are asked for."""
        package, _, kind = spec.name.partition(".")
        return _InterfaceModule(spec.name, package, kind) if kind else None

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: there is no code to run."""


class _InterfaceModule(ModuleType):
    def __init__(self, name: str, package: str, kind: str) -> None:
        super().__init__(name, f"Interfaces of {package}, made from their definitions.")
        self._package = package
        self._kind = kind

    def __getattr__(self, name: str) -> Any:
        from . import registry

        if name == "__all__":
            return registry.names(self._package, self._kind)
        if name.startswith("_"):
            raise AttributeError(name)
        full = f"{self._package}/{self._kind}/{name}"
        make = registry.message_class if self._kind == "msg" else registry.service_class
        try:
            made = make(full)
        except registry.UnknownTypeError as error:
            raise AttributeError(str(error)) from None
        setattr(self, name, made)
        return made

    def __dir__(self) -> list[str]:
        from . import registry

        return [*super().__dir__(), *registry.names(self._package, self._kind)]


def install() -> None:
    """Put the finder behind Python's own ones, once."""
    if not any(isinstance(finder, InterfaceFinder) for finder in sys.meta_path):
        sys.meta_path.append(InterfaceFinder())
