"""Whether the nodes of a run are about the same machine: one file, and devices that are there.

Each node has a parameter for its machine and its device, with a default. One that was forgotten
would let a real machine move while a simulated laser "measures" another one.
"""

import hashlib

from stepdiag_ros.run.supervision import Peer, Watch

DRIVER = "driver"
"""Fact by which a device node names its driver."""
MACHINE = "machine"
"""Fact by which a node names the machine under test, as its file has it."""
SIMULATED = "simulated"
"""Driver that every kind of device has."""
BRIDGE = "cnc_bridge"
SENSORS = ("interferometer", "weather")


def machine_fact(name: str, text: str) -> str:
    """Return what names a machine: its name, and a digest of the text of its file."""
    return f"{name} ({hashlib.sha256(text.encode()).hexdigest()[:8]})"


def discords(watch: Watch, machine: str, cell: bool) -> list[str]:
    """Return a sentence for each node that is not about the machine of a run.

    Args:
        watch: the nodes that are there.
        machine: of the run, by ``machine_fact``.
        cell: the run is one of a simulated cell, which may stand in for sensors of a real machine.
    """
    found = []
    for bridge in _present(watch, BRIDGE):
        known = bridge.facts.get(MACHINE, machine)
        if known != machine:
            found.append(
                f"the bridge was started with the machine {known}, the sequencer with {machine}:"
                " give both the same file (parameter machine)"
            )
        if cell or bridge.facts.get(DRIVER, SIMULATED) == SIMULATED:
            continue
        found += [
            f"the controller is real ({bridge.facts[DRIVER]}), but the {role} is simulated: set its"
            " parameter device, or, if the run is a test without sensors, the parameter cell of the"
            " sequencer"
            for role in SENSORS
            if any(peer.facts.get(DRIVER) == SIMULATED for peer in _present(watch, role))
        ]
    return found


def _present(watch: Watch, role: str) -> list[Peer]:
    return [
        peer for name, peer in watch.peers.items() if peer.role == role and name not in watch.lost
    ]
