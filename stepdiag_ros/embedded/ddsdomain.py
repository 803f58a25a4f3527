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
#: The loopback carries a whole packet of UDP at once; Cyclone would cut it to fit an Ethernet.
_WHOLE_PACKETS = "<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>65000B</FragmentSize>"
#: A burst of 10 kB messages overflows the receive buffer that Cyclone asks for. It takes what the
#: kernel allows, and lost packets are asked for again after 1 ms instead of 100 ms.
_QUICK_REPAIR = (
    '<Internal><SocketReceiveBufferSize max="16MB"/><NackDelay>1ms</NackDelay>'
    '<HeartbeatInterval min="1ms" minsched="1ms" max="8s">5ms</HeartbeatInterval></Internal>'
)


def discovery_config(network: bool = True) -> str:
    """Return the Cyclone configuration for ``ROS_AUTOMATIC_DISCOVERY_RANGE`` and its peers.

    Args:
        network: Whether there is a network card.

    Raises:
        DdsError: The variable has a value which ROS 2 does not know.
    """
    wanted = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "LOCALHOST"
    peers = [peer for peer in os.environ.get("ROS_STATIC_PEERS", "").split(";") if peer]
    if os.environ.get("ROS_LOCALHOST_ONLY") == "1":
        # Of older ROS 2; newer ones heed it before all else, too.
        wanted, peers = "LOCALHOST", []
    parts: list[str] = []
    discovery = ""
    if wanted == "OFF":
        parts.append("<General><AllowMulticast>false</AllowMulticast></General>")
        # A tag that no other process has keeps everybody out.
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>off_{os.getpid()}</Tag>"
    elif wanted in ("LOCALHOST", "SUBNET"):
        reach = _reach(network and wanted == "SUBNET", network and bool(peers))
        parts.append(f"<General>{reach}</General>")
        listed = "".join(
            f'<Peer address={quoteattr(peer)} PruneDelay="inf"/>' for peer in ("localhost", *peers)
        )
        # Real ROS 2 nodes without a limit send nothing to this computer alone: they find this
        # node by its own announcements, which therefore must come soon and never end.
        discovery = (
            "<ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{MAX_PARTICIPANTS}</MaxAutoParticipantIndex>"
            f"<SPDPInterval>2s</SPDPInterval><Peers>{listed}</Peers>"
        )
    elif wanted != "SYSTEM_DEFAULT":
        raise DdsError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{wanted}'; set it to LOCALHOST, SUBNET, OFF or"
            " SYSTEM_DEFAULT."
        )
    if discovery:
        parts.append(f"<Discovery>{discovery}</Discovery>{_QUICK_REPAIR}")
    own = f"<CycloneDDS><Domain>{''.join(parts)}</Domain></CycloneDDS>" if parts else ""
    return ",".join(part for part in (own, os.environ.get("CYCLONEDDS_URI", "")) if part)


def _reach(subnet: bool, beyond: bool) -> str:
    """Return which interfaces Cyclone uses: the loopback, and the network card if need be.

    Args:
        subnet: Whether nodes of other computers are looked for.
        beyond: Whether there are peers of which the address is given.
    """
    multicast = "" if subnet else "<AllowMulticast>false</AllowMulticast>"
    # Who configures Cyclone chooses its interfaces, too; an interface must not be given twice.
    if os.environ.get("CYCLONEDDS_URI"):
        return multicast
    outward = ""
    if subnet:
        outward = '<NetworkInterface autodetermine="true"/>'
    elif beyond:
        outward = '<NetworkInterface autodetermine="true" multicast="false"/>'
    whole = "" if outward else _WHOLE_PACKETS
    return f"{multicast}<Interfaces>{outward}{_LOOPBACK}</Interfaces>{whole}"


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
                handle = lib.dds_create_domain(number, discovery_config().encode())
                if handle < 0:
                    # Where there is no network card, the loopback would be the card, too.
                    handle = lib.dds_create_domain(number, discovery_config(False).encode())
                lib.check(handle, f"open domain {number}")
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
