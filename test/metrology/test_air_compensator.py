"""Known air and the compensator: against the formulas, in closed form, and with what goes wrong."""

from dataclasses import replace
from math import inf, isnan, nan

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.metrology.air import index_of, raw_displacement
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.air.known_air import KnownAir, implausible
from stepdiag_ros.metrology.beam import FixedBeam
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.samples import SampleBlock

SECOND = 1_000_000_000
AIR = Environment(20.0, 101325.0, 0.5, 20.3)
WARM = AIR._replace(air_temperature=21.5, air_pressure=100900.0)
X = np.array([1.0, 0.0, 0.0])


def reading(raw, time=2, compensated=nan, status=0, environment=None):
    return Reading(time, 0, raw, compensated, 1.0, status, environment or Environment())


class TestKnownAir:
    def told(self, air, environment, time):
        for name, value in environment._asdict().items():
            air.take(name, value, time)

    def test_values_are_known_until_they_are_too_old(self):
        air = KnownAir(10.0)
        assert all(isnan(value) for value in air.at(0))
        self.told(air, AIR, SECOND)
        air.take("air_pressure", 101000.0, 8 * SECOND)
        assert air.at(11 * SECOND) == AIR._replace(air_pressure=101000.0)
        late = air.at(11 * SECOND + 1)
        assert late.air_pressure == 101000.0 and isnan(late.air_temperature)
        assert air.at(11 * SECOND + 2) is late, "the same air is the same object"

    def test_an_older_value_changes_nothing(self):
        air = KnownAir(10.0)
        self.told(air, AIR, 5 * SECOND)
        air.take("air_pressure", 99000.0, 4 * SECOND)
        assert air.at(5 * SECOND) == AIR

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("air_temperature", 68.0),
            ("air_pressure", 1013.0),
            ("air_pressure", inf),
            ("relative_humidity", 45.0),
            ("relative_humidity", -0.01),
            ("material_temperature", 293.0),
            ("air_pressure", nan),
        ],
    )
    def test_what_cannot_be_meant_is_unknown(self, name, value):
        air = KnownAir(10.0)
        self.told(air, AIR, SECOND)
        air.take(name, value, 2 * SECOND)
        assert isnan(getattr(air.at(2 * SECOND), name))
        assert bool(air.objection(name)) is not isnan(value)
        air.take(name, getattr(AIR, name), 3 * SECOND)
        assert air.at(3 * SECOND) == AIR and not air.objection(name)

    def test_a_leap_is_not_believed_until_it_has_stayed(self):
        air = KnownAir(10.0)
        self.told(air, AIR, SECOND)
        for second in range(2, 12):
            air.take("air_temperature", 0.0, second * SECOND)
            assert isnan(air.at(second * SECOND).air_temperature)
            assert "leaps" in air.objection("air_temperature")
        air.take("air_temperature", 0.0, 12 * SECOND)
        assert air.at(12 * SECOND).air_temperature == 0.0
        # What drifts is believed.
        for second in range(13, 30):
            air.take("air_temperature", (second - 12) * 2.0, second * SECOND)
            assert air.at(second * SECOND).air_temperature == (second - 12) * 2.0

    def test_units_are_guessed(self):
        assert implausible("air_pressure", 29.92) == "out of range: it would fit in inHg"
        assert implausible("air_pressure", 1.013) == "out of range: it would fit in bar"
        assert implausible("air_temperature", 1e6) == "out of range"
        assert implausible("air_temperature", nan) == ""


