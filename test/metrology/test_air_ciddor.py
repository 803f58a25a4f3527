"""Ciddor's refractive index against the tables of his paper and of NIST, and against mpmath."""

import mpmath
import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros.metrology.air import (
    EQUATIONS,
    ciddor_index,
    edlen_index,
    index_of,
    refractive_index,
    saturation_vapour_pressure,
)
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal

# Stone & Zimmerman, "Index of refraction of air", NIST Engineering Metrology Toolbox, table 1:
# temperature degC, humidity %, pressure kPa, vacuum wavelength nm, n by Ciddor.
NIST = [
    (20, 0, 101.325, 633, 1.000271800),
    (20, 0, 60, 633, 1.000160924),
    (20, 0, 120, 633, 1.000321916),
    (50, 0, 100, 633, 1.000243285),
    (5, 0, 100, 633, 1.000282756),
    (-40, 0, 100, 633, 1.000337580),
    (50, 100, 120, 633, 1.000287924),
    (40, 75, 120, 633, 1.000299418),
    (20, 100, 100, 633, 1.000267394),
    (40, 100, 110, 1700, 1.000270247),
    (20, 0, 101.325, 1700, 1.000268479),
    (40, 100, 110, 300, 1.000289000),
    (20, 0, 101.325, 300, 1.000286581),
    (-40, 0, 120, 300, 1.000427233),
]
# Ciddor 1996 (Applied Optics 35, 1566), table 1, dry air, 450 ppm CO2, 633 nm:
# degC, kPa, (n - 1)·1e8.
TABLE_1 = [
    (20, 80, 21458.0),
    (20, 100, 26824.4),
    (20, 120, 32191.6),
    (10, 100, 27774.7),
    (30, 100, 25937.2),
]
# Table 2, moist air of the laboratory: degC, Pa, vapour pressure Pa, CO2 ppm, (n - 1)·1e8.
TABLE_2 = [
    (19.526, 102094.8, 1065, 510, 27392.9),
    (19.517, 102096.8, 1065, 510, 27394.0),
    (19.173, 102993.0, 641, 450, 27682.4),
    (19.173, 103006.0, 642, 440, 27685.8),
    (19.188, 102918.8, 706, 450, 27658.7),
    (19.189, 102927.8, 708, 440, 27660.8),
    (19.532, 103603.2, 986, 600, 27802.0),
    (19.534, 103596.2, 962, 600, 27800.8),
    (19.534, 103599.2, 951, 610, 27802.2),
]
# Table 3, extreme air, 450 ppm: degC, kPa, humidity %, (n - 1)·1e8. The paper prints 19996.5 in the
# third row; its own column of differences makes it 19896.5.
TABLE_3 = [
    (20, 80, 75, 21394.0),
    (20, 120, 75, 32127.8),
    (40, 80, 75, 19896.5),
    (40, 120, 75, 29941.8),
    (50, 80, 100, 19058.4),
    (50, 120, 100, 28792.4),
]


@pytest.mark.parametrize("row", NIST, ids=str)
def test_index_is_the_one_that_nist_publishes(row):
    temperature, humidity, pressure, wavelength, published = row
    index = ciddor_index(temperature, pressure * 1e3, humidity / 100, wavelength * 1e-9)
    # The table has nine decimals.
    assert index == pytest.approx(published, abs=0.7e-9)


@pytest.mark.parametrize("row", TABLE_1, ids=str)
def test_dry_air_is_that_of_table_1(row):
    temperature, pressure, published = row
    index = ciddor_index(temperature, pressure * 1e3, 0.0, 633e-9)
    assert (float(index) - 1.0) * 1e8 == pytest.approx(published, abs=0.06)


@pytest.mark.parametrize("row", TABLE_2, ids=str)
def test_moist_air_is_that_of_table_2(row):
    temperature, pressure, vapour, carbon, published = row
    humidity = vapour / saturation_vapour_pressure(temperature)
    index = ciddor_index(temperature, pressure, humidity, 633e-9, carbon * 1e-6)
    # The paper's temperatures and vapour pressures are rounded: 0.001 K is 0.1e-8.
    assert (float(index) - 1.0) * 1e8 == pytest.approx(published, abs=0.4)


@pytest.mark.parametrize("row", TABLE_3, ids=str)
def test_extreme_air_is_that_of_table_3(row):
    temperature, pressure, humidity, published = row
    index = ciddor_index(temperature, pressure * 1e3, humidity / 100, 633e-9)
    assert (float(index) - 1.0) * 1e8 == pytest.approx(published, abs=0.06)


@pytest.mark.parametrize("row", [row for row in NIST if row[3] == 633 and row[0] >= 0], ids=str)
def test_both_equations_are_within_3e_8_of_the_published_values(row):
    temperature, humidity, pressure, wavelength, published = row
    air = (temperature, pressure * 1e3, humidity / 100, wavelength * 1e-9)
    bound = 3e-8 if temperature <= 40 else 7e-8  # Edlén leaves Ciddor in hot, saturated air.
    for index in (ciddor_index, edlen_index):
        assert index(*air) == pytest.approx(published, abs=bound)


