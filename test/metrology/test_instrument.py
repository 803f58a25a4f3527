"""Instrument files: the three ways to state an uncertainty, what is unknown, what is refused."""

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros.configuration import (
    available,
    find,
    instrument_from_text,
    load_instrument,
)
from stepdiag_ros.metrology.refusal import Refusal


def read(text):
    return instrument_from_text(text, "my.yaml")


def test_an_uncertainty_is_stated_in_one_of_three_ways():
    found = read(
        "name: mine\n"
        "laser:\n"
        "  wavelength_relative: {expanded: 0.2e-6, coverage_factor: 2}\n"
        "  resolution_m: {half_width: 3.0e-9}\n"
        "  periodic_error_m: {half_width: 2.0e-9, distribution: arcsine}\n"
        "air:\n"
        "  temperature_K: {standard_uncertainty: 0.05, degrees_of_freedom: 8}\n"
    )
    assert found.name == "mine"
    assert found.wavelength.standard_uncertainty == pytest.approx(0.1e-6)
    assert found.resolution.standard_uncertainty == pytest.approx(3e-9 / np.sqrt(3.0))
    assert found.resolution.distribution == "rectangular"
    assert found.periodic_error.standard_uncertainty == pytest.approx(2e-9 / np.sqrt(2.0))
    assert found.air_temperature.degrees_of_freedom == 8.0


def test_what_is_left_out_or_said_to_be_unknown_is_unknown():
    found = read("name: mine\nair: {pressure_Pa: unknown}\ndead_path: {length_m: unknown}\n")
    assert not found.air_pressure.known
    assert not found.air_temperature.known
    assert not found.alignment.known
    assert np.isnan(found.dead_path)
    assert read("name: mine\ndead_path: {length_m: 0.4}\n").dead_path == 0.4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("laser: {wavelength: 1.0e-6}", a_fault("unknown", "my.yaml", about="wavelength")),
        ("lasers: {}", a_fault("unknown", "laser", about="lasers")),
        (
            "air: {temperature_K: {}}",
            a_fault(
                "missing", "temperature_K", "standard_uncertainty", "half_width", aspect="size"
            ),
        ),
        (
            "air: {temperature_K: {standard_uncertainty: 1.0, half_width: 1.0}}",
            a_fault("missing", "temperature_K", aspect="size"),
        ),
        (
            "air: {temperature_K: {expanded: 0.1}}",
            a_fault("missing", "temperature_K", about="coverage_factor"),
        ),
        (
            "air: {temperature_K: {standard_uncertainty: -0.1}}",
            a_fault("out_of_range", "0", "50", about="standard_uncertainty"),
        ),
        (
            "air: {relative_humidity: {standard_uncertainty: 3.0}}",
            a_fault("out_of_range", "0", "1", about="standard_uncertainty"),
        ),
        (
            "air: {temperature_K: 0.1}",
            a_fault("malformed", "temperature_K", "0.1", aspect="section"),
        ),
        (
            "laser: {resolution_m: {half_width: 1.0e-9, distribution: uniform}}",
            a_fault("unknown", about="distribution"),
        ),
        (
            "setup: {return_rad: {standard_uncertainty: 1.0, shape: x}}",
            a_fault("out_of_range", "0", "0.1", about="standard_uncertainty"),
        ),
        (
            "setup: {return_rad: {standard_uncertainty: 0.1, shape: x}}",
            a_fault("unknown", about="shape"),
        ),
    ],
)
def test_a_wrong_file_is_refused_with_the_place(text, words):
    with refused(Refusal, words):
        read(text)


def test_the_files_of_the_package_can_be_read_and_explain_every_key():
    assert {"demo", "simulated"} <= set(available("instruments"))
    for name in available("instruments"):
        assert load_instrument(name)[0].name
    demo, text = load_instrument("demo")
    keys = [
        line
        for line in text.splitlines()
        if line.startswith("  ") and line.strip()[0] not in "{#" and ":" in line.split("#")[0]
    ]
    assert len(keys) == 18
    assert all("#" in line for line in keys)
    known = [name for name in vars(demo) if name not in ("name", "dead_path")]
    assert [name for name in known if not getattr(demo, name).known] == ["angular_errors"]
    exact = load_instrument("simulated")[0]
    assert all(getattr(exact, name).known for name in known)
    with refused(Refusal, "not_found", "nothing"):
        find("nothing", "instruments")
