"""Whatever goes out comes back the same: data classes and messages, plans and YAML, model files.

Hypothesis draws the contents; ``test_conversion`` holds what single fields mean. Tables and bags
go round in ``bags/test_table_round_trip.py``.
"""

import numpy as np
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from test_conversion import same, through_the_wire

from stepdiag_ros.bags.table_plan import yaml_text
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.configuration import model_from_text, plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages import samples as samples_conversion
from stepdiag_ros.messages.volumetric import from_volumetric_errors, to_volumetric_errors
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.geometry import AXES, CHAINS, CURVES, TRANSLATIONS, move_orders
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Environment,
    MeasuredLine,
    Reading,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.model import STATUSES, MachineModel, ModelEffect, Provenance
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, Moved, Vibration
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINE_NAMES, STEP_DIAGONAL, Line
from stepdiag_ros.metrology.samples import SampleBlock
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors
from stepdiag_ros.topics import RUN_DESCRIPTION

TIMES = st.integers(0, (2**31 - 1) * 10**9)
COUNTS = st.integers(0, 2**31 - 1)
LARGE = st.integers(0, 2**63 - 1)
FLOATS = st.floats(allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20)
PLACES = st.tuples(FLOATS, FLOATS, FLOATS)
MOVED = st.builds(
    Moved,
    st.lists(st.builds(AxisDelay, st.sampled_from(AXES), FLOATS, FLOATS), min_size=1).map(tuple),
    st.builds(Vibration, FLOATS, FLOATS, FLOATS),
    FLOATS,
)
AIR = st.builds(Environment, FLOATS, FLOATS, FLOATS, FLOATS)


@st.composite
def lines(draw):
    kind = draw(st.sampled_from(list(LINE_NAMES)))
    name = draw(st.sampled_from(LINE_NAMES[kind]))
    order = draw(st.sampled_from(move_orders(name))) if kind == STEP_DIAGONAL else ""
    offset = draw(st.tuples(*[st.floats(-10.0, 10.0)] * 3))
    direction = draw(st.sampled_from((FORWARD, BACKWARD)))
    return Line(kind, name, order, draw(st.integers(0, 1000)), direction, offset)


def vectors(*shape):
    return arrays(np.float64, shape, elements=FLOATS)


@st.composite
def measured_lines(draw):
    count = draw(st.integers(1, 5))
    return MeasuredLine(
        line=draw(lines()),
        line_index=draw(COUNTS),
        attempt=draw(COUNTS),
        setup=draw(TEXTS),
        time=draw(vectors(count)),
        end_time=draw(TIMES),
        target=draw(vectors(count, 3)),
        displacement=draw(vectors(count)),
        standard_uncertainty=draw(vectors(count)),
        environment=draw(vectors(count, 4)),
        overrun=draw(FLOATS),
        moved=draw(st.none() | MOVED),
    )


@st.composite
def volumetric_errors(draw):
    counts = draw(st.tuples(*[st.integers(1, 4)] * 3))
    known = draw(st.lists(st.sampled_from(CURVES), unique=True))

    def curves():
        return {
            name: draw(vectors(counts["XYZ".index(name[-1])])) for name in CURVES if name in known
        }

    return VolumetricErrors(
        method=draw(TEXTS),
        nodes=tuple(draw(vectors(count)) for count in counts),
        curves=curves(),
        standard_uncertainty=curves(),
        figures=tuple(draw(st.lists(st.builds(Figure, TEXTS, FLOATS, FLOATS, TEXTS), max_size=3))),
        lines=draw(COUNTS),
        chi_squared=draw(FLOATS),
        degrees_of_freedom=draw(COUNTS),
        not_determined=tuple(draw(st.lists(TEXTS, max_size=3))),
        remarks=tuple(draw(st.lists(TEXTS, max_size=3))),
    )


