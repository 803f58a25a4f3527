"""Import hook: ``std_msgs.msg``, ``std_srvs.srv``, ``example_interfaces.action`` … as modules.

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

#: Kinds of interfaces, which are the names of the modules that hold them.
_KINDS = ("msg", "srv", "action")


class InterfaceFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the modules of message packages; everything else is left to Python."""

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002 - Python's signature
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the spec of a message package or of its module of a kind."""
        package, _, kind = fullname.partition(".")
        if package == "rclpy" and kind:
            # Python has looked for it already, so that this client does not have it.
            raise ModuleNotFoundError(
                f"The embedded ROS 2 client has no {fullname}; source a ROS 2 installation to use"
                " it.",
                name=fullname,
            )
        if kind not in ("", *_KINDS):
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
        make = {
            "msg": registry.message_class,
            "srv": registry.service_class,
            "action": registry.action_class,
        }[self._kind]
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
