"""What was measured, with what, when and by whom, and in what weather."""

import math
from collections import Counter
from collections.abc import Mapping
from datetime import datetime, timezone
from typing import Any

import numpy as np

from stepdiag_ros import __version__
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.evaluation.flown import FlownRun
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay
from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR, STEP_DIAGONAL, Plan
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.plots.places import FLAT, HALF
from stepdiag_ros.report.pages.material import Material
from stepdiag_ros.report.pages.page import Fact
from stepdiag_ros.report.pages.pictures import Drawing
from stepdiag_ros.report.pages.section import ReportSection, SectionContent
from stepdiag_ros.report.pages.tracker_facts import tracker_facts
from stepdiag_ros.schemas import number
from stepdiag_ros.text.extent import extent_words
from stepdiag_ros.text.intake import parse_yaml
from stepdiag_ros.text.numbers import UNKNOWN, plain
from stepdiag_ros.text.table import Table, new_table

_CLEAR = 3.0
"""Standard uncertainties from which on delays differ with the sense of the motion."""
_ANY_DATE = 1e8
"""s since 1970: a run that is said to be older tells no date."""
_KINDS = {
    LINEAR: "lines along an axis",
    STEP_DIAGONAL: "step diagonals",
    DIAGONAL: "diagonals, all axes at once",
}
_WEATHER = {
    "air_temperature": ("air temperature", "°C", 1.0, 2),
    "material_temperature": ("material temperature", "°C", 1.0, 2),
    "air_pressure": ("air pressure", "hPa", 0.01, 2),
    "relative_humidity": ("relative humidity", "%", 100.0, 1),
}
"""Field of an environment → in words, unit that people read, factor, decimals."""


def _date(nanoseconds: int) -> datetime | None:
    seconds = nanoseconds * 1e-9
    return datetime.fromtimestamp(seconds, timezone.utc) if seconds > _ANY_DATE else None


def _words_of(date: datetime | None, simulated: bool | None, stated: str = "") -> str:
    if date is None:
        return stated or UNKNOWN
    # A simulated cell may run faster than time goes by, and its clock then ahead of any other.
    return f"{date:%Y-%m-%d %H:%M:%S} UTC{' (simulated clock)' if simulated else ''}"


def begun_and_ended(recorded: RecordedRun) -> tuple[datetime | None, datetime | None]:
    """Return when a run began and when its last line ended, UTC; None where that is not known."""
    end = max((line.end_time for line in recorded.measurement.lines), default=0)
    return _date(recorded.start_time), _date(end)


def _duration(recorded: RecordedRun) -> float:
    """Return how long a run took, s; of one without a date, from first to last stop."""
    begin, end = begun_and_ended(recorded)
    if begin is not None and end is not None:
        return (end - begin).total_seconds()
    times = np.concatenate([np.empty(0), *(line.time for line in recorded.measurement.lines)])
    known = times[np.isfinite(times)]
    return float(np.ptp(known)) if len(known) else math.nan