@st.composite
def sample_blocks(draw):
    count = draw(st.integers(1, 20))
    return SampleBlock(
        time=draw(TIMES),
        sequence=draw(LARGE),
        period=draw(st.floats(1e-9, 1e9)),
        zero=draw(st.integers(0, 2**31 - 1)),
        scale=draw(FLOATS),
        offset=draw(FLOATS),
        environment=draw(AIR),
        raw_displacement=draw(vectors(count)),
        signal_strength=draw(arrays(np.float32, count, elements=st.floats(0, 1, width=32))),
        status=draw(arrays(np.uint8, count)),
    )


COMMANDS = st.builds(
    StopCommand,
    LARGE,
    COUNTS,
    COUNTS,
    TEXTS,
    COUNTS,
    st.sampled_from(["", *AXES, "XYZ"]),
    PLACES,
    TIMES,
)
STOPS = st.builds(
    SettledStop,
    command=COMMANDS,
    line=lines(),
    position=PLACES,
    settled=st.booleans(),
    reason=TEXTS,
    time=TIMES,
    displacement=FLOATS,
    raw_displacement=FLOATS,
    standard_uncertainty=FLOATS,
    standard_deviation=FLOATS,
    readings=COUNTS,
    first_sequence=LARGE,
    last_sequence=LARGE,
    in_position_time=TIMES,
    window_start=TIMES,
    window_end=TIMES,
    environment=AIR,
)
BLOCKS = st.builds(
    BlockDisplacement,
    line_index=COUNTS,
    attempt=COUNTS,
    line=lines(),
    time=TIMES,
    block=COUNTS,
    axis=st.sampled_from([*AXES, "XYZ"]),
    from_stop=COUNTS,
    to_stop=COUNTS,
    nominal_displacement=FLOATS,
    displacement=FLOATS,
    standard_uncertainty=FLOATS,
)
READINGS = st.builds(
    Reading,
    TIMES,
    LARGE,
    FLOATS,
    FLOATS,
    st.floats(0, 1, width=32),
    st.integers(0, 255),
    AIR,
    LARGE,
)
NEW = own_types().new


def check(name, value, to, message):
    """Compare a data class with what becomes of its message, as made and as received."""
    assert same(to(message), value)
    assert same(to(through_the_wire(f"stepdiag_ros/msg/{name}", message)), value)


@given(READINGS)
def test_readings(reading):
    message = conversion.from_reading(reading, "laser", new=NEW)
    check("InterferometerReading", reading, conversion.to_reading, message)


@given(COMMANDS)
def test_commands(command):
    message = conversion.from_stop_command(command, "run", command.time, 0.05, new=NEW)
    check("StepCommand", command, conversion.to_stop_command, message)


@given(STOPS)
def test_stops(stop):
    message = conversion.from_settled_stop(stop, "run", NEW)
    check("SettledStop", stop, conversion.to_settled_stop, message)


@given(BLOCKS)
def test_blocks(block):
    message = conversion.from_block(block, "run", NEW)
    check("BlockDisplacement", block, conversion.to_block, message)


@given(measured_lines())
def test_lines(line):
    message = conversion.from_measured_line(line, "run", NEW)
    check("MeasuredLine", line, conversion.to_measured_line, message)


@given(volumetric_errors(), TIMES)
def test_results(result, time):
    message = from_volumetric_errors(result, "run", time, NEW)
    check("VolumetricErrors", result, to_volumetric_errors, message)


@given(sample_blocks())
def test_samples(block):
    message = samples_conversion.from_sample_block(block, "laser", 5, NEW)
    check("InterferometerSamples", block, samples_conversion.to_sample_block, message)


@st.composite
def groups(draw):
    kind = draw(st.sampled_from(list(LINE_NAMES)))
    names = draw(st.lists(st.sampled_from(LINE_NAMES[kind]), min_size=1, unique=True))
    return {"kind": kind, "names": names, "repeats": draw(st.integers(1, 3))}


