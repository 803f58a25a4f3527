"""Quality of service: policies, profiles and the predefined profiles of ROS 2."""

from __future__ import annotations

import warnings
from enum import Enum, IntEnum
from typing import Any

from rclpy.duration import Duration, Infinite
from stepdiag_ros.embedded import dds


class QoSPolicyKind(IntEnum):
    """Policies, by the numbers of rmw."""

    INVALID = 1 << 0
    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    HISTORY = 1 << 5
    LIFESPAN = 1 << 6
    DEPTH = 1 << 7
    LIVELINESS_LEASE_DURATION = 1 << 8
    AVOID_ROS_NAMESPACE_CONVENTIONS = 1 << 9


#: Policies by the numbers of DDS, as Cyclone reports them.
_DDS_POLICIES = {
    2: QoSPolicyKind.DURABILITY,
    4: QoSPolicyKind.DEADLINE,
    8: QoSPolicyKind.LIVELINESS,
    11: QoSPolicyKind.RELIABILITY,
    13: QoSPolicyKind.HISTORY,
    21: QoSPolicyKind.LIFESPAN,
}


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """Return the name of a policy."""
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):
    """A profile is made with contradicting or missing settings."""

    def __init__(self, *args: object) -> None:
        super().__init__("Invalid QoSProfile", *args)


class QoSPolicyEnum(IntEnum):
    """Base of the policies' values."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the names of the values in lower case."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """Return a value by its name in any case."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        """The value's name in lower case."""
        return self.name.lower()


class HistoryPolicy(QoSPolicyEnum):
    """How many samples are kept."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(QoSPolicyEnum):
    """Whether lost samples are sent again."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class DurabilityPolicy(QoSPolicyEnum):
    """Whether a late subscriber gets earlier samples."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(QoSPolicyEnum):
    """Who says that a publisher is alive."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy

_NAMES = (
    "history",
    "depth",
    "reliability",
    "durability",
    "lifespan",
    "deadline",
    "liveliness",
    "liveliness_lease_duration",
    "avoid_ros_namespace_conventions",
)
_UNSET = Duration()