def parameters(material: Material, node: str) -> Mapping[str, Any]:
    """Return the parameters of a node in the run; empty where the bag does not tell them."""
    text = "" if material.header is None else material.header.parameters
    parsed = parse_yaml(text, f"{material.recorded.path}: parameters") if text else None
    found = parsed.get(f"/{node}") if isinstance(parsed, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def instrument(material: Material) -> str:
    """Return what the bag states about the interferometer, in words."""
    known = parameters(material, "interferometer")
    if not known:
        return material.recorded.told_by_source.get("instrument") or UNKNOWN
    parts = [f"driver {known.get('device', UNKNOWN)}"]
    if identity := known.get("hardware_id"):
        parts.append(f"number {identity}")
    if "wavelength" in known:
        parts.append(f"vacuum wavelength {float(known['wavelength']) * 1e9:.4f} nm")
    if "compensation" in known:
        words = {"instrument": "by the instrument", "own": "by stepdiag_ros", "off": "none"}
        how = str(known["compensation"])
        parts.append(f"compensation for the air: {words.get(how, how)}")
    return ", ".join(parts)


def _laser_number(material: Material) -> str:
    return str(parameters(material, "interferometer").get("hardware_id") or "")


def _instrument_words(material: Material) -> str:
    """Return what was given of the instrument; a tracker is described by the plan."""
    return "" if material.recorded.plan.tracker is not None else material.given.instrument.name


def _controller(material: Material) -> str:
    known = parameters(material, "cnc_bridge")
    identity = known.get("hardware_id")
    return f"driver {known['device']}{f', number {identity}' if identity else ''}" if known else ""


def _run_facts(material: Material) -> list[Fact]:
    given, report, recorded = material.given, material.report, material.recorded
    begin, end = begun_and_ended(recorded)
    seconds = _duration(recorded)
    duration = f"{seconds / 60.0:.0f} min" if math.isfinite(seconds) else ""
    duration += " (simulated clock)" * bool(duration and report.simulated)
    simulated = "a simulated machine" if report.simulated else ""
    facts = [
        ("Customer", given.customer or UNKNOWN),
        ("Machine", ", ".join(one for one in (report.machine, simulated) if one) or UNKNOWN),
        ("Machine number", given.serial or UNKNOWN),
        ("Order of the axes", f"{report.chain} (workpiece to tool)" if report.chain else UNKNOWN),
        ("Controller", _controller(material) or UNKNOWN),
        ("Instrument", instrument(material)),
        ("Laser number", given.laser_serial or _laser_number(material) or UNKNOWN),
        ("Laser certificate", given.laser_certificate or UNKNOWN),
        ("Uncertainty of the instrument", _instrument_words(material)),
        ("Place", given.place or UNKNOWN),
        ("Measured by", given.operator or UNKNOWN),
        ("Begun", _words_of(begin, report.simulated, recorded.told_by_source.get("test_date", ""))),
        ("Last line ended", _words_of(end, report.simulated)),
        ("Duration", duration or UNKNOWN),
        ("End of the run", (report.passes and report.passes.end) or UNKNOWN),
        ("Remark", given.remark),
    ]
    return [Fact(name, text) for name, text in facts if text]


def condition_facts(material: Material) -> list[Fact]:
    """Return machine, instrument, box, time and weather for the summary."""
    wanted = (
        *("Machine", "Machine number", "Place", "Instrument", "Laser number"),
        *("Laser certificate", "Begun", "Duration"),
    )
    facts = [one for one in _run_facts(material) if one.name in wanted]
    facts += [one for one in plan_facts(material) if one.name in ("Measured box", "Lines")]
    weather = weather_figures(material)
    for name, (mean, low, high, _) in weather.items():
        words, unit, factor, decimals = _WEATHER[name]
        shown = [plain(value * factor, decimals) for value in (mean, low, high)]
        text = f"{shown[0]} {unit} ({shown[1]} to {shown[2]})"
        facts.append(Fact(f"{words[:1].upper()}{words[1:]}", text))
    if not weather:
        facts.append(Fact("Weather", material.why_not("weather")))
    return [*facts, Fact("Temperature of the results", temperature_words(material))]


def temperature_words(material: Material) -> str:
    """Say at which temperature the results hold."""
    if math.isfinite(material.given.expansion):
        told = material.given.material_temperature
        machine = "as recorded" if told is None else f"{told:g} °C as stated"
        return (
            f"20 °C (ISO 1), corrected with {material.given.expansion * IN_MICRO:.4g} µm/(m K);"
            f" temperature of the machine: {machine}"
        )
    words = "that of the machine during the run; stepdiag_ros corrected nothing to 20 °C"
    if is_imported(material):
        return f"{words}, and whether the source of the imported readings did is unknown"
    return words


def origin_facts(material: Material) -> list[Fact]:
    """Return which software made run and report, and when the report was made."""
    recorded = material.recorded.software_version
    return [
        Fact("Recorded by", f"stepdiag_ros {recorded}" if recorded else UNKNOWN),
        Fact("Evaluated by", f"stepdiag_ros {__version__}"),
        Fact("Date of the report", f"{datetime.now(timezone.utc):%Y-%m-%d} (UTC)"),
    ]


def plan_facts(material: Material) -> list[Fact]:
    """Return the plan: measured box, lines, feed and stops."""
    plan = material.recorded.plan
    feed = f"{plan.feed * 60e3:.0f} mm/min" if plan.feed > 0.0 else UNKNOWN
    return [
        Fact("Plan", plan.name or UNKNOWN),
        Fact("Measured box", extent_words(plan)),
        *(_line_facts(plan) if plan.tracker is None else tracker_facts(plan, plan.tracker)),
        Fact("Feed", feed),
        *_flown_facts(material),
        _stop_fact(material),
    ]


def _stop_fact(material: Material) -> Fact:
    """Return how the stops were read; a table that was imported does not state it."""
    sampling = material.recorded.plan.sampling
    if material.flown:
        return Fact("Ends of a line", f"stays {sampling.dwell:g} s at least")
    if is_imported(material) and not _states_sampling(material):
        return Fact("A stop", f"{UNKNOWN} (imported table)")
    return Fact(
        "A stop",
        f"stays {sampling.dwell:g} s at least; mean of {sampling.window:g} s of readings from"
        f" {sampling.settle:g} s after arrival, which must scatter less than"
        f" {sampling.standard_deviation_limit * IN_MICRO:g} µm",
    )


def is_imported(material: Material) -> bool:
    """Say whether the bag was made from a file of another program."""
    return material.header is not None and "source_file" in material.header.facts


def _states_sampling(material: Material) -> bool:
    """Say whether the plan in the bag states how stops are read, or the bag has the readings."""
    recorded = material.recorded
    plan = parse_yaml(recorded.plan_text, f"{recorded.path}: plan")
    stated = isinstance(plan, Mapping) and "sampling" in plan
    return stated or next(iter(recorded.readings()), None) is not None


def _flown_facts(material: Material) -> list[Fact]:
    """Return how lines were measured while the axes moved, and how long that took."""
    flown = material.flown
    if flown is None:
        return []
    differ = [one for one in flown.reversals if abs(one.delay) > _CLEAR * one.standard_uncertainty]
    vibration = flown.vibration
    shaken = (
        f"{plain(vibration.amplitude * IN_MICRO, 2)} µm at {plain(vibration.frequency, 1)} Hz,"
        " fitted in every move"
        if vibration.found
        else "none was found"
    )
    return [
        Fact(
            "Measured on the fly",
            "at constant feed, with an exact stop and no stay at every corner; each move is a"
            f" regression, and the corners are the nodes. {len(flown.lines)} passes in"
            f" {flown.seconds:.0f} s",
        ),
        Fact("Readings behind positions", f"{_delays(flown.delays)} (k = {COVERAGE_FACTOR:g})"),
        *(
            [
                Fact(
                    "Delay, positive less negative motion",
                    f"{_delays(flown.reversals)} (k = {COVERAGE_FACTOR:g})"
                    + (
                        f". {', '.join(one.axis for one in differ)}: a force that bends the machine"
                        " while it moves, such as friction, acts as well; the curves between the"
                        " nodes contain it, the nodes do not"
                        if differ
                        else ""
                    ),
                )
            ]
            if flown.reversals
            else []
        ),
        Fact("Vibration", shaken),
        Fact(
            "Common to a line",
            f"at most {plain(flown.common * IN_MICRO, 4)} µm of the standard uncertainty of its"
            " nodes comes from the delays",
        ),
    ]


def _delays(delays: tuple[AxisDelay, ...]) -> str:
    return "; ".join(
        f"{delay.axis} {plain(delay.delay * IN_MICRO, 1)} µs ±"
        f" {plain(COVERAGE_FACTOR * delay.standard_uncertainty * IN_MICRO, 1)} µs"
        for delay in delays
    )


def _line_facts(plan: Plan) -> list[Fact]:
    kinds: dict[str, Counter[str]] = {}
    for line in plan.lines:
        kinds.setdefault(line.kind, Counter())[line.name] += 1
    lines = "; ".join(
        f"{_KINDS.get(kind, kind)} {', '.join(names)} ({sum(names.values())} passes)"
        for kind, names in kinds.items()
    )
    return [Fact("Blocks", f"{plan.volume.blocks} on every axis"), Fact("Lines", lines)]


def _origin_facts(material: Material) -> list[Fact]:
    recorded, header = material.recorded, material.header
    return [
        Fact("Run", recorded.run_id or UNKNOWN),
        Fact("Bag", recorded.path.name),
        Fact("SHA-256", material.sha256 or "unknown, the recording is a folder"),
        Fact("Seal", "none" if material.seal is None else material.seal.text),
        *origin_facts(material),
        Fact("Messages", f"schema version {recorded.schema_version}"),
        Fact("Middleware", header.middleware if header and header.middleware else UNKNOWN),
        *_source_facts(material),
    ]


def _source_facts(material: Material) -> list[Fact]:
    """Return what an imported bag's source tells, and which file that is."""
    files = {} if material.header is None else material.header.facts
    named = (("Imported from", "source_file"), ("Its SHA-256", "source_sha256"))
    return [
        *(Fact(words, files[key]) for words, key in named if key in files),
        *(
            Fact(f"Source: {name.replace('_', ' ')}", text)
            for name, text in material.recorded.told_by_source.items()
        ),
    ]


def weather_figures(material: Material) -> dict[str, tuple[float, float, float, int]]:
    """Return what is known of the weather: name → mean, smallest, largest, how many values.

    Without sensors, an imported table may state it for each stop.
    """
    found = {}
    stated = [np.asarray(line.environment) for line in material.measurement.lines]
    for name in _WEATHER:
        values = np.array([one.value for one in material.weather if one.name == name])
        if not material.weather and stated:
            values = np.concatenate(stated)[:, Environment._fields.index(name)]
        values = values[np.isfinite(values)]
        if values.size:
            found[name] = (
                float(np.mean(values)),
                float(np.min(values)),
                float(np.max(values)),
                int(values.size),
            )
    return found


def _weather_table(material: Material) -> Table:
    # The heading above it says what it is.
    table = new_table("", "", "unit", "mean", "lowest", "highest", "values")
    table.columns[1].number = False
    for name, (mean, low, high, count) in weather_figures(material).items():
        words, unit, factor, decimals = _WEATHER[name]
        numbers = (plain(value * factor, decimals) for value in (mean, low, high))
        table.add_row(words, unit, *numbers, str(count))
    return table


def _tell(material: Material) -> SectionContent:
    drawings = {
        "plan": Drawing(
            "plan",
            (material.recorded.plan, material.machine),
            "The measured lines in the box.",
            {"title": ""},
            place=HALF._replace(flatness=0.6),
        )
    }
    if material.weather:
        drawings["weather"] = Drawing(
            "weather",
            (list(material.weather),),
            "Weather during the run.",
            {"title": ""},
            place=FLAT,
        )
    return SectionContent(
        {
            "run": _run_facts(material),
            "plan": plan_facts(material),
            "origin": _origin_facts(material),
            "remarks": [f"Run: {remark}." for remark in _ended(material.report.remarks)],
            "weather": _weather_table(material) if weather_figures(material) else None,
            "no_weather": material.why_not("weather"),
        },
        drawings,
    )


def _ended(texts: tuple[str, ...]) -> list[str]:
    return [text.rstrip(".") for text in texts]


def _document(material: Material) -> dict[str, Any]:
    given, recorded = material.given, material.recorded
    begin, end = begun_and_ended(recorded)
    volume = recorded.plan.volume
    return {
        "customer": given.customer or None,
        "operator": given.operator or None,
        "place": given.place or None,
        "machine_number": given.serial or None,
        "remark": given.remark or None,
        "instrument": instrument(material),
        "controller": _controller(material) or None,
        "begun": None if begin is None else begin.isoformat(),
        "last_line_ended": None if end is None else end.isoformat(),
        "bag": recorded.path.name,
        "sha256": material.sha256 or None,
        "seal": None if material.seal is None else material.seal.as_dict(),
        "run_software_version": recorded.software_version or None,
        "schema_version": recorded.schema_version,
        "told_by_source": dict(recorded.told_by_source),
        "box": {
            "origin": list(volume.origin),
            "step": list(volume.step),
            "blocks": volume.blocks,
        },
        "feed": recorded.plan.feed if recorded.plan.feed > 0.0 else None,
        "weather": {
            name: {"mean": mean, "lowest": low, "highest": high, "values": count}
            for name, (mean, low, high, count) in weather_figures(material).items()
        },
        "on_the_fly": None if material.flown is None else _flown_document(material.flown),
    }


def _flown_document(flown: FlownRun) -> dict[str, Any]:
    vibration = flown.vibration
    return {
        "passes": len(flown.lines),
        "duration": flown.seconds,
        "delays": _delays_document(flown.delays),
        "delays_positive_less_negative_motion": _delays_document(flown.reversals),
        "vibration": {
            "frequency": vibration.frequency,
            "amplitude": vibration.amplitude,
            "standard_uncertainty": number(vibration.standard_uncertainty),
        }
        if vibration.found
        else None,
        "common_standard_uncertainty": flown.common,
    }


def _delays_document(delays: tuple[AxisDelay, ...]) -> dict[str, Any]:
    return {
        one.axis: {"delay": one.delay, "standard_uncertainty": one.standard_uncertainty}
        for one in delays
    }


SECTION = ReportSection(
    "measurement", "What was measured, and how", 10, _tell, _document, by_tracker=True
)
