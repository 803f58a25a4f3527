"""Refractive index against published values, and the count of an interferometer in changing air."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.metrology.air import (
    compensated_displacement,
    index_of,
    raw_displacement,
    refractive_index,
    saturation_vapour_pressure,
)
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal

# Stone & Zimmerman, "Index of refraction of air", NIST Engineering Metrology Toolbox, table 1:
# temperature degC, humidity %, pressure kPa, vacuum wavelength nm, n by modified Edlén,
# n by Ciddor.
NIST = [
    (20, 0, 101.325, 633, 1.000271799, 1.000271800),
    (20, 0, 60, 633, 1.000160920, 1.000160924),
    (20, 0, 120, 633, 1.000321918, 1.000321916),
    (50, 0, 100, 633, 1.000243270, 1.000243285),
    (5, 0, 100, 633, 1.000282750, 1.000282756),
    (-40, 0, 100, 633, 1.000337471, 1.000337580),
    (50, 100, 120, 633, 1.000287864, 1.000287924),
    (40, 75, 120, 633, 1.000299406, 1.000299418),
    (20, 100, 100, 633, 1.000267394, 1.000267394),
    (40, 100, 110, 1700, 1.000270237, 1.000270247),
    (20, 0, 101.325, 1700, 1.000268483, 1.000268479),
    (40, 100, 110, 300, 1.000288922, 1.000289000),
    (20, 0, 101.325, 300, 1.000286579, 1.000286581),
    (-40, 0, 120, 300, 1.000427072, 1.000427233),
]


@pytest.mark.parametrize("row", NIST, ids=str)
def test_index_is_the_published_one(row):
    temperature, humidity, pressure, wavelength, edlen, _ = row
    index = refractive_index(temperature, pressure * 1e3, humidity / 100, wavelength * 1e-9)
    # The table has nine decimals.
    assert index == pytest.approx(edlen, abs=0.6e-9)


@pytest.mark.parametrize("row", [row for row in NIST if 0 <= row[0] <= 20], ids=str)
def test_index_agrees_with_ciddor_at_shop_temperatures(row):
    temperature, humidity, pressure, wavelength, _, ciddor = row
    index = refractive_index(temperature, pressure * 1e3, humidity / 100, wavelength * 1e-9)
    assert index == pytest.approx(ciddor, abs=1e-8)


def test_saturation_pressure_is_the_published_one():
    # IAPWS industrial formulation 1997, table 35: 300 K; triple point 611.657 Pa.
    assert saturation_vapour_pressure(300.0 - 273.15) == pytest.approx(3536.58941301, rel=1e-9)
    assert saturation_vapour_pressure(0.01) == pytest.approx(611.657, rel=1e-5)
    below, above = saturation_vapour_pressure(np.array([-1e-9, 0.0]))
    assert below == pytest.approx(above, rel=2e-4)


def test_index_is_vectorised_and_keeps_unknown_air_unknown():
    index = refractive_index(np.array([20.0, np.nan, 20.0]), 101325.0, np.array([0.5, 0.5, np.nan]))
    assert index.shape == (3,)
    assert index[0] == refractive_index(20.0, 101325.0, 0.5)
    assert np.isnan(index[1:]).all()
    assert math.isnan(index_of(Environment()))
    assert math.isnan(index_of(Environment(20.0, math.nan, 0.5)))
    # The material has nothing to do with the air.
    assert math.isfinite(index_of(Environment(20.0, 101325.0, 0.5, math.nan)))


@pytest.mark.parametrize(
    ("air", "words"),
    [
        ((-60.0, 101325.0, 0.5), a_fault("out_of_range", "-60")),
        ((20.0, 1013.25, 0.5), a_fault("out_of_range", "1013.25")),
        ((20.0, 101325.0, 50.0), a_fault("out_of_range", "50", "0", "1")),
        ((np.array([20.0, 200.0]), 101325.0, 0.5), a_fault("out_of_range", "200")),
    ],
)
def test_impossible_air_is_refused(air, words):
    with refused(Refusal, words):
        refractive_index(*air)


def test_wavelength_out_of_range_is_refused():
    with refused(Refusal, "out_of_range", "633"):
        refractive_index(20.0, 101325.0, 0.5, wavelength=633.0)


@given(
    displacement=st.floats(-10, 10),
    dead_path=st.floats(0, 10),
    temperature=st.floats(10, 35),
    temperature_at_zero=st.floats(10, 35),
)
def test_compensation_undoes_the_count(displacement, dead_path, temperature, temperature_at_zero):
    index = index_of(Environment(temperature, 101325.0, 0.5))
    at_zero = index_of(Environment(temperature_at_zero, 101325.0, 0.5))
    raw = raw_displacement(displacement, dead_path, index, at_zero)
    found = compensated_displacement(raw, dead_path, index, at_zero)
    assert found == pytest.approx(displacement, abs=1e-14 * 20)


def test_count_is_the_change_of_the_optical_path():
    index, at_zero = 1.00027, 1.00028
    raw = raw_displacement(0.2, 0.3, index, at_zero)
    assert raw == pytest.approx(index * (0.3 + 0.2) - at_zero * 0.3, abs=1e-15)


def test_uncorrected_dead_path_leaves_its_known_error():
    # 1 K in a dead path of 1 m is about 0.93 µm.
    at_zero = index_of(Environment(20.0, 101325.0, 0.5))
    index = index_of(Environment(21.0, 101325.0, 0.5))
    raw = raw_displacement(0.0, 1.0, index, at_zero)
    assert compensated_displacement(raw, 0.0, index, at_zero) == pytest.approx(
        -0.95e-6, abs=0.03e-6
    )
    assert compensated_displacement(raw, 1.0, index, at_zero) == pytest.approx(0.0, abs=1e-15)


def test_unknown_air_gives_no_displacement():
    assert math.isnan(compensated_displacement(0.1, 0.3, math.nan, 1.00027))
    assert math.isnan(compensated_displacement(0.1, 0.3, 1.00027, math.nan))
