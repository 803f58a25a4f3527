"""Who may move the machine: commands of the present run, once each, while their sender wants them.

Four things must come together before a command moves anything. The bridge was released for the
run by the sequencer, which happens once at its start, and after each fault when an operator
resumes. The command has not been executed: its number is above all before. It was sent just now,
where time is not simulated. And the sequencer confirms it (``MotionPermit``), again and again until
the command has ended. A command of a recorded run that is played into the same graph, one that was
late on the wire, or one that a middleware delivers twice, lacks at least one of them.
"""

from math import inf, nan


class Silence:
    """For how long a sender has been silent, as far as this process was awake to receive.

    A process that did not get the computer for a while finds in one moment that time has passed,
    and what was sent meanwhile still unread: of such a gap only a part counts.
    """

    LONGEST_STEP = 0.1
    """Real seconds between two looks that count in full."""

    def __init__(self) -> None:
        self._silent = 0.0
        self._looked = nan

    def heard(self, real: float) -> None:
        """Take note that a message arrived (s of a clock that never steps)."""
        self._silent, self._looked = 0.0, real

    def look(self, real: float) -> float:
        """Return for how many s he has been silent; called many times a second."""
        step = real - self._looked
        # Written so that the first look, with no time before it, counts nothing.
        if step > 0.0:
            self._silent += min(step, self.LONGEST_STEP)
        self._looked = real
        return self._silent


class Entitlement:
    """Keeps the account of one bridge.

    Args:
        silence_limit: real s without the sequencer's confirmation after which motion ends.
        age_limit: s of ROS time from which on a command is too old; infinite where time is
            simulated.
    """

    def __init__(self, silence_limit: float, age_limit: float = inf) -> None:
        self.silence_limit = silence_limit
        self._age_limit = age_limit
        self._run = ""
        self._released, self._withdrawn = False, ""
        self._last = 0
        self._wanted, self._wanted_at = 0, -inf
        self._confirmed = False
        self._silence = Silence()

    def begin_run(self, run_id: str) -> None:
        """Take up another run, with its first command; nothing moves before ``release``."""
        self._run, self._last, self._released, self._withdrawn = run_id, 0, False, ""
        self._wanted, self._wanted_at, self._confirmed = 0, -inf, False

    def release(self) -> None:
        """Let commands of the present run move the machine from now on."""
        self._released, self._withdrawn = True, ""

    def withdraw(self, why: str = "") -> None:
        """Let nothing move the machine until it is released again; say why, if that is known."""
        self._released, self._withdrawn = False, why or self._withdrawn

    def permit(self, run_id: str, command_id: int, real: float) -> None:
        """Take the sequencer's word that a command is wanted (s of a clock that never steps).

        It may come a little before the command itself.
        """
        if run_id != self._run or command_id < self._last:
            return
        self._wanted, self._wanted_at = command_id, real
        if command_id == self._last:
            self._confirmed = True
            self._silence.heard(real)

    def is_repetition(self, run_id: str, command_id: int) -> bool:
        """Return whether a command is only a repetition of the last one."""
        return (run_id, command_id) == (self._run, self._last)

    def refusal(self, run_id: str, command_id: int, age: float) -> str:
        """Say why a command may not move the machine, whatever it asks; empty if it may.

        Args:
            run_id: that it names.
            command_id: its number.
            age: s since it was sent, by the clock here.
        """
        if run_id != self._run:
            return f"it belongs to run {run_id}, not to the present one"
        if command_id <= self._last:
            return f"command {self._last} was executed already"
        if not self._released:
            why = f" ({self._withdrawn})" if self._withdrawn else ""
            return (
                "the bridge was not released for it: an operator has to start or resume the run"
                f"{why}"
            )
        # Written so that an age that is not a number is none; a clock that is behind is no better.
        if not abs(age) <= self._age_limit:
            when = f"{age:.1f} s ago" if age > 0.0 else f"{-age:.1f} s from now"
            return f"by the clock here it was sent {when}: it is late, recorded, or clocks differ"
        return ""

    def take_up(self, command_id: int, real: float) -> None:
        """Take note that a command is taken up; it will never be again."""
        self._last = command_id
        fresh = real - self._wanted_at <= self.silence_limit
        self._confirmed = fresh and self._wanted == command_id
        self._silence.heard(real)

    @property
    def confirmed(self) -> bool:
        """Say whether the sequencer has confirmed the command that was taken up last."""
        return self._confirmed

    def lapsed(self, real: float) -> str:
        """Say that the command at work is not wanted any more; empty if it is."""
        silent = self._silence.look(real)
        if silent <= self.silence_limit:
            return ""
        return f"the sequencer has not confirmed command {self._last} for {self.silence_limit:g} s"