class TestCompensator:
    DEAD = 0.35

    def counted(self, displacement, environment, zero=AIR, way=0.0):
        """Return what a counter shows that was zeroed in the air ``zero``."""
        path = self.DEAD + way
        return raw_displacement(displacement, path, index_of(environment), index_of(zero))

    def test_displacements_come_back_whatever_the_air_does(self):
        compensator = Compensator("own", self.DEAD)
        compensator.align(1, FixedBeam(X), np.zeros(3))
        assert compensator.reading(reading(0.0), AIR).compensated_displacement == 0.0
        for displacement in (0.0, 0.12, -0.05):
            for air in (AIR, WARM):
                raw = self.counted(displacement, air)
                made = compensator.reading(reading(raw), air)
                assert made.compensated_displacement == pytest.approx(displacement, abs=1e-15)
                assert made.raw_displacement == raw and made.environment is air

    def test_the_zero_of_the_instrument_does_not_matter(self):
        there, elsewhere = (Compensator("own", self.DEAD) for _ in range(2))
        for compensator, offset in ((there, 0.0), (elsewhere, 3.21)):
            compensator.align(1, FixedBeam(X), np.zeros(3))
            compensator.reading(reading(offset), AIR)
        raw = self.counted(0.1, WARM)
        found = [
            compensator.reading(reading(raw + offset), WARM).compensated_displacement
            for compensator, offset in ((there, 0.0), (elsewhere, 3.21))
        ]
        assert found == pytest.approx([0.1, 0.1], abs=1e-15)

    def test_the_dead_path_belongs_to_the_first_stop_wherever_the_zero_is_set(self):
        compensator = Compensator("own", self.DEAD)
        compensator.align(1, FixedBeam(X), np.array([0.1, 0.0, 0.0]))
        compensator.move((0.3, 0.5, 0.0))
        compensator.reading(reading(0.0), AIR)
        raw = self.counted(0.05, WARM, way=0.2)
        made = compensator.reading(reading(raw), WARM)
        assert made.compensated_displacement == pytest.approx(0.05, abs=1e-15)
        # Without the way, the error would be that of 0.2 m of air.
        assert abs(0.2 * (index_of(WARM) - index_of(AIR))) > 1e-7

    def test_the_zero_waits_for_a_good_reading_after_the_alignment(self):
        compensator = Compensator("own", self.DEAD)
        compensator.align(10, FixedBeam(X), np.zeros(3))
        compensator.reading(reading(5.0, time=9), AIR)
        compensator.reading(reading(6.0, time=11, status=2), AIR)
        compensator.reading(reading(nan, time=12), AIR)
        assert compensator.reading(reading(7.0, time=13), AIR).compensated_displacement == 0.0

    def test_unknown_air_is_nan_and_the_first_known_one_serves_as_that_at_the_zero(self):
        compensator = Compensator("own", self.DEAD)
        compensator.align(1, FixedBeam(X), np.zeros(3))
        assert isnan(compensator.reading(reading(0.0), Environment()).compensated_displacement)
        assert compensator.reading(reading(0.0), AIR).compensated_displacement == 0.0
        blind = AIR._replace(air_pressure=nan)
        made = compensator.reading(reading(0.1), blind)
        assert isnan(made.compensated_displacement) and made.raw_displacement == 0.1

    def test_nobody_compensates_or_the_instrument_does(self):
        off = Compensator("off", self.DEAD).reading(reading(0.1), AIR)
        assert off.compensated_displacement == 0.1
        assert isnan(off.environment.air_pressure) and off.environment.material_temperature == 20.3
        given = Compensator("instrument").reading(reading(0.1, compensated=0.09), AIR)
        assert (given.raw_displacement, given.compensated_displacement) == (0.1, 0.09)
        assert isnan(given.environment.air_pressure)
        assert given.environment.material_temperature == 20.3
        told = reading(0.1, compensated=0.09, environment=WARM)
        assert Compensator("instrument").reading(told, AIR) is told
        with refused(Refusal, "unknown", "on"):
            Compensator("on")

    def test_wavelength_and_equation_are_used(self):
        for how in ((1530e-9, "edlen"), (632.9908e-9, "ciddor")):
            compensator = Compensator("own", 0.0, *how)
            compensator.align(1, FixedBeam(X), np.zeros(3))
            compensator.reading(reading(0.0), AIR)
            made = compensator.reading(reading(1.0), AIR).compensated_displacement
            assert made == pytest.approx(1.0 / index_of(AIR, *how), rel=1e-15)

    @pytest.mark.parametrize("kind", ["own", "off", "instrument"])
    def test_a_block_is_compensated_as_its_samples_would_be(self, kind):
        raw = np.array([0.4, 0.5, 0.6])
        block = SampleBlock(
            time=100,
            sequence=0,
            period=1e-3,
            zero=1,
            scale=0.5,
            offset=0.1,
            environment=Environment(),
            raw_displacement=raw,
            signal_strength=np.ones(1, dtype=np.float32),
            status=np.array([2, 0, 0], dtype=np.uint8),
        )
        blocks, singles = (Compensator(kind, self.DEAD) for _ in range(2))
        for compensator in (blocks, singles):
            compensator.align(1, FixedBeam(X), np.zeros(3))
        blocks.block(block, AIR)
        singles.reading(reading(0.5), AIR)
        made = blocks.block(replace(block, raw_displacement=raw + 0.1), WARM)
        expected = [
            singles.reading(reading(value, compensated=0.5 * value + 0.1), WARM)
            for value in (raw + 0.1).tolist()
        ]
        assert made.scale * made.raw_displacement + made.offset == pytest.approx(
            [one.compensated_displacement for one in expected], abs=1e-15
        )
        assert made.environment.material_temperature == 20.3
        assert isnan(made.environment.air_pressure) is (kind != "own")
