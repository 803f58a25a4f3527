"""A rewritten NC program and its remaining error as lines of text."""

from math import isfinite

from stepdiag_ros.evaluation.nc_correction import NcReport
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI

_MOST_SHOWN = 12


def text_lines(report: NcReport) -> list[str]:
    """Return the report as lines of text, lengths in µm and mm."""
    made, proof = report.rewritten, report.proof
    lines = [
        f"{report.program}: {made.changed} moves corrected, {proof.moves} feed moves over"
        f" {IN_MILLI * proof.length:.1f} mm written as {proof.pieces}",
        f"map: {'; '.join(report.origin.lines()[:3])}",
        "",
        "error of the tool's way, µm        largest      rms   largest in line",
    ]
    rows = (
        ("feed moves before", proof.before),
        ("feed moves after", proof.after),
        ("ends of rapid moves before", proof.rapid_before),
        ("ends of rapid moves after", proof.rapid_after),
    )
    lines += [
        f"  {name:<30}{_micro(one.largest)}{_micro(one.rms)}   {one.line or '-'}"
        for name, one in rows
    ]
    lines += [
        "",
        f"tolerance: {IN_MICRO * report.settings.tolerance:g} µm; standard uncertainty of the map"
        f" itself on these ways: {_micro(proof.map_uncertainty).strip()} µm at most",
    ]
    if made.held:
        lines.append(f"outside the measured box, corrected as at its edge: {_listed(made.held)}")
    for line, reason in made.uncorrected[:_MOST_SHOWN]:
        lines.append(f"line {line} is passed as it is: {reason}")
    if len(made.uncorrected) > _MOST_SHOWN:
        lines.append(f"… and {len(made.uncorrected) - _MOST_SHOWN} lines more")
    lines += [f"note: {remark}" for remark in report.all_remarks]
    return lines


def _micro(value: float) -> str:
    return f"{IN_MICRO * value:9.3f}" if isfinite(value) else f"{'unknown':>9}"


def _listed(numbers: tuple[int, ...]) -> str:
    shown = ", ".join(str(number) for number in numbers[:_MOST_SHOWN])
    more = f" and {len(numbers) - _MOST_SHOWN} more" if len(numbers) > _MOST_SHOWN else ""
    return f"lines {shown}{more}" if len(numbers) > 1 else f"line {shown}"
