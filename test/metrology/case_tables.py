"""Reads the run tables of test/data/cases without the package's own importer."""

import csv
from itertools import groupby
from pathlib import Path

import numpy as np
import yaml

from stepdiag_ros.metrology.geometry import TRANSLATIONS
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Line, Volume

CASES = Path(__file__).parent.parent / "data" / "cases"


def load_case(name):
    case = yaml.safe_load((CASES / name / "case.yaml").read_text())
    truth = yaml.safe_load((CASES / name / "truth.yaml").read_text())
    volume = Volume(tuple(case["origin_m"]), tuple(case["step_m"]), case["blocks"])
    with (CASES / name / "run.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    lines = []
    by_setup = groupby(rows, key=lambda row: (row["kind"], row["line"], row["order"]))
    for setup, ((kind, line, order), group) in enumerate(by_setup):
        by_pass = groupby(group, key=lambda row: (int(row["repeat"]), row["direction"]))
        for (repeat, direction), stops in by_pass:
            stops = list(stops)
            lines.append(
                MeasuredLine(
                    line=Line(kind, line, order, repeat, direction),
                    line_index=len(lines),
                    attempt=1,
                    setup=f"{line} {order} {setup}",
                    time=np.array([float(row["time_s"]) for row in stops]),
                    end_time=0,
                    target=np.array([[float(row[f"{a}_m"]) for a in "xyz"] for row in stops]),
                    displacement=np.array([float(row["reading_m"]) for row in stops]),
                    standard_uncertainty=np.full(len(stops), float(case["reading_noise_m"])),
                    environment=np.full((len(stops), 4), np.nan),
                )
            )
    curves = {name: np.array([float(v) for v in truth[name]]) for name in TRANSLATIONS}
    return Measurement(volume, tuple(lines)), curves


def rms_error(result, truth):
    return float(np.sqrt(np.mean([(result.curves[n] - truth[n]) ** 2 for n in TRANSLATIONS])))
