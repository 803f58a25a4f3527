"""How a place of the machine is written, the same in tables, pictures and pages."""

from math import nan

from stepdiag_ros.text.numbers import UNKNOWN, place_in_mm


def test_a_place_is_written_in_millimetres_with_its_axes():
    assert place_in_mm((0.03, -0.0605, 1.1)) == "X 30.0, Y -60.5, Z 1100.0 mm"


def test_a_coordinate_that_is_not_known_is_said_to_be_unknown():
    assert place_in_mm((nan, 0.0, 0.1)) == f"X {UNKNOWN}, Y 0.0, Z 100.0 mm"
