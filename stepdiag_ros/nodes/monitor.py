#!/usr/bin/env python3
"""Node: serves one live page about the run to browsers."""

import sys

from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.onlooker import Onlooker
from stepdiag_ros.nodes.run_control import RunControl
from stepdiag_ros.viewers.page.access import make_access
from stepdiag_ros.viewers.page.server import RATE, MonitorServer, Offer
from stepdiag_ros.viewers.page.state import PageState


class MonitorNode(Onlooker):
    """Folds what the nodes publish into the page, and passes on what an operator asks for."""

    role = "monitor"

    def __init__(self) -> None:
        super().__init__("monitor", PageState(), RATE)
        self._control = RunControl(self)
        access = make_access(self.parameter("address"), self.parameter("token_file"))
        offer = Offer(
            state=self.state,
            access=access,
            source="run",
            title=self.get_namespace().strip("/"),
            ask=self._control.ask,
            log=self._log,
        )
        self._server = MonitorServer(offer, self.parameter("port"))
        self._server.start()
        self.get_logger().info(f"the page is at {self._server.url}")
        if access.made:
            # Not to the log, which goes to /rosout and so to everybody on the network.
            print(f"to control the run, open {self._server.url_with_token}", flush=True)
        self.every(1.0 / RATE, self._control.work, real=True)

    def close(self) -> None:
        """Let the viewers go."""
        self._server.close()

    def _log(self, text: str) -> None:
        self.get_logger().info(text)


def main() -> int:
    """Run the node."""
    return spin(MonitorNode)


if __name__ == "__main__":
    sys.exit(main())
