"""What a run that is over has come to: its bag, the verdict on it, and who is still waited for."""

from dataclasses import dataclass
from enum import IntEnum

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.run.supervision import WORK_LEFT, Peer, Watch, said_of_run

BAG = "bag"
"""Fact by which a recorder says where, on its own computer, the bag of a run is."""
BAG_CLOSED = "bag_closed"
"""Fact by which a recorder says how many messages are in the bag of a run, once it is closed."""
BAG_FAILURE = "bag_failure"
"""Fact by which a recorder says why the bag of a run does not hold all of it."""
LAST_WORD_LIMIT = 3.0
"""Real seconds that a diagnosis node that has no work left may take for its last word."""
UNKNOWN = "UNKNOWN"
"""Verdict on a run that nobody has diagnosed to its end."""


class Outcome(IntEnum):
    """How a goal has ended; the numbers are those of Measure.action."""

    UNKNOWN = 0
    FINISHED = 1
    ABORTED = 2
    REFUSED = 3


@dataclass(frozen=True)
class Conclusion:
    """What there is of a run when nobody is waited for any more (fields as in Measure.action)."""

    verdict: str
    sentence: str
    bag: str
    bag_closed: bool
    bag_text: str


class LastWord:
    """Whether the verdict on a whole run is still to come, for a node that needs it itself.

    Args:
        run_id: of the run.
    """

    def __init__(self, run_id: str) -> None:
        self._run_id = run_id
        self._idle_since: float | None = None

    def awaited(self, watch: Watch, real: float) -> bool:
        """Say whether a diagnosis node still owes its last word, at a real time in s.

        One that is idle and says nothing is waited for ``LAST_WORD_LIMIT``: it may not have noticed
        yet that the run is over, or the run may be too large for it.
        """
        if not watch.present("diagnosis", self._run_id):
            return False
        works = any(
            peer.role == "diagnosis" and peer.facts.get(WORK_LEFT, "0") != "0"
            for peer in watch.peers.values()
        )
        if works or self._idle_since is None:
            self._idle_since = real
        return real - self._idle_since < LAST_WORD_LIMIT


class Aftermath:
    """Follows the nodes that still record or evaluate a run that is over, for a bounded time.

    Args:
        run_id: of the run.
        limit: real seconds after the run's end for which they are waited for.
    """

    def __init__(self, run_id: str, limit: float) -> None:
        self.run_id = run_id
        self._limit = limit
        self._over: float | None = None
        self._worked = 0.0
        self._last_word: tuple[str, str] | None = None

    def over(self, real: float) -> None:
        """Take note that the run has ended, at a real time in s; the first time counts."""
        if self._over is None:
            self._over = self._worked = real

    def diagnosed(self, run_id: str, verdict: str, sentence: str, run_over: bool) -> None:
        """Take the word of a diagnosis; only the one on the whole run counts."""
        if run_id == self.run_id and run_over:
            self._last_word = verdict, sentence

    def awaited(self, watch: Watch, real: float) -> str:
        """Say what is waited for at a real time in s; empty if nothing is, or none is any more.

        Raises:
            ValueError: the run goes on.
        """
        if self._over is None:
            raise Refusal(f"run {self.run_id} goes on", fault="busy")
        workers = watch.workers(real)
        if workers:
            self._worked = real
        if real - self._over > self._limit:
            return ""
        if workers:
            return f"waiting for the last results ({', '.join(workers)})"
        if self._diagnosis_owes(watch) and real - self._worked < LAST_WORD_LIMIT:
            return "waiting for the verdict"
        recorder = self._recorder(watch)
        if recorder is not None and not self._lost(watch, recorder) and self._bag_is_open(recorder):
            return "waiting for the bag to be closed"
        return ""

    def conclusion(self, watch: Watch) -> Conclusion:
        """Return what the run has come to, as far as it is known now."""
        verdict, sentence = self._last_word or (UNKNOWN, self._why_no_verdict(watch))
        recorder = self._recorder(watch)
        if recorder is None:
            text = "no recorder states where it has recorded this run"
            return Conclusion(verdict, sentence, "", False, text)
        messages = said_of_run(recorder, BAG_CLOSED, self.run_id)
        if messages:
            text = f"closed, {messages} messages"
        else:
            text = (
                said_of_run(recorder, BAG_FAILURE, self.run_id)
                or self._lost(watch, recorder)
                or "the recorder has not closed the bag in time"
            )
        bag = said_of_run(recorder, BAG, self.run_id)
        return Conclusion(verdict, sentence, bag, bool(messages), text)

    def _recorder(self, watch: Watch) -> Peer | None:
        """Return the recorder with the newest message of those that have recorded the run."""
        recorders = [peer for peer in watch.peers.values() if said_of_run(peer, BAG, self.run_id)]
        return max(recorders, key=lambda peer: peer.last_seen, default=None)

    def _bag_is_open(self, recorder: Peer) -> bool:
        ends = (BAG_CLOSED, BAG_FAILURE)
        return not any(said_of_run(recorder, fact, self.run_id) for fact in ends)

    def _lost(self, watch: Watch, sought: Peer) -> str:
        """Return the sentence that says that a node is lost; empty if it is not."""
        return next(
            (
                watch.lost[name]
                for name, peer in watch.peers.items()
                if peer is sought and name in watch.lost
            ),
            "",
        )

    def _diagnosis_owes(self, watch: Watch) -> bool:
        return self._last_word is None and watch.present("diagnosis", self.run_id)

    def _why_no_verdict(self, watch: Watch) -> str:
        diagnoses = [peer for peer in watch.peers.values() if peer.role == "diagnosis"]
        if not diagnoses:
            return "no diagnosis node is running"
        last = max(diagnoses, key=lambda peer: peer.last_seen)
        why = self._lost(watch, last) or (last.text if last.faulty else "")
        if not why and last.facts.get(WORK_LEFT, "0") != "0":
            why = "the diagnosis was not done in time"
        return why or "the diagnosis node has not published a verdict on the whole run"
