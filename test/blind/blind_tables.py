"""Run tables and case files as a workflow gets them."""

import csv
import io

import yaml

HEADER = (
    "time_s,kind,line,order,repeat,direction,stop,x_m,y_m,z_m,reading_m,"
    "air_temperature_degC,air_pressure_Pa,relative_humidity,material_temperature_degC"
)
MIRROR = ",mirror_offset_m"
"""Column of a run with a mirror that is mounted elsewhere on some lines: X Y Z."""


def table_rows(run, readings):
    """Rows of a run table as lists of texts, in the order of the header."""
    return [
        [
            f"{run.time[n]:.1f}",
            *(str(word) for word in row),
            *(f"{value:.6f}" for value in run.position[n]),
            f"{readings[n] + 0.0:.10f}",
            f"{run.air[n]:.4f}",
            f"{run.pressure[n]:.1f}",
            f"{run.humidity[n]:.3f}",
            f"{run.material[n]:.4f}",
        ]
        for n, row in enumerate(run.rows)
    ]


def written(rows, header=HEADER):
    """Text of a table of rows."""
    text = io.StringIO()
    text.write(header + "\n")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def table_text(run, readings):
    rows = table_rows(run, readings)
    if not run.mirror.any():
        return written(rows)
    mounts = [" ".join(f"{value:g}" for value in place) for place in run.mirror]
    told = [[*row, mount] for row, mount in zip(rows, mounts, strict=True)]
    return written(told, HEADER + MIRROR)


def case_text(plan):
    """What is told of the machine; the noise only where the plan says so."""
    told = {
        "units": "SI",
        "chain": list(plan.chain),
        "mirror_on": "tool",
        "laser_on": "workpiece",
        "origin_m": [0.0, 0.0, 0.0],
        "step_m": list(plan.step),
        "blocks": plan.blocks,
        "repeats": plan.repeats,
        "dead_path_m": plan.dead_path,
    }
    if plan.told_noise:
        told["reading_noise_m"] = plan.noise
    return yaml.safe_dump(told, sort_keys=False)
