"""DDS domains: how far discovery reaches, and which domains this process has open."""

from __future__ import annotations

import os
import threading
from xml.sax.saxutils import quoteattr

from .ddslib import DdsError, library

#: Participants of one machine that find each other; each start sends as many small packets.
MAX_PARTICIPANTS = 100
#: Nodes of real ROS 2 announce themselves to 127.0.0.1; Cyclone heeds only interfaces it was given.
_LOOPBACK = '<NetworkInterface address="127.0.0.1" multicast="false"/>'


def discovery_config() -> str:
    """Return the Cyclone configuration for ``ROS_AUTOMATIC_DISCOVERY_RANGE`` and its peers.

    Raises:
        DdsError: The variable has a value which ROS 2 does not know.
    """
    wanted = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "LOCALHOST"
    peers = [peer for peer in os.environ.get("ROS_STATIC_PEERS", "").split(";") if peer]
    parts: list[str] = []
    if wanted in ("LOCALHOST", "OFF"):
        general = "<AllowMulticast>false</AllowMulticast>"
        # Who configures Cyclone chooses its interfaces, too; an interface must not be given twice.
        if wanted == "LOCALHOST" and not os.environ.get("CYCLONEDDS_URI"):
            outward = '<NetworkInterface autodetermine="true" multicast="false"/>' if peers else ""
            general += f"<Interfaces>{outward}{_LOOPBACK}</Interfaces>"
        parts.append(f"<General>{general}</General>")
    discovery = ""
    if wanted == "OFF":
        # A tag that no other process has keeps everybody out.
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>off_{os.getpid()}</Tag>"
    elif wanted in ("LOCALHOST", "SUBNET"):
        if wanted == "LOCALHOST":
            peers.insert(0, "localhost")
        discovery = (
            "<ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>"
        )
        if wanted == "LOCALHOST":
            # Real ROS 2 nodes without this limit send nothing to this computer alone: they find
            # this node by its own announcements, which therefore must come soon and never end.
            discovery += "<SPDPInterval>2s</SPDPInterval>"
        listed = "".join(f'<Peer address={quoteattr(peer)} PruneDelay="inf"/>' for peer in peers)
        discovery += f"<Peers>{listed}</Peers>" if listed else ""
    elif wanted != "SYSTEM_DEFAULT":
        raise DdsError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{wanted}'; set it to LOCALHOST, SUBNET, OFF or"
            " SYSTEM_DEFAULT."
        )
    if discovery:
        parts.append(f"<Discovery>{discovery}</Discovery>")
    own = f"<CycloneDDS><Domain>{''.join(parts)}</Domain></CycloneDDS>" if parts else ""
    return ",".join(part for part in (own, os.environ.get("CYCLONEDDS_URI", "")) if part)


class Domains:
    """The domains this process takes part in, and how many participants use each."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[int, tuple[int, int]] = {}

    def open(self, number: int) -> None:
        """Open a domain, or count one more user of it."""
        lib = library()
        with self._lock:
            handle, users = self._open.get(number, (0, 0))
            if not users:
                config = discovery_config()
                handle = lib.check(
                    lib.dds_create_domain(number, config.encode()), f"open domain {number}"
                )
            self._open[number] = (handle, users + 1)

    def close(self, number: int) -> None:
        """Count one user less of a domain, and leave it with the last one."""
        with self._lock:
            handle, users = self._open[number]
            if users > 1:
                self._open[number] = (handle, users - 1)
            else:
                del self._open[number]
                library().dds_delete(handle)


#: The domains of this process.
domains = Domains()
