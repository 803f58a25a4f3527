"""What in a machine has a shape like that of a gap without a name: a hint, never a name."""

from stepdiag_ros.metrology.discrepancy.findings import Dependence
from stepdiag_ros.metrology.effects.learned_shape import READING
from stepdiag_ros.metrology.geometry import AXES

_HINTS = (
    (
        {"place", "sense"},
        "backlash that changes along the travel, as of a screw that is worn in one place",
    ),
    (
        {"turned"},
        "friction or a drive that creeps after each reversal, such as a preload that relaxes",
    ),
    (
        {"jumps"},
        "a mirror or a clamp that is loose, a counter that slips and slips back, or a shock",
    ),
    (
        {"path"},
        "air that is warmer or colder at one place of the beam's path, such as above a motor",
    ),
    ({"place", "temperature"}, "a part that expands and bends as the machine warms up"),
    ({"place", "time"}, "a part that warms up away from every sensor and bends as it does"),
    (
        {"place", "periodically"},
        "a scale or a screw with an error within its period, to which another axis adds",
    ),
    ({"periodically"}, "a cooler, a pump or an air conditioning that switches on and off"),
    ({"temperature"}, "a part that expands, or air on the path of the beam"),
    ({"time"}, "a drift of the laser, or a part that warms up away from every sensor"),
    (
        {"place"},
        "a structure that bends under a load that travels, or a guideway that is worn or distorted"
        " where two axes meet",
    ),
    ({"sense"}, "backlash, or a measuring system that is dragged along"),
)
"""Words that stand in the drivers of a dependence → what has such a shape; the first counts."""
_DRAGGED = (
    "a part that the motion of another axis drags or tilts, such as a drag chain, a cover or a"
    " counterweight"
)


def hints(dependence: Dependence) -> list[str]:
    """Return what has such a shape, in words; nothing where nothing is known that has."""
    drivers = " ".join(dependence.drivers)
    for words, hint in _HINTS:
        if all(word in drivers for word in words):
            own = f"the sense of {dependence.acts_on}'s"
            if "sense" in words and dependence.acts_on in AXES and own not in drivers:
                return [_DRAGGED]
            if dependence.acts_on == READING and words == {"place"}:
                return ["a refractive index that differs along the path of the beam"]
            return [hint]
    return []
