"""Settings of the OPC UA driver: which nodes of a PLC mean what.

There is no standard by which a PLC takes a single move; what the nodes must do is described in
``docs/controllers.md``, and written in the PLC by its programmer.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.refusal import Refusal

POLICIES = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss", "none")
"""Security policies of OPC UA Part 7 that are not deprecated, and none."""
MODES = {"sign_and_encrypt": "SignAndEncrypt", "sign": "Sign"}
ARGUMENTS = ("identity", *AXES, "feed", "axes")
"""What a method can be given, in any order."""

POSITIONS = tuple(f"position {axis}" for axis in AXES)
MOTORS = tuple(f"motor {axis}" for axis in AXES)
TARGETS = tuple(f"target {axis}" for axis in AXES)


@dataclass(frozen=True)
class Security:
    """How the connection is secured.

    Attributes:
        policy: one of ``POLICIES``.
        mode: ``SignAndEncrypt`` or ``Sign``.
        certificate: file of our certificate (DER or PEM).
        private_key: file of its key.
        server_certificate: file of the server's; empty: whichever it shows is trusted.
        application_uri: as written in our certificate.
        user: name; empty: anonymous.
        password: of the user.
    """

    policy: str = "none"
    mode: str = "SignAndEncrypt"
    certificate: str = ""
    private_key: str = ""
    server_certificate: str = ""
    application_uri: str = "urn:stepdiag_ros:client"
    user: str = ""
    password: str = ""


@dataclass(frozen=True)
class OpcUaSettings:
    """Settings of the driver.

    Attributes:
        url: of the server, ``opc.tcp://host:port``.
        security: of the connection.
        nodes: our name of a node → its NodeId or browse path. Names: ``position X`` …, ``motor X``
            …, ``busy``, ``acknowledged``, ``done``, ``stopped``, ``fault``, ``fault_text``,
            ``ready``; ``target X`` …, ``feed``, ``axes``, ``identity``, ``stop``, ``reset``,
            ``watchdog``; ``object``, ``method``.
        unit: of positions and targets, m.
        feed_unit: of the feed, m/s.
        arguments: of the method, in order; empty where nodes are written.
        interval: of the subscription, s.
        confirm: time between two readings of everything, s.
        watchdog_period: time between two counts of the watchdog, s.
        watchdog_limit: after which the PLC brakes, s; NaN if it has no watchdog.
        resolution: step of the positions, m.
        measured: the positions come from encoders or scales.
        silence: s without an answer after which the PLC is lost.
        start_limit: s in which the connection is made.
        stop_limit: s in which the axes stand after a stop.
        fault_words: number of a fault → words.
    """

    url: str
    security: Security
    nodes: Mapping[str, str]
    unit: float = 1e-3
    feed_unit: float = 1e-3 / 60.0
    arguments: tuple[str, ...] = ()
    interval: float = 0.02
    confirm: float = 0.1
    watchdog_period: float = 0.1
    watchdog_limit: float = nan
    resolution: float = 0.0
    measured: bool = True
    silence: float = 1.0
    start_limit: float = 10.0
    stop_limit: float = 5.0
    fault_words: Mapping[int, str] = field(default_factory=dict)

    @property
    def watched(self) -> list[str]:
        """Return the names of the nodes that are subscribed to and read."""
        told = (*POSITIONS, *MOTORS, "busy", "acknowledged", "done", "stopped", "fault")
        further = ("fault_text", "ready", "identity")
        return [name for name in (*told, *further) if name in self.nodes]

    @property
    def has_motors(self) -> bool:
        """Return whether the positions of the motors are reported."""
        return MOTORS[0] in self.nodes

    @classmethod
    def from_mapping(cls, settings: Mapping[str, Any]) -> "OpcUaSettings":
        """Take the settings from the parsed YAML of a device file.

        Raises:
            ValueError: a setting is wrong, missing or not known.
        """
        source = "settings of the opcua controller"
        # The keys of this table are numbers, of which there may be any.
        rest = dict(settings)
        words = _fault_words(rest.pop("fault_words", {}), source)
        section = Section(rest, source)
        url = section.text("url")
        if not url.startswith("opc.tcp://"):
            raise Refusal(
                f"{section.source}: 'url' is '{url}'; expected opc.tcp://host:port",
                fault="malformed",
            )
        # The bridge says how often; the subscription gives each change, at least so often.
        rate = section.number("position_rate_hz", low=1.0, high=10_000.0, default=50.0)
        section_security = section.section("security")
        nodes: dict[str, str] = {}
        positions = section.section("positions")
        unit = positions.number("unit_m", low=1e-9, high=1.0, default=1e-3)
        resolution = positions.number("resolution_m", low=0.0, high=1e-3, default=0.0)
        measured = positions.flag("measured", default=True)
        for axis in AXES:
            nodes[f"position {axis}"] = positions.text(axis)
        _optional_axes(positions, "motors", "motor", nodes)
        positions.finish()
        state = section.section("state")
        for name in ("busy", "acknowledged", "done"):
            nodes[name] = state.text(name)
        for name in ("stopped", "fault", "fault_text", "ready"):
            _optional(state, name, nodes)
        state.finish()
        command = section.section("command")
        feed_unit = command.number("feed_unit_m_per_s", low=1e-9, high=10.0, default=1e-3 / 60.0)
        for name in ("stop", "reset"):
            nodes[name] = command.text(name)
        arguments = _method_or_nodes(command, nodes)
        command.finish()
        watchdog = section.section("watchdog")
        period, limit = 0.1, nan
        if watchdog.keys():
            nodes["watchdog"] = watchdog.text("node")
            limit = watchdog.number("limit_s", low=0.05, high=60.0)
            period = watchdog.number("period_s", low=0.01, high=30.0, default=limit / 4.0)
            if period > limit / 2.0:
                raise Refusal(
                    f"{watchdog.source}: 'period_s' is {period:g};"
                    " expected at most half of limit_s",
                    fault="out_of_range",
                )
        watchdog.finish()
        made = cls(
            url=url,
            security=_security(section_security),
            nodes=nodes,
            unit=unit,
            feed_unit=feed_unit,
            arguments=arguments,
            interval=section.number("interval_s", low=0.001, high=0.5, default=1.0 / rate),
            confirm=section.number("confirm_s", low=0.01, high=0.3, default=0.1),
            watchdog_period=period,
            watchdog_limit=limit,
            resolution=resolution,
            measured=measured,
            silence=section.number("silence_s", low=0.3, high=60.0, default=1.0),
            start_limit=section.number("start_limit_s", low=0.5, high=60.0, default=10.0),
            stop_limit=section.number("stop_limit_s", low=0.1, high=60.0, default=5.0),
            fault_words=words,
        )
        section.finish()
        return made


def _optional(section: Section, name: str, nodes: dict[str, str]) -> None:
    if text := section.text(name, default=""):
        nodes[name] = text


def _optional_axes(section: Section, key: str, name: str, nodes: dict[str, str]) -> None:
    axes = section.section(key)
    if axes.keys():
        for axis in AXES:
            nodes[f"{name} {axis}"] = axes.text(axis)
    axes.finish()


def _method_or_nodes(command: Section, nodes: dict[str, str]) -> tuple[str, ...]:
    """Take how a move is commanded; return the arguments of the method, if it is one."""
    method = command.section("method")
    if not method.keys():
        for axis in AXES:
            nodes[f"target {axis}"] = command.text(axis)
        for name in ("feed", "identity"):
            nodes[name] = command.text(name)
        _optional(command, "axes", nodes)
        method.finish()
        return ()
    nodes["object"], nodes["method"] = method.text("object"), method.text("node")
    arguments = method.names("arguments", ARGUMENTS, default=ARGUMENTS[:-1])
    method.finish()
    if missing := [name for name in ARGUMENTS[:-1] if name not in arguments]:
        raise Refusal(f"{method.source}: 'arguments' lacks {', '.join(missing)}", fault="missing")
    return arguments


def _fault_words(given: Any, source: str) -> dict[int, str]:
    if not isinstance(given, Mapping) or not all(
        isinstance(number, int) and isinstance(words, str) for number, words in given.items()
    ):
        raise Refusal(
            f"{source}: 'fault_words' is not a table of 'number: words'", fault="malformed"
        )
    return dict(given)


def _security(section: Section) -> Security:
    policy = section.names("policy", POLICIES, default=("Basic256Sha256",))[0]
    mode = section.names("mode", tuple(MODES), default=("sign_and_encrypt",))[0]
    anonymous = section.flag("anonymous", default=False)
    user = section.text("user", default="")
    if anonymous == bool(user):
        raise Refusal(
            f"{section.source}: expected either 'user' or 'anonymous: true'", fault="missing"
        )
    password = _password(section, section.text("password_file")) if user else ""
    if policy == "none":
        if user:
            raise Refusal(
                f"{section.source}: 'policy' is 'none', and a password is not sent without"
                " encryption. Set a security policy",
                fault="exposed",
            )
        section.finish()
        return Security()
    security = Security(
        policy=policy,
        mode=MODES[mode],
        certificate=_file(section, "certificate"),
        private_key=_file(section, "private_key"),
        server_certificate=_file(section, "server_certificate", needed=False),
        application_uri=section.text("application_uri", default=Security.application_uri),
        user=user,
        password=password,
    )
    section.finish()
    return security


def _file(section: Section, key: str, *, needed: bool = True) -> str:
    path = section.text(key) if needed else section.text(key, default="")
    if path and not Path(path).expanduser().is_file():
        raise Refusal(
            f"{section.source}: '{key}' is {path!r}; there is no such file", fault="not_found"
        )
    return str(Path(path).expanduser()) if path else ""


def _password(section: Section, path: str) -> str:
    try:
        return Path(path).expanduser().read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{section.source}: 'password_file' {path!r}: {error}") from None