class QoSProfile:
    """Settings of a publisher, subscription, service or client.

    ``depth`` or ``history`` must be given. Durations of zero mean "not set".

    Raises:
        InvalidQoSProfileException: Neither is given, or KEEP_LAST comes without a depth.
        AssertionError: A setting is unknown or of the wrong type.
    """

    __slots__ = tuple(f"_{name}" for name in _NAMES)

    _history: HistoryPolicy
    _depth: int
    _reliability: ReliabilityPolicy
    _durability: DurabilityPolicy
    _lifespan: Duration
    _deadline: Duration
    _liveliness: LivelinessPolicy
    _liveliness_lease_duration: Duration
    _avoid_ros_namespace_conventions: bool

    def __init__(self, **kwargs: Any) -> None:
        unknown = kwargs.keys() - set(_NAMES)
        assert not unknown, f"Invalid arguments passed to constructor: {sorted(unknown)}"
        if "history" not in kwargs:
            if "depth" not in kwargs:
                raise InvalidQoSProfileException("History and/or depth settings are required.")
            kwargs["history"] = HistoryPolicy.KEEP_LAST
        self.history = kwargs["history"]
        if self.history == HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        self.depth = kwargs.get("depth", 10)
        self.reliability = kwargs.get("reliability", ReliabilityPolicy.RELIABLE)
        self.durability = kwargs.get("durability", DurabilityPolicy.VOLATILE)
        self.lifespan = kwargs.get("lifespan", _UNSET)
        self.deadline = kwargs.get("deadline", _UNSET)
        self.liveliness = kwargs.get("liveliness", LivelinessPolicy.SYSTEM_DEFAULT)
        self.liveliness_lease_duration = kwargs.get("liveliness_lease_duration", _UNSET)
        self.avoid_ros_namespace_conventions = kwargs.get("avoid_ros_namespace_conventions", False)

    @property
    def history(self) -> HistoryPolicy:
        """How many samples are kept."""
        return self._history

    @history.setter
    def history(self, value: HistoryPolicy | int) -> None:
        assert isinstance(value, int), "history must be a HistoryPolicy"
        self._history = HistoryPolicy(value)

    @property
    def depth(self) -> int:
        """How many samples KEEP_LAST keeps."""
        return self._depth

    @depth.setter
    def depth(self, value: int) -> None:
        assert isinstance(value, int), "depth must be an int"
        if self.history == HistoryPolicy.KEEP_LAST and value == 0:
            warnings.warn(
                "KEEP_LAST with a depth of 0 would keep nothing; the middleware's default is used",
                stacklevel=2,
            )
        self._depth = value

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Whether lost samples are sent again."""
        return self._reliability

    @reliability.setter
    def reliability(self, value: ReliabilityPolicy | int) -> None:
        assert isinstance(value, int), "reliability must be a ReliabilityPolicy"
        self._reliability = ReliabilityPolicy(value)

    @property
    def durability(self) -> DurabilityPolicy:
        """Whether a late subscriber gets earlier samples."""
        return self._durability

    @durability.setter
    def durability(self, value: DurabilityPolicy | int) -> None:
        assert isinstance(value, int), "durability must be a DurabilityPolicy"
        self._durability = DurabilityPolicy(value)

    @property
    def liveliness(self) -> LivelinessPolicy:
        """Who says that a publisher is alive."""
        return self._liveliness

    @liveliness.setter
    def liveliness(self, value: LivelinessPolicy | int) -> None:
        assert isinstance(value, int), "liveliness must be a LivelinessPolicy"
        self._liveliness = LivelinessPolicy(value)

    @property
    def lifespan(self) -> Duration:
        """How long a sample is worth delivering."""
        return self._lifespan

    @lifespan.setter
    def lifespan(self, value: Duration) -> None:
        assert isinstance(value, Duration), "lifespan must be a Duration"
        self._lifespan = value

    @property
    def deadline(self) -> Duration:
        """Longest time between two samples."""
        return self._deadline

    @deadline.setter
    def deadline(self, value: Duration) -> None:
        assert isinstance(value, Duration), "deadline must be a Duration"
        self._deadline = value

    @property
    def liveliness_lease_duration(self) -> Duration:
        """How long a publisher counts as alive without a sign."""
        return self._liveliness_lease_duration

    @liveliness_lease_duration.setter
    def liveliness_lease_duration(self, value: Duration) -> None:
        assert isinstance(value, Duration), "liveliness_lease_duration must be a Duration"
        self._liveliness_lease_duration = value

    @property
    def avoid_ros_namespace_conventions(self) -> bool:
        """Whether the topic keeps its bare name; only False is supported."""
        return self._avoid_ros_namespace_conventions

    @avoid_ros_namespace_conventions.setter
    def avoid_ros_namespace_conventions(self, value: bool) -> None:
        assert isinstance(value, bool), "avoid_ros_namespace_conventions must be a bool"
        self._avoid_ros_namespace_conventions = value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, QoSProfile):
            return False
        return all(getattr(self, name) == getattr(other, name) for name in _NAMES)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={getattr(self, name)}" for name in _NAMES)
        return f"{type(self).__name__}({values})"

    __str__ = __repr__

    def _to_dds(self) -> dds.Qos:
        """Return the settings as DDS takes them.

        Raises:
            ValueError: A policy is UNKNOWN.
        """
        for policy in (self.history, self.reliability, self.durability, self.liveliness):
            if policy.name == "UNKNOWN":
                raise ValueError(f"The {type(policy).__name__} is UNKNOWN; choose another value.")
        return dds.Qos(
            reliable=self.reliability != ReliabilityPolicy.BEST_EFFORT,
            transient_local=self.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            keep_all=self.history == HistoryPolicy.KEEP_ALL,
            depth=max(self.depth, 1),
            deadline=_limit(self.deadline),
            lifespan=_limit(self.lifespan),
            manual_liveliness=self.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC,
            lease=_limit(self.liveliness_lease_duration),
        )

    @classmethod
    def _from_dds(cls, qos: dds.Qos) -> QoSProfile:
        """Return a discovered endpoint's settings; DDS does not announce history and depth."""
        reliability = ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT
        durability = DurabilityPolicy.VOLATILE
        if qos.transient_local:
            durability = DurabilityPolicy.TRANSIENT_LOCAL
        liveliness = LivelinessPolicy.AUTOMATIC
        if qos.manual_liveliness:
            liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        return cls(
            history=HistoryPolicy.UNKNOWN,
            depth=0,
            reliability=reliability,
            durability=durability,
            liveliness=liveliness,
            lifespan=Duration(nanoseconds=qos.lifespan),
            deadline=Duration(nanoseconds=qos.deadline),
            liveliness_lease_duration=Duration(nanoseconds=qos.lease),
        )


def _limit(duration: Duration) -> int:
    if duration.nanoseconds in (0, Infinite.nanoseconds):
        return dds.UNLIMITED
    return duration.nanoseconds


def _preset(depth: int, **kwargs: Any) -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, **kwargs)


qos_profile_default = _preset(10)
qos_profile_system_default = QoSProfile(
    history=HistoryPolicy.SYSTEM_DEFAULT,
    depth=0,
    reliability=ReliabilityPolicy.SYSTEM_DEFAULT,
    durability=DurabilityPolicy.SYSTEM_DEFAULT,
)
qos_profile_sensor_data = _preset(5, reliability=ReliabilityPolicy.BEST_EFFORT)
qos_profile_services_default = _preset(10)
qos_profile_parameters = _preset(1000)
qos_profile_parameter_events = _preset(1000)
qos_profile_rosout_default = _preset(
    1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)
qos_profile_best_available = _preset(
    10,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
)
qos_profile_action_status_default = _preset(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class QoSPresetProfiles(Enum):
    """The predefined profiles by name."""

    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the profiles' names in lower case."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """Return a profile by its name in any case."""
        return cls[name.upper()].value


def _as_profile(value: QoSProfile | int) -> QoSProfile:
    """Return a profile; a plain number is the depth of a default one.

    Raises:
        TypeError: It is neither.
        ValueError: The number is negative.
    """
    if isinstance(value, QoSProfile):
        return value
    if isinstance(value, int):
        if value < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=value)
    raise TypeError(f"Expected QoSProfile or int, but received {type(value)!r}")
