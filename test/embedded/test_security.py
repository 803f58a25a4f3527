"""DDS Security: nothing that was to be protected ever runs in the open without saying so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from refused import refused

from stepdiag_ros.embedded import ddslib, security
from stepdiag_ros.embedded.security import NotProtectedError

FILES = (
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
)
PLUGINS = ("libdds_security_auth.so", "libdds_security_crypto.so", "libdds_security_ac.so")


@pytest.fixture
def keystore(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of an enclave whose files are all there, and enforce security."""
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path / "keystore"))
    monkeypatch.delenv("ROS_SECURITY_ENCLAVE_OVERRIDE", raising=False)
    monkeypatch.delenv("CYCLONEDDS_HOME", raising=False)
    folder = tmp_path / "keystore" / "enclaves" / "stepdiag" / "bridge"
    folder.mkdir(parents=True)
    for name in FILES:
        (folder / name).touch()
    return folder


def start(*arguments: str) -> Any:
    import rclpy

    try:
        rclpy.init(args=["x", "--ros-args", *arguments])
        return rclpy.create_node("protected").get_name()
    finally:
        rclpy.try_shutdown()


BRIDGE = ("--enclave", "/stepdiag/bridge")


@pytest.mark.usefixtures("keystore")
def test_the_wheel_cannot_protect_and_says_so() -> None:
    with refused(NotProtectedError, None, "CYCLONEDDS_HOME"):
        start(*BRIDGE)


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda _, env: env.delenv("ROS_SECURITY_KEYSTORE"), "ROS_SECURITY_KEYSTORE"),
        (
            lambda _, env: env.setenv("ROS_SECURITY_KEYSTORE", "/nowhere"),
            "/nowhere/enclaves/stepdiag/bridge",
        ),
        (lambda folder, _: (folder / "key.pem").unlink(), "key.pem"),
        (
            lambda _, env: env.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", "/stepdiag/nobody"),
            "/stepdiag/nobody",
        ),
    ],
)
def test_what_is_missing_is_named(
    keystore: Path, monkeypatch: pytest.MonkeyPatch, spoil: Callable[..., Any], named: str
) -> None:
    spoil(keystore, monkeypatch)
    with refused(NotProtectedError, None, named):
        start(*BRIDGE)


@pytest.mark.usefixtures("keystore")
def test_not_enforced_it_starts_and_warns(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Permissive")
    assert start(*BRIDGE) == "protected"
    said = capfd.readouterr()
    assert "[WARN]" in said.err + said.out
    assert "this process is NOT protected: The Cyclone DDS library" in said.err + said.out


@pytest.mark.usefixtures("keystore")
@pytest.mark.parametrize("value", ["", "false", "True", "1"])
def test_only_the_word_true_enables_it(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", value)
    assert start(*BRIDGE) == "protected"


def test_a_library_with_plugins_is_given_the_enclave(
    keystore: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = tmp_path / "home" / "lib" / "libddsc.so"
    library.parent.mkdir(parents=True)
    for name in (library.name, *PLUGINS):
        (library.parent / name).touch()
    monkeypatch.setenv("CYCLONEDDS_HOME", str(tmp_path / "home"))
    found = security.properties("/stepdiag/bridge")
    assert found["dds.sec.auth.private_key"] == f"file:{keystore / 'key.pem'}"
    assert found["dds.sec.access.permissions"] == f"file:{keystore / 'permissions.p7s'}"
    assert found["dds.sec.access.library.path"] == str(library.parent / PLUGINS[2])
    assert found["dds.sec.auth.library.init"] == "init_authentication"
    assert len(found) == len(FILES) + 9
    (keystore / "crl.pem").touch()
    assert f"file:{keystore / 'crl.pem'}" in security.properties("/stepdiag/bridge").values()
    monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", "/stepdiag/bridge")
    assert security.properties("/another")["dds.sec.auth.private_key"].endswith("bridge/key.pem")


def test_a_wrong_home_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CYCLONEDDS_HOME", str(tmp_path))
    with refused(ddslib.DdsError, None, "CYCLONEDDS_HOME", str(tmp_path)):
        ddslib.library_path()