def reference(celsius, pascal, humidity, wavelength, carbon):
    """Ciddor's appendix B in 40 digits, written from the steps of the paper."""
    f = mpmath.mpf
    with mpmath.workdps(40):
        t, p, h, x = (f(repr(v)) for v in (celsius, pascal, humidity, carbon))
        s = 1 / (f(repr(wavelength)) * 10**6) ** 2
        kelvin = t + f("273.15")
        omega = kelvin - f("0.238555575678") / (kelvin - f("650.175348448"))
        a = omega**2 + f("1167.05214528") * omega - f("724213.167032")
        b = f("-17.0738469401") * omega**2 + f("12020.8247025") * omega - f("3232555.03223")
        c = f("14.9151086135") * omega**2 - f("4823.26573616") * omega + f("405113.405421")
        saturated = 10**6 * (2 * c / (-b + mpmath.sqrt(b**2 - 4 * a * c))) ** 4
        f_enhanced = f("1.00062") + f("3.14e-8") * p + f("5.60e-7") * t**2
        xw = h * f_enhanced * saturated / p

        def z(pressure, temperature, vapour):
            u = temperature - f("273.15")
            inner = f("1.58123e-6") + f("-2.9331e-8") * u + f("1.1043e-10") * u**2
            inner += (f("5.707e-6") + f("-2.051e-8") * u) * vapour
            inner += (f("1.9898e-4") + f("-2.376e-6") * u) * vapour**2
            q = pressure / temperature
            return 1 - q * inner + q**2 * (f("1.83e-11") + f("-0.765e-8") * vapour**2)

        ras = f("1e-8") * (f(5792105) / (f("238.0185") - s) + f(167917) / (f("57.362") - s))
        raxs = ras * (1 + f("0.534e-6") * (x * 10**6 - 450))
        rws = f("1.022e-8") * (
            f("295.235") + f("2.6422") * s - f("0.032380") * s**2 + f("0.004028") * s**3
        )
        # With the paper's molar masses and gas constant, although they cancel.
        r, mv = f("8.314510"), f("0.018015")
        ma = f("1e-3") * (f("28.9635") + f("12.011e-6") * (x * 10**6 - 400))
        axs = 101325 * ma / (z(f(101325), f("288.15"), f(0)) * r * f("288.15"))
        ws = 1333 * mv / (z(f(1333), f("293.15"), f(1)) * r * f("293.15"))
        dry = p * ma * (1 - xw) / (z(p, kelvin, xw) * r * kelvin)
        wet = p * mv * xw / (z(p, kelvin, xw) * r * kelvin)
        return 1 + dry / axs * raxs + wet / ws * rws


@pytest.mark.parametrize(
    "air",
    [
        (20.0, 101325.0, 0.5, 632.9908e-9, 450e-6),
        (35.0, 82000.0, 0.9, 633e-9, 600e-6),
        (0.5, 103000.0, 0.1, 543e-9, 400e-6),
        (50.0, 120000.0, 1.0, 1000e-9, 300e-6),
    ],
    ids=str,
)
def test_formulas_are_those_of_the_paper_to_all_digits(air):
    expected = reference(*air) - 1
    found = float(ciddor_index(*air)) - 1.0
    # n itself is held to 2.2e-16, which leaves 12 digits of n - 1.
    assert abs(found - float(expected)) < 4.5e-16


def test_more_co2_refracts_more():
    air = (20.0, 101325.0, 0.4, 633e-9)
    change = ciddor_index(*air, 550e-6) - ciddor_index(*air, 450e-6)
    # (n - 1)·0.534e-6 for each ppm.
    assert change == pytest.approx(1.44e-8, rel=0.01)


def test_the_equation_is_chosen_by_name_and_unknown_air_stays_unknown():
    air = (23.0, 99000.0, 0.6)
    assert refractive_index(*air, equation="ciddor") == EQUATIONS["ciddor"](*air, 632.9908e-9)
    assert refractive_index(*air) == refractive_index(*air, equation="edlen")
    assert refractive_index(*air) != refractive_index(*air, equation="ciddor")
    assert np.isnan(index_of(Environment(20.0, np.nan, 0.5), equation="ciddor"))
    assert np.isnan(ciddor_index(np.array([20.0, np.nan]), 1e5, 0.5, 633e-9)[1])
    with refused(Refusal, "unknown", "sellmeier"):
        refractive_index(*air, equation="sellmeier")


@pytest.mark.parametrize(
    ("air", "words"),
    [
        ((20.0, 1013.25, 0.5, 633e-9), a_fault("out_of_range", "1013.25")),
        ((20.0, 1e5, 50.0, 633e-9), a_fault("out_of_range", "50")),
        ((20.0, 1e5, 0.5, 633.0), a_fault("out_of_range", "633")),
        ((20.0, 1e5, 0.5, 633e-9, 450.0), a_fault("out_of_range", "CO2", "450")),
    ],
)
def test_impossible_air_is_refused(air, words):
    with refused(Refusal, words):
        ciddor_index(*air)
