#!/usr/bin/python3
"""Starts LinuxCNC for a test or a demonstration and does there what an operator would.

A program of its own, like the agent beside it. It runs in the namespaces that
``linuxcnc_instance`` makes, ends with LinuxCNC, and executes what it is asked for on a Unix socket:
one JSON object a connection, ``{"run": [program, argument, ...]}``, answered by ``{"code": 0,
"out": "..."}``.

Usage: stepdiag_bench.py INI_FILE SOCKET
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys

LIMIT = 100.0
"""Seconds within which what is asked for must end."""


def answer(connection: socket.socket) -> None:
    """Execute one request."""
    request = json.loads(connection.makefile("rb").readline())
    try:
        done = subprocess.run(
            request["run"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=LIMIT,
            check=False,
        )
        told = {"code": done.returncode, "out": done.stdout.decode(errors="replace")}
    except (OSError, subprocess.TimeoutExpired) as error:
        told = {"code": 127, "out": str(error)}
    connection.sendall(json.dumps(told).encode() + b"\n")


def main() -> int:
    """Run LinuxCNC, and what is asked for beside it, until LinuxCNC has ended."""
    inifile, path = sys.argv[1:3]
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(path)
    listener.listen(8)
    linuxcnc = subprocess.Popen(["linuxcnc", "-r", inifile], stdin=subprocess.DEVNULL)
    while linuxcnc.poll() is None:
        if select.select([listener], [], [], 0.1)[0]:
            connection = listener.accept()[0]
            with connection:
                try:
                    answer(connection)
                except (OSError, ValueError, KeyError) as error:
                    print(f"stepdiag_bench: {error}", flush=True)
    return linuxcnc.returncode


if __name__ == "__main__":
    sys.exit(main())
