"""The OPC UA driver in front of the peer, as tests use it."""

import time

from cnc_conformance import Operator, Rig
from opcua_peer import URI, OpcUaPeer

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.metrology.machine import Machine

MACHINE = Machine("plc", "XYZ", (-0.3, -0.3, -0.2), (0.3, 0.3, 0.2), 0.3, 2.0)


def node(name):
    return f"nsu={URI};s={name}"


def settings(url, method=False, **changed):
    command = {"stop": node("Stop"), "reset": node("Reset")}
    if method:
        command["method"] = {
            "object": node("Machine"),
            "node": node("Order"),
            "arguments": ["identity", "X", "Y", "Z", "feed", "axes"],
        }
    else:
        command |= {axis: node(f"Target{axis}") for axis in "XYZ"}
        command |= {name: node(name.capitalize()) for name in ("feed", "axes", "identity")}
    return {
        "url": url,
        "security": {"policy": "none", "anonymous": True},
        # One by its path.
        "positions": {"X": "/0:Objects/2:M/2:X", "Y": node("Y"), "Z": node("Z")},
        "state": {
            "busy": node("Busy"),
            "acknowledged": node("Acknowledged"),
            "done": node("Done"),
            "stopped": node("Stopped"),
            "fault": node("Fault"),
            "fault_text": node("FaultText"),
            "ready": node("Ready"),
        },
        "command": command,
        "watchdog": {"node": node("Watchdog"), "limit_s": 1.0},
        "fault_words": {4: "following error"},
        "silence_s": 2.0,
    } | changed


def opcua_rig(peer, **changed):
    prepared = prepare("cnc", "opcua", settings(peer.url, **changed), Surroundings(MACHINE))
    return Rig(MACHINE, lambda: prepared(time.time_ns()), time.time_ns, time.sleep, 0.05)


def operator_of(peer, **changed):
    return Operator(opcua_rig(peer, **changed))


__all__ = ["MACHINE", "OpcUaPeer", "node", "opcua_rig", "operator_of", "settings"]
