"""DDS Security as ROS 2 sets it up: the variables, the keystore and its enclaves (SROS2).

Cyclone DDS protects what it sends only if it was built with its security plugins. The library in
the ``cyclonedds`` wheel was not: it cannot sign, encrypt or check permissions, and a process that
must be protected does not start with it. Set ``CYCLONEDDS_HOME`` to an installation that can.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from . import dds, ddslib
from .ddslib import DdsError

#: What the enclave's folder holds, as SROS2 names it, and the DDS property that it is given by.
_FILES = {
    "identity_ca.cert.pem": "dds.sec.auth.identity_ca",
    "cert.pem": "dds.sec.auth.identity_certificate",
    "key.pem": "dds.sec.auth.private_key",
    "permissions_ca.cert.pem": "dds.sec.access.permissions_ca",
    "governance.p7s": "dds.sec.access.governance",
    "permissions.p7s": "dds.sec.access.permissions",
}
_REVOKED = ("crl.pem", "org.eclipse.cyclonedds.sec.auth.crl")
_PLUGINS = {
    "auth": ("dds_security_auth", "authentication"),
    "crypto": ("dds_security_crypto", "crypto"),
    "access": ("dds_security_ac", "access_control"),
}


class NotProtectedError(DdsError):
    """Security is wanted, but its files or the library's plugins are missing; says which."""


def join(domain: int, user_data: str, enclave: str) -> tuple[dds.Participant, str]:
    """Join a domain, protected if ``ROS_SECURITY_ENABLE`` says so.

    Args:
        domain: Number of the domain.
        user_data: What peers read of the participant.
        enclave: The process's enclave, such as ``/stepdiag/bridge``.

    Returns:
        The participant, and a sentence to warn with if it is not protected although it should be;
        empty if all is as wanted.

    Raises:
        DdsError: The domain cannot be joined. Under ``ROS_SECURITY_STRATEGY=Enforce`` that is so
            (:class:`NotProtectedError`) wherever the participant would not be protected.
    """
    if os.environ.get("ROS_SECURITY_ENABLE") != "true":
        return dds.Participant(domain, user_data), ""
    try:
        return dds.Participant(domain, user_data, properties(enclave)), ""
    except NotProtectedError as error:
        if os.environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
            raise
        warning = f"Security is enabled and not enforced, this process is NOT protected: {error}"
        return dds.Participant(domain, user_data), warning


def properties(enclave: str) -> Mapping[str, str]:
    """Return the DDS properties of a protected participant.

    Raises:
        NotProtectedError: A file is missing, or the library has no security plugins.
    """
    folder = _folder(enclave)
    missing = [name for name in _FILES if not (folder / name).is_file()]
    if missing:
        raise NotProtectedError(
            f"The enclave folder {folder} has no {', '.join(missing)};"
            " make the enclave and its permissions with 'ros2 security'."
        )
    found = {key: f"file:{folder / name}" for name, key in _FILES.items()}
    if (folder / _REVOKED[0]).is_file():
        found[_REVOKED[1]] = f"file:{folder / _REVOKED[0]}"
    library = Path(ddslib.library_path())
    for part, (name, function) in _PLUGINS.items():
        plugin = library.parent / f"lib{name}.so"
        if not plugin.is_file():
            raise NotProtectedError(
                f"The Cyclone DDS library {library} has no DDS Security (there is no"
                f" {plugin.name} beside it); set CYCLONEDDS_HOME to an installation of Cyclone DDS"
                f" {ddslib.SERIES} built with ENABLE_SECURITY, or run the nodes on a ROS 2"
                " installation."
            )
        found[f"dds.sec.{part}.library.path"] = str(plugin)
        found[f"dds.sec.{part}.library.init"] = f"init_{function}"
        found[f"dds.sec.{part}.library.finalize"] = f"finalize_{function}"
    return found


def _folder(enclave: str) -> Path:
    keystore = os.environ.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore:
        raise NotProtectedError(
            "ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no folder."
        )
    name = os.environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE", "") or enclave
    folder = Path(keystore).absolute() / "enclaves" / name.strip("/")
    if not folder.is_dir():
        raise NotProtectedError(
            f"The keystore has no enclave '{name}': {folder} is missing; choose another one with"
            " --ros-args --enclave, or make it with 'ros2 security create_enclave'."
        )
    return folder
