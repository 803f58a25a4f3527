"""Air and material over the time of a run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.plots.style import BLUE, Sheet, panel_title, scales

_QUANTITIES = {
    "air_temperature": ("Air temperature", "°C", 1.0),
    "air_pressure": ("Air pressure", "hPa", 1e-2),
    "relative_humidity": ("Relative humidity", "%", 100.0),
    "material_temperature": ("Material temperature", "°C", 1.0),
}
"""Field of ``measurement.Environment`` → words, unit shown, factor from SI."""
_MINUTE = 60e9
"""ns."""
_COLUMNS = 4


def weather(
    values: Sequence[SensorValue],
    *,
    title: str | None = None,
    stamp: str = "",
    axes: Any = None,
) -> Figure | None:
    """Draw what the weather sensors told over the time of a run; None where they told nothing.

    Args:
        values: of a run (``RecordedRun.weather()``).
        title: heading; None: one that says what is shown; empty: none.
        stamp: what the figure was made from.
        axes: to draw in, one for each quantity, instead of a new figure.
    """
    told = {name: [one for one in values if one.name == name] for name in _QUANTITIES}
    told = {name: found for name, found in told.items() if found}
    if not told:
        return None
    begin = min(one.time for one in values)
    sheet = Sheet(len(told), _COLUMNS, 1.25, axes=axes, gap=(0.65, 0.55), left=0.7)
    for number, (panel, (name, found)) in enumerate(zip(sheet.panels, told.items(), strict=True)):
        words, unit, factor = _QUANTITIES[name]
        minutes = np.array([(one.time - begin) / _MINUTE for one in found])
        panel.plot(minutes, [one.value * factor for one in found], color=BLUE, linewidth=1.0)
        panel_title(panel, words)
        scales(panel, "time / min" if sheet.last_in_column(number) else "", unit)
    silent = [_QUANTITIES[name][0].lower() for name in _QUANTITIES if name not in told]
    said = [f"Measured by no sensor: {', '.join(silent)}."] if silent else []
    heading = "Air and material during the run"
    return sheet.finish(heading if title is None else title, small_print=said, stamp=stamp)
