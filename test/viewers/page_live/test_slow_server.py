"""A page in a browser whose server is slow to speak, as on a busy computer."""

import asyncio
from math import inf

from stepdiag_ros.viewers.page import server as server_module
from stepdiag_ros.viewers.page.access import PageAccess
from stepdiag_ros.viewers.page.items import AxisPlace
from stepdiag_ros.viewers.page.server import MonitorServer, Offer
from stepdiag_ros.viewers.page.state import PageState

SLOW = 1.0
"""Seconds that the server needs to begin: more than the page has between two looks at it (0.5 s),
and less than after which it gives a connection up (3 s)."""


def test_a_server_that_was_silent_and_is_slow_to_begin_again_is_found_again(pages, monkeypatch):
    greeted, show = [], MonitorServer._show

    async def shown_late(self, request, socket):
        greeted.append(socket)
        await asyncio.sleep(SLOW)
        await show(self, request, socket)

    monkeypatch.setattr(MonitorServer, "_show", shown_late)
    state = PageState()
    state.take(AxisPlace(1, (0.0, 0.0, 0.0)))
    access = PageAccess("127.0.0.1", "0123456789abcdef", made=True)
    server = MonitorServer(Offer(state, access, "run", "a title", None, lambda _: None), 0)
    server.start()
    page = pages.open(server.url)
    # Silent: nothing changes, and it says nothing of its own.
    monkeypatch.setattr(server_module, "BEAT", inf)
    page.wait_for_selector("#contact[data-contact=lost]")
    monkeypatch.setattr(server_module, "BEAT", 1.0)
    page.wait_for_selector("#contact[data-contact=good]")
    assert len(greeted) > 1, "the page has connected again"
    page.context.close()
    server.close()
