"""Long work for a node in a process of its own, of low priority: the node goes on meanwhile.

A thread would not do. While it computes, the node's callbacks have to wait for the interpreter, and
where the computer is busy a thread of low priority keeps them waiting for seconds.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from threading import Lock, Thread
from typing import IO, Any

YIELDING = 10
"""Niceness of the process: whatever else wants the processor during a measurement goes first."""
_DONE, _REFUSED, _FAILED = "done", "refused", "failed"


class WorkFailed(RuntimeError):
    """The work came to no end; the text says why, and where in the program if that is known."""


class BackgroundProcess:
    """Calls functions in a process of its own, one at a time. Starts at once.

    The process ends with the one that started it, however that ends.
    """

    def __init__(self) -> None:
        self._one_at_a_time = Lock()
        self._process: subprocess.Popen[bytes] | None = self._started()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Have a function called; it must be one of a module, and all values such as pickle takes.

        Returns:
            what will hold the result, or the ValueError that the function raised, or WorkFailed if
            it raised anything else or the process has died.
        """
        future: Future[Any] = Future()
        Thread(target=self._ask, args=(future, function, arguments), daemon=True).start()
        return future

    def end(self) -> None:
        """End the process, whatever it is doing."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()  # also closes the pipes

    @staticmethod
    def _started() -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [sys.executable, "-m", "stepdiag_ros.nodes.background"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def _ask(self, future: "Future[Any]", function: Callable[..., Any], arguments: Any) -> None:
        with self._one_at_a_time:
            process = self._process
            if process is None:
                return
            if process.poll() is not None:
                process = self._process = self._started()
            how, what = _exchange(process, (function, arguments))
        if how == _DONE:
            future.set_result(what)
        else:
            future.set_exception((ValueError if how == _REFUSED else WorkFailed)(what))


def _exchange(process: "subprocess.Popen[bytes]", request: Any) -> tuple[str, Any]:
    """Ask the process and return what became of it, and the result or a text."""
    try:
        if process.stdin is None or process.stdout is None:
            raise WorkFailed("it was started without pipes")
        pickle.dump(request, process.stdin)
        process.stdin.flush()
        how, what = pickle.load(process.stdout)
    except (EOFError, OSError, pickle.UnpicklingError):
        process.kill()
        code = process.wait()
        return _FAILED, f"the process ended with code {code} (negative: by that signal)"
    except Exception as error:  # whoever waits for the result shall hear of it
        return _FAILED, f"{type(error).__name__}: {error}"
    return how, what


def _serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Do what is asked until nobody asks any more."""
    while True:
        try:
            function, arguments = pickle.load(requests)
        except EOFError:
            return
        try:
            reply = _DONE, function(*arguments)
        except ValueError as error:
            reply = _REFUSED, str(error)
        except Exception:  # the text is all that is left of what another package raised
            reply = _FAILED, traceback.format_exc().strip()
        pickle.dump(reply, replies)
        replies.flush()


def main() -> None:
    """Be the process."""
    # Ctrl-C is for the node, which then ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(YIELDING)
    # Whatever is printed while working must not get between the replies.
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with contextlib.suppress(BrokenPipeError):
        _serve(sys.stdin.buffer, replies)


if __name__ == "__main__":
    main()
