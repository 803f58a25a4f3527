"""A machine with errors and programs, for the tests of rewriting."""

import numpy as np

from stepdiag_ros.compensation.nc_reading import NcSettings
from stepdiag_ros.compensation.nc_rewrite import RewriteSettings
from stepdiag_ros.metrology.geometry import CURVES, ROTATIONS, moving_axis
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

NODES = tuple(np.linspace(low, high, 7) for low, high in ((0.1, 0.4), (-0.2, 0.0), (-0.35, -0.05)))
OFFSET = (0.15, -0.15, -0.3)
"""Machine coordinates of the zero of G54: the box reaches 250, 150, 250 mm beyond it."""
PROGRAM = NcSettings(offsets={"G54": OFFSET, "G55": (0.2, -0.1, -0.2)}, tool_lengths={1: 0.02})


def machine(scale=1.0, rotations=True, seed=3):
    """Return the map of a machine with errors of some 10 µm, some 10 µrad, times a scale."""
    noise = np.random.default_rng(seed)
    curves = {}
    for name in CURVES:
        if name in ROTATIONS and not rotations:
            continue
        size = 2e-5 if name in ROTATIONS else 1e-5
        curves[name] = scale * size * np.cumsum(noise.normal(size=len(NODES[moving_axis(name)])))
        curves[name] -= curves[name][0]
    return VolumetricMap(NODES, curves, chain="YXZ")


def settings(**changes):
    return RewriteSettings(**{"program": PROGRAM, **changes})


MILLING = """%
O1000 (POCKET)
N10 G21 G17 G90 G40 G80 G49
N20 T1 M6
N30 G54 G0 X10. Y5. S3000 M3
N40 G43 H1 Z60.
(first cut)
N50 G1 Z20.5 F200
N60 X120. Y80. F600 M8
N70 G2 X140. Y60. I0. J-20.
N80 G3 X120.0 Y40. R20.
N90 G1 X10.
N100 G91 X30. Y-10. ; incremental
N110 G90 G18 G2 X50. Z30.5 I10. K0.
N120 G17 G4 P1.5
N130 G1 X200. Y30. M9
N140 G0 Z150.
N150 G28 G91 Z0.
N160 G90 M5
N170 M30
%
"""