SMALL = st.floats(1e-6, 1.0)
PLANS = st.fixed_dictionaries(
    {
        "name": TEXTS,
        "origin_m": st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3),
        "step_m": st.lists(SMALL, min_size=3, max_size=3),
        "blocks": st.integers(1, 5),
        "directions": st.sampled_from([[FORWARD], [BACKWARD], [FORWARD, BACKWARD]]),
        "feed_m_per_s": st.one_of(SMALL, st.just("unknown")),
        "pause_for_setup": st.booleans(),
        "overrun_m": SMALL,
        "sampling": st.fixed_dictionaries(
            {
                "dwell_s": SMALL,
                "settle_s": SMALL,
                "drift_limit_m": SMALL,
                "stop_attempts": COUNTS.filter(bool).map(lambda n: n % 100 + 1),
            }
        ),
        # One group of each kind: no line is planned twice.
        "lines": st.lists(groups(), min_size=1, unique_by=lambda group: group["kind"]),
    }
)


@given(PLANS)
def test_plans_in_files_and_in_run_descriptions(mapping):
    text = yaml_text(mapping)
    plan = plan_from_text(text, "file")
    message = NEW(RUN_DESCRIPTION.type_name)
    message.plan = text
    received = through_the_wire(RUN_DESCRIPTION.type_name, message)
    assert received.plan == text
    again = plan_from_text(received.plan, "message")
    assert again == plan and again.lines == plan.lines
    # What stands in the file is what was planned.
    assert (plan.name, plan.pause_for_setup) == (
        mapping["name"],
        mapping["pause_for_setup"],
    )
    assert [*plan.volume.step] == mapping["step_m"] and plan.volume.blocks == mapping["blocks"]
    wanted = sum(len(one["names"]) * one["repeats"] for one in mapping["lines"])
    assert len(plan.lines) == wanted * len(mapping["directions"])


SETTINGS = {str: TEXTS, int: st.integers(0, 10**9), float: st.floats(1e-9, 1e9)}
SHAPES = ("x^1", "y>0.5 * sense z", "line run 2: ppp * path~0.4", "creep x 40s", "air^1 * t^2")
FINITE = st.floats(-1e9, 1e9)
PROVENANCES = st.builds(
    Provenance,
    bag=TEXTS,
    sha256=st.one_of(st.just(""), st.text("0123456789abcdef", min_size=64, max_size=64)),
    date=st.one_of(st.just(""), st.dates().map(str)),
    evidence=TEXTS,
)


@st.composite
def model_effects(draw):
    effect = draw(st.sampled_from(list(catalogue().values())))
    setting = {
        key.name: draw(
            st.sampled_from(key.kind) if isinstance(key.kind, tuple) else SETTINGS[key.kind]
        )
        for key in effect.keys
    }
    if effect.learned:
        setting["shape"] = draw(st.sampled_from(SHAPES))
    size = st.floats(0.0, 1e9) if effect.typical else FINITE
    return ModelEffect(
        ActiveEffect(effect, setting, {one.name: draw(size) for one in effect.sizes}),
        {one.name: draw(st.one_of(st.floats(0.0, 1e9), st.just(np.nan))) for one in effect.sizes},
        draw(st.sampled_from(STATUSES)),
        draw(PROVENANCES),
    )


@st.composite
def models(draw):
    count = draw(st.integers(2, 5))
    known = draw(st.lists(st.sampled_from(TRANSLATIONS), unique=True))
    return MachineModel(
        draw(TEXTS),
        draw(st.sampled_from(["", *CHAINS])),
        {name: tuple(draw(FINITE) for _ in range(count)) for name in TRANSLATIONS if name in known},
        tuple(draw(st.lists(model_effects(), max_size=3, unique_by=lambda one: one.label))),
    )


@given(models())
def test_models_in_files(model):
    again = model_from_text(yaml.safe_dump(model.to_mapping(), sort_keys=False), "file")
    assert again.to_mapping() == model.to_mapping()
    assert [one.label for one in again.effects] == [one.label for one in model.effects]
