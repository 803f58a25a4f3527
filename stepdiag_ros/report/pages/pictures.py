"""Pictures for pages: which plot is drawn from what, and the drawing beside other work.

matplotlib takes longer to be imported and to draw than all of the evaluation. So what is to be
drawn is only named here, by the functions of ``stepdiag_ros.plots``, and drawn in a process of its
own while this one goes on.
"""

import base64
import gc
import signal
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

from stepdiag_ros.metrology.refusal import Unusable

DOTS_PER_INCH = 150
"""Of pictures in pages: sharp in print at the width that they are made for."""


@dataclass(frozen=True)
class Drawing:
    """A picture that is to be drawn.

    Attributes:
        function: name of a function of ``stepdiag_ros.plots``.
        arguments: of the function.
        caption: what it shows, in words.
        keywords: of the function.
    """

    function: str
    arguments: tuple[Any, ...]
    caption: str
    keywords: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawn:
    """A picture in a page.

    Attributes:
        source: data URI; empty where the plot has nothing to show.
        caption: what it shows, or why nothing, in words.
        width: inches at which it is printed at its own size.
    """

    source: str
    caption: str
    width: float


def draw(drawing: Drawing) -> Drawn | None:
    """Draw a picture in this process; None where the plot has nothing to show and no reason."""
    from stepdiag_ros import plots

    try:
        figure = getattr(plots, drawing.function)(*drawing.arguments, **drawing.keywords)
    except ValueError as error:
        return Drawn("", str(error), 0.0)
    if figure is None:
        return None
    data = base64.b64encode(plots.png_bytes(figure, dpi=DOTS_PER_INCH)).decode("ascii")
    return Drawn(
        f"data:image/png;base64,{data}", drawing.caption, round(float(figure.get_figwidth()), 3)
    )


def _get_ready() -> None:
    """Import what drawing needs, while the other process reads and computes."""
    # What is imported stays until the end: looking through it for unused cycles is in vain.
    gc.disable()
    from stepdiag_ros import plots

    for name in plots.__all__:
        getattr(plots, name)
    gc.freeze()
    gc.enable()


class Studio:
    """Draws pictures in the order in which they are asked for, in a process of its own or here.

    Args:
        pool: the process; None: pictures are drawn here, when they are fetched.
    """

    def __init__(self, pool: ProcessPoolExecutor | None = None) -> None:
        self._pool = pool
        self._asked: dict[tuple[str, str], Drawing] = {}
        self._begun: dict[tuple[str, str], Future[Drawn | None]] = {}

    def ask(self, chapter: str, drawings: Mapping[str, Drawing]) -> None:
        """Ask for the pictures of a chapter.

        Args:
            chapter: its key.
            drawings: name → what is to be drawn.
        """
        for name, drawing in drawings.items():
            self._asked[chapter, name] = drawing
            if self._pool is not None:
                self._begun[chapter, name] = self._pool.submit(draw, drawing)

    def fetch_all(self) -> dict[str, dict[str, Drawn]]:
        """Return the pictures that were asked for, by chapter and name.

        Those that have nothing to show are not among them.

        Raises:
            OSError: the process that draws has ended.
        """
        drawn: dict[str, dict[str, Drawn]] = {}
        try:
            for (chapter, name), drawing in self._asked.items():
                begun = self._begun.get((chapter, name))
                one = draw(drawing) if begun is None else begun.result()
                if one is not None:
                    drawn.setdefault(chapter, {})[name] = one
        except BrokenProcessPool:
            raise Unusable(
                "the process that draws the pictures has ended before it was done: is there enough"
                " memory?",
                fault="stopped",
            ) from None
        return drawn


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process is started, which then never gets it.

    A terminal sends it to both. The other process ends when this one ends the pool; by itself it
    would tell its own end in a traceback. What is blocked stays so in a new process from its first
    instruction on, which no function that it runs could bring about.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # A thread of a numerical library may take the signal in spite of that, and Python would then
    # raise it here, with the new process half begun.
    come: list[int] = []
    handler = None
    if threading.current_thread() is threading.main_thread():
        handler = signal.signal(signal.SIGINT, lambda number, _: come.append(number))
    try:
        yield
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if come:
        signal.raise_signal(signal.SIGINT)


@contextmanager
def studio(beside: bool = True) -> Iterator[Studio]:
    """Return a place to have pictures drawn while the block runs.

    Args:
        beside: in a process of its own; False: in this one, when they are fetched.
    """
    if not beside:
        yield Studio()
        return
    # A new interpreter: what was forked from a process with threads may hang.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with interrupts_held():
            pool.submit(_get_ready)
        try:
            yield Studio(pool)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
