"""The server as its viewers meet it: who gets what, who is refused, who is cut off."""

import asyncio
import json
import socket
from concurrent.futures import Future

import aiohttp
import pytest
from patience import PATIENCE
from refused import refused

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.viewers.page import server as server_module
from stepdiag_ros.viewers.page.access import PageAccess
from stepdiag_ros.viewers.page.control import RequestAnswer
from stepdiag_ros.viewers.page.items import AxisPlace
from stepdiag_ros.viewers.page.server import MonitorServer, Offer
from stepdiag_ros.viewers.page.state import SECTIONS, PageState

TOKEN = "0123456789abcdef"
DONE = RequestAnswer(True, "done")
NAMES = {section.name for section in SECTIONS}


class Remote(PageAccess):
    """As if other computers could reach the page, which stays on loopback."""

    is_local = False


class Served:
    """A page with its state, and what was asked and logged."""

    def __init__(self, kind=PageAccess, controlled=True, answer=DONE):
        self.state, self.log, self.asked = PageState(), [], []
        self.answer = answer
        offer = Offer(
            state=self.state,
            access=kind("127.0.0.1", TOKEN, made=True),
            source="run" if controlled else "replay",
            title="a title",
            ask=self._ask if controlled else None,
            log=self.log.append,
        )
        self.server = MonitorServer(offer, 0)

    def _ask(self, action):
        self.asked.append(action)
        answer = Future()
        if self.answer is not None:
            answer.set_result(self.answer)
        return answer

    def __enter__(self):
        self.server.start()
        self.url = f"http://127.0.0.1:{self.server.port}"
        return self

    def __exit__(self, *_):
        self.server.close()


async def update(viewer, limit=PATIENCE):
    message = await asyncio.wait_for(viewer.receive_json(), limit)
    await viewer.send_str(str(message.get("number")))
    return message


def visit(served, talk):
    async def run():
        async with aiohttp.ClientSession(served.url) as client:
            return await talk(client)

    return asyncio.run(run())


def test_everything_comes_first_and_then_what_has_changed():
    async def talk(client):
        async with client.ws_connect("/live") as viewer:
            await viewer.send_json({"token": ""})
            first = await update(viewer)
            served.state.take(AxisPlace(1, (0.1, 0.2, 0.3)))
            second = await update(viewer)
            # A viewer that comes late misses nothing.
            async with client.ws_connect("/live") as late:
                await late.send_json({"token": TOKEN})
                return first, second, await update(late)

    with Served() as served:
        first, second, late = visit(served, talk)
    assert set(first["sections"]) == NAMES == set(late["sections"])
    assert first["hello"] == {"source": "run", "title": "a title", "controls": False}
    assert late["hello"]["controls"] is True
    assert set(second["sections"]) == {"position"}
    assert late["sections"]["position"] == second["sections"]["position"]
    assert second["sections"]["position"]["at"] == [100.0, 200.0, 300.0]


def test_the_server_speaks_though_nothing_changes(monkeypatch):
    monkeypatch.setattr(server_module, "BEAT", 0.1)

    async def talk(client):
        async with client.ws_connect("/live") as viewer:
            await viewer.send_json({})
            return [await update(viewer) for _ in range(3)]

    with Served() as served:
        told = visit(served, talk)
    assert [one["sections"] for one in told[1:]] == [{}, {}]


def test_a_viewer_that_takes_nothing_is_cut_off_and_delays_nobody(monkeypatch):
    monkeypatch.setattr(server_module, "STALL_LIMIT", 3.0)

    async def talk(client):
        stalled = await client.ws_connect("/live")
        await stalled.send_json({"token": ""})
        await asyncio.wait_for(stalled.receive_json(), PATIENCE)  # and never says that it has it
        async with client.ws_connect("/live") as viewer:
            await viewer.send_json({"token": ""})
            await update(viewer)
            seen = 0
            while served.server.viewers > 1:
                seen += 1
                served.state.take(AxisPlace(seen, (seen * 1e-3, 0.0, 0.0)))
                got = await update(viewer)
                assert got["sections"]["position"]["at"][0] == pytest.approx(seen)
            rest = [await asyncio.wait_for(stalled.receive(), PATIENCE) for _ in range(1)]
            return seen, rest

    with Served() as served:
        seen, rest = visit(served, talk)
    assert seen > 2
    # It was sent one update and no more: nothing has piled up for it.
    assert rest[0].type in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR)


def test_a_slow_viewer_gets_the_newest_and_not_all():
    async def talk(client):
        async with client.ws_connect("/live") as viewer:
            await viewer.send_json({"token": ""})
            first = await asyncio.wait_for(viewer.receive_json(), PATIENCE)
            for k in range(50):
                served.state.take(AxisPlace(k, (k * 1e-3, 0.0, 0.0)))
            await viewer.send_str(str(first["number"]))
            return await update(viewer)

    with Served() as served:
        told = visit(served, talk)
    assert told["sections"]["position"]["at"][0] == pytest.approx(49.0)
    assert told["number"] == 2


