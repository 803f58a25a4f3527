"""A little interpreter of G-code, written apart from the program that writes it."""

import re
from dataclasses import dataclass, field

WORD = re.compile(r"([A-Z])(-?\d+\.?\d*)")


@dataclass
class Machine:
    """What a controller did with a program.

    Attributes:
        path: places in mm after each block with motion, each with the axes that it moved.
        stays: place, seconds and the feed at each dwell.
        stops: number of stays before each M0.
    """

    dwell: str = "P_ms"
    place: dict = field(default_factory=lambda: {"X": None, "Y": None, "Z": None})
    feed: float = 0.0
    path: list = field(default_factory=list)
    stays: list = field(default_factory=list)
    stops: list = field(default_factory=list)
    comments: list = field(default_factory=list)
    ended: bool = False

    def run(self, text):
        text.encode("ascii")
        assert text.endswith("\n")
        state = {"mm": False, "absolute": False, "per_minute": False}
        for line in text.splitlines():
            assert not self.ended or line == "%", f"after the end: {line}"
            if line == "%" or re.fullmatch(r"O\d{4} \([^()]*\)", line):
                continue
            block = re.sub(r"^N\d+ ", "", line)
            if block.startswith("("):
                assert re.fullmatch(r"\([A-Z0-9 .,+\-/=\[\]]+\)", block), block
                assert len(block) <= 80
                self.comments.append(block[1:-1])
                continue
            words = WORD.findall(block)
            assert "".join(a + b for a, b in words) == block.replace(" ", ""), block
            self.block([(a, b) for a, b in words], state)
        assert self.ended
        return self

    def block(self, words, state):
        codes = [a + b for a, b in words if a in "GM"]
        if "G4" in codes:
            (letter, number) = next(word for word in words if word[0] in "PXF")
            assert self.dwell[0] == letter and len(words) == 2, words
            if self.dwell == "P_ms":
                assert "." not in number
            else:
                assert "." in number
            seconds = float(number) / (1000.0 if self.dwell == "P_ms" else 1.0)
            self.stays.append((tuple(self.place[a] for a in "XYZ"), seconds, self.feed))
            return
        for code in codes:
            assert code in ("G21", "G90", "G94", "G1", "M0", "M30"), code
        state["mm"] |= "G21" in codes
        state["absolute"] |= "G90" in codes
        state["per_minute"] |= "G94" in codes
        if "M0" in codes:
            self.stops.append(len(self.stays))
        self.ended |= "M30" in codes
        moved = []
        for letter, number in words:
            if letter == "F":
                self.feed = float(number)
            elif letter in "XYZ":
                assert all(state.values()) and self.feed > 0.0 and "G1" in codes
                assert "." in number, "X10 is ten micrometres on some controllers"
                assert not (number.startswith("-") and float(number) == 0.0)
                self.place[letter] = float(number)
                moved.append(letter)
        if moved:
            self.path.append((tuple(self.place[a] for a in "XYZ"), "".join(moved)))
