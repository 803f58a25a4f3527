"""Start, pause, resume and abort for a node that must not wait: asked by one thread, done here."""

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from std_srvs.srv import Trigger

from stepdiag_ros.nodes.operator import SERVICE_LIMIT
from stepdiag_ros.nodes.timing import TimedNode
from stepdiag_ros.viewers.page.control import ACTIONS, LEADERS, RequestAnswer


@dataclass
class _Request:
    action: str
    answer: "Future[RequestAnswer]"
    sent: float = 0.0
    client: Any = None
    future: Any = None


class RunControl:
    """Calls the services by which a run is led.

    Args:
        node: whose thread calls them; it calls ``work`` several times a second.
    """

    def __init__(self, node: TimedNode) -> None:
        self._node = node
        offered = {"sequencer": ACTIONS, "by_hand": ("start", "resume", "abort")}
        self._clients = {
            action: [
                (leader, node.create_client(Trigger, f"{leader}/{action}"))
                for leader in LEADERS
                if action in offered[leader]
            ]
            for action in ACTIONS
        }
        self._asked: deque[_Request] = deque()
        self._sent: list[_Request] = []

    def ask(self, action: str) -> "Future[RequestAnswer]":
        """Ask for one of ``ACTIONS``; safe to be called by any thread."""
        answer: Future[RequestAnswer] = Future()
        self._asked.append(_Request(action, answer))
        return answer

    def work(self) -> None:
        """Send the request, and report the answer."""
        while self._asked:
            self._send(self._asked.popleft())
        for request in list(self._sent):
            self._look_at(request)

    def _send(self, request: _Request) -> None:
        ready = [client for _, client in self._clients[request.action] if client.service_is_ready()]
        if not ready:
            leaders = " or ".join(leader for leader, _ in self._clients[request.action])
            text = f"there is no {leaders} node that could {request.action} a run"
            _tell(request, RequestAnswer(False, text))
            return
        request.sent, request.client = self._node.real_time(), ready[0]
        request.future = ready[0].call_async(Trigger.Request())
        self._sent.append(request)

    def _look_at(self, request: _Request) -> None:
        if request.future.done():
            response = request.future.result()
            _tell(request, RequestAnswer(bool(response.success), str(response.message)))
        elif self._node.real_time() - request.sent > SERVICE_LIMIT:
            request.client.remove_pending_request(request.future)
            # The request has left this computer: only the run's state tells what became of it.
            text = f"no answer yet; whether {request.action} was done is not known: see the state"
            _tell(request, RequestAnswer(False, text))
        else:
            return
        self._sent.remove(request)


def _tell(request: _Request, answer: RequestAnswer) -> None:
    # Whoever has asked may have gone meanwhile.
    if request.answer.set_running_or_notify_cancel():
        request.answer.set_result(answer)