def test_control_needs_the_token_and_is_logged():
    async def talk(client):
        got = []
        for headers in ({}, {"X-Stepdiag-Token": "wrong"}, {"X-Stepdiag-Token": TOKEN}):
            async with client.post("/control/start", headers=headers) as answer:
                got.append((answer.status, await answer.json()))
        async with client.get("/control/start", headers={"X-Stepdiag-Token": TOKEN}) as answer:
            got.append(answer.status)
        async with client.post("/control/dance", headers={"X-Stepdiag-Token": TOKEN}) as answer:
            got.append(answer.status)
        return got

    with Served() as served:
        bare, wrong, right, by_get, unknown = visit(served, talk)
    assert bare == wrong == (403, {"done": False, "text": "control needs the token"})
    assert right == (200, {"done": True, "text": "done"})
    assert by_get in (404, 405) and unknown == 404
    assert served.asked == ["start"]
    assert served.log == [
        "127.0.0.1 asked to start without the token: refused",
        "127.0.0.1 asked to start without the token: refused",
        "127.0.0.1 asks to start the run",
        "127.0.0.1 asked to start the run: done",
    ]


@pytest.mark.parametrize(
    ("served", "status", "text"),
    [
        (Served(controlled=False), 409, "a recording cannot be controlled"),
        (
            Served(answer=RequestAnswer(False, "cannot start: there is no recorder node")),
            409,
            "recorder",
        ),
        (Served(answer=None), 409, "whether start was done is not known"),
    ],
    ids=["replay", "refused", "no answer"],
)
def test_what_cannot_be_done_is_said(served, status, text, monkeypatch):
    monkeypatch.setattr(server_module, "ANSWER_LIMIT", 0.2)

    async def talk(client):
        async with client.post("/control/start", headers={"X-Stepdiag-Token": TOKEN}) as answer:
            return answer.status, await answer.json()

    with served:
        got, told = visit(served, talk)
    assert got == status and text in told["text"] and told["done"] is False


def test_from_elsewhere_only_the_token_shows_anything():
    async def talk(client):
        got = []
        for token in ("", "wrong", TOKEN):
            async with client.ws_connect("/live") as viewer:
                await viewer.send_json({"token": token})
                got.append(await update(viewer))
        return got

    with Served(Remote) as served:
        bare, wrong, right = visit(served, talk)
    assert bare == wrong == {"refused": "this page needs the token"}
    assert set(right["sections"]) == NAMES


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Origin": "http://evil.example"}],
    ids=["name", "site"],
)
def test_what_another_site_brings_about_is_refused(headers):
    async def talk(client):
        got = []
        for path in ("/", "/live"):
            async with client.get(path, headers=headers) as answer:
                got.append(answer.status)
        async with client.post(
            "/control/abort", headers={**headers, "X-Stepdiag-Token": TOKEN}
        ) as answer:
            got.append(answer.status)
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await client.ws_connect("/live", headers=headers)
        return got

    with Served() as served:
        assert visit(served, talk) == [403, 403, 403]
    assert served.asked == []


def test_the_page_is_whole_and_asks_nothing_of_elsewhere():
    async def talk(client):
        found = {}
        for name in ("", "main.js", "sections.js", "charts.js", "volume.js", "style.css",
                     "uPlot.iife.min.js", "uPlot.min.css", "uPlot.LICENSE.txt"):  # fmt: skip
            async with client.get(f"/{name}") as answer:
                found[name] = (answer.status, answer.headers, await answer.text())
        async with client.get("/../server.py") as answer:
            assert answer.status == 404
        return found

    with Served() as served:
        found = visit(served, talk)
    for name, (status, headers, text) in found.items():
        assert status == 200 and text, name
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        if name in ("", "main.js", "sections.js", "charts.js", "style.css"):
            assert "://" not in text.replace("://${location.host}", ""), name
    assert "MIT" in found["uPlot.LICENSE.txt"][2]


def test_a_port_that_is_taken_is_said_in_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        offer = Offer(PageState(), PageAccess("127.0.0.1", TOKEN, True), "run", "", None, print)
        with refused(Refusal, "busy", "127.0.0.1", str(port)):
            MonitorServer(offer, port).start()


def test_the_messages_are_plain_json():
    _, text = PageState().update()
    assert json.loads(text) and "NaN" not in text


@pytest.mark.parametrize("text", ["[" * 4000, '{"a":' * 800, "[" * 2**16, "nonsense"])
def test_what_is_no_greeting_closes_the_socket_and_nothing_is_logged(text, caplog):
    async def talk(client):
        async with client.ws_connect("/live") as viewer:
            await viewer.send_str(text)
            return await asyncio.wait_for(viewer.receive(), PATIENCE)

    with Served() as served:
        answer = visit(served, talk)
    assert answer.type is aiohttp.WSMsgType.CLOSE
    assert not [one for one in caplog.records if one.levelname == "ERROR"]
