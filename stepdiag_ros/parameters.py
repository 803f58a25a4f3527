"""The parameters of the nodes, declared once: name, default, meaning, unit, range, when to set.

Plain data, no ROS client. ``nodes/declared.py`` declares them on the nodes and refuses what is
wrong, ``stepdiag parameters`` prints them, ``docs/parameters.md`` is made of them.

What the numbers of a run depend on cannot be changed while one is going on; the settings of a
device cannot while it is open, and take effect when it is opened again.
"""

from stepdiag_ros.declaration import Change, Declaration, DeclaredNode

_MACHINE = Declaration(
    "machine", "demo", "machine under test: YAML file, or a name in config/machines"
)
_CELL = Declaration(
    "cell",
    "demo",
    "simulated cell, if the device is simulated: YAML file, or a name in config/cells",
)
_READING_TIMEOUT = Declaration(
    "reading_timeout",
    3.0,
    "time without a reading after which a run is stopped",
    "s",
    0.05,
    3600.0,
    change=Change.ANY_TIME,
)
_WEATHER_BEGINS = Declaration(
    "weather_begins",
    0,
    "ROS time at which the weather of the simulated cell begins, the same for all its nodes;"
    " 0: when this node starts",
    unit="ns",
    low=0,
    high=2**62,
)
_DEVICE_FILE = Declaration(
    "device_file",
    "",
    "settings of the driver: YAML file, or a name in config/devices; empty: the driver's defaults",
    change=Change.WHILE_CLOSED,
)
_MANAGED = (
    Declaration(
        "autostart",
        True,
        "open the device and use it as soon as the ROS clock runs; false: only when a manager says"
        " so (ros2 lifecycle set, a launch file)",
    ),
    Declaration(
        "retry_after",
        5.0,
        "real time after which a device that has failed is opened anew, with autostart",
        "s",
        0.1,
        3600.0,
    ),
    Declaration(
        "hardware_id",
        "",
        "identity of the device on /diagnostics, such as its serial number; empty: its driver",
    ),
)
"""Of every node that owns a device."""

NODES: tuple[DeclaredNode, ...] = (
    DeclaredNode(
        "sequencer",
        "sequencer",
        "executes a test plan step by step, once an operator starts it",
        (
            Declaration(
                "plan",
                "demo",
                "test plan of runs that are started without one: YAML file, or a name in"
                " config/plans",
                change=Change.BETWEEN_RUNS,
            ),
            Declaration(
                "result_limit",
                300.0,
                "real time after the end of a run for which the result of ~/measure waits for the"
                " nodes that still evaluate or record it",
                "s",
                0.0,
                86400.0,
                change=Change.ANY_TIME,
            ),
            _MACHINE,
            Declaration(
                "cell",
                "",
                "simulated cell, for the record: YAML file, or a name in config/cells; empty on a"
                " real machine",
            ),
        ),
    ),
    DeclaredNode(
        "bridge",
        "cnc_bridge",
        "the bridge to the machine's controller; it alone makes the machine move",
        (
            Declaration("device", "simulated", "driver of the controller (docs/devices.md)"),
            _DEVICE_FILE,
            _MACHINE,
            _CELL,
            Declaration(
                "position_rate",
                50.0,
                "actual positions in a second",
                "Hz",
                1.0,
                10000.0,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "position_timeout",
                2.0,
                "time without an actual position after which the axes are stale and a run is"
                " stopped",
                "s",
                0.05,
                3600.0,
                change=Change.ANY_TIME,
            ),
            *_MANAGED,
        ),
    ),
    DeclaredNode(
        "interferometer",
        "interferometer",
        "streams the readings of a laser interferometer",
        (
            Declaration("device", "simulated", "driver of the instrument (docs/devices.md)"),
            _DEVICE_FILE,
            _CELL,
            Declaration(
                "rate",
                0.0,
                "readings in a second; 0: the cell's own",
                "Hz",
                0.0,
                1e4,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "seed",
                0,
                "of the noise of the simulated readings",
                low=0,
                high=2**31,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "hold_after",
                1.0,
                "time without axis positions after which the last one is taken to hold",
                "s",
                0.0,
                3600.0,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "weather_age",
                10.0,
                "age from which on what a weather sensor has said counts as unknown",
                "s",
                0.1,
                86400.0,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "index_equation",
                "edlen",
                "equation for the refractive index of air; edlen is the modified one",
                choices=("edlen", "ciddor"),
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "reading_timeout",
                2.0,
                "time without a reading after which the beam is stale and a run is stopped",
                "s",
                0.05,
                3600.0,
                change=Change.ANY_TIME,
            ),
            Declaration(
                "dim_signal",
                0.2,
                "part of the full signal below which the beam is called dim",
                low=0.0,
                high=1.0,
                change=Change.ANY_TIME,
            ),
            Declaration(
                "rate_tolerance",
                0.1,
                "part of the rate by which the readings in a second may be off unmentioned",
                low=0.0,
                high=1.0,
                change=Change.ANY_TIME,
            ),
            _WEATHER_BEGINS,
            *_MANAGED,
        ),
    ),
    DeclaredNode(
        "weather",
        "weather",
        "publishes what the weather sensors say",
        (
            Declaration("device", "simulated", "driver of the weather station (docs/devices.md)"),
            _DEVICE_FILE,
            _CELL,
            Declaration(
                "rate",
                1.0,
                "values in a second",
                "Hz",
                0.001,
                1000.0,
                change=Change.WHILE_CLOSED,
            ),
            Declaration(
                "value_timeout",
                10.0,
                "age from which on a value of the weather station is told to be unknown",
                "s",
                0.1,
                86400.0,
                change=Change.ANY_TIME,
            ),
            _WEATHER_BEGINS,
            *_MANAGED,
        ),
    ),
    DeclaredNode(
        "assembler",
        "assembler",
        "settles the readings of each stop and makes block displacements and lines of them",
        (_READING_TIMEOUT,),
    ),
    DeclaredNode("solver", "solver", "solves for the volumetric errors after every finished line"),
    DeclaredNode(
        "evaluator",
        "evaluator",
        "evaluates each test of positioning (ISO 230-2, ISO 230-6) when its last pass is done",
    ),
    DeclaredNode(
        "diagnosis",
        "diagnosis",
        "compares the lines of a run with a model of the machine while they are measured",
        (
            Declaration(
                "model",
                "free",
                "model of the machine: YAML file, or a name in config/models",
                change=Change.BETWEEN_RUNS,
            ),
            Declaration(
                "seed",
                0,
                "of the random draws that guard against false names",
                low=0,
                high=2**31 - 1,
                change=Change.BETWEEN_RUNS,
            ),
            Declaration(
                "pause_s",
                10.0,
                "real time, at least, between the end of one diagnosis and the begin of the next"
                " while a run goes on; that of the whole run is made at once",
                "s",
                0.0,
                3600.0,
                change=Change.ANY_TIME,
            ),
        ),
    ),
    DeclaredNode(
        "scene",
        "scene",
        "shows frames, lines and errors to RViz and Foxglove",
        (
            Declaration(
                "method",
                "preferred",
                "whose result is shown; preferred: the most reliable one so far",
                choices=(
                    "preferred",
                    "all",
                    "conventional",
                    "setup_robust",
                    "alternative",
                    "soons",
                    "least_squares",
                    "rigid_body",
                ),
                change=Change.ANY_TIME,
            ),
            Declaration(
                "exaggeration",
                0.0,
                "by which errors are drawn longer than they are; 0: a round number, so that the"
                " longest is at most a fifth of the box's shortest edge",
                low=0.0,
                high=1e9,
                change=Change.ANY_TIME,
            ),
            Declaration(
                "laser_distance",
                0.3,
                "from the laser to the mirror at the first stop of a line, for the picture alone",
                "m",
                0.0,
                100.0,
                change=Change.ANY_TIME,
            ),
            *(
                Declaration(
                    f"mirror_offset_{axis}",
                    0.0,
                    f"of the mirror from the tool point along {axis.upper()}, for the picture",
                    "m",
                    -10.0,
                    10.0,
                    change=Change.ANY_TIME,
                )
                for axis in "xyz"
            ),
            Declaration(
                "tool_rate",
                30.0,
                "frames of the tool in a real second, at most",
                "Hz",
                0.1,
                1000.0,
            ),
            Declaration(
                "frame_prefix",
                "",
                "put before the names of all frames, such as cell_1/, where several cells share"
                " /tf",
            ),
        ),
    ),
    DeclaredNode(
        "recorder",
        "recorder",
        "records each run into one MCAP file that survives a crash",
        (
            Declaration(
                "folder",
                ".",
                "folder in which the bags are written, RUN.mcap each; made if it is not there",
                change=Change.BETWEEN_RUNS,
            ),
            _READING_TIMEOUT,
            Declaration(
                "position_timeout",
                3.0,
                "time without an actual position after which a run is stopped",
                "s",
                0.05,
                3600.0,
                change=Change.ANY_TIME,
            ),
            Declaration(
                "space_wanted",
                2e9,
                "free space on the disk below which /diagnostics warns",
                "B",
                0.0,
                1e15,
                change=Change.ANY_TIME,
            ),
            Declaration(
                "space_needed",
                2e8,
                "free space on the disk below which no run begins or goes on",
                "B",
                0.0,
                1e15,
                change=Change.ANY_TIME,
            ),
        ),
    ),
    DeclaredNode(
        "clock",
        "clock",
        "publishes simulated time, faster or slower than real time by a factor",
        (
            Declaration(
                "factor",
                1.0,
                "simulated seconds in a real second",
                low=0.001,
                high=1000.0,
                change=Change.ANY_TIME,
            ),
            Declaration("period", 0.004, "real time between two ticks", "s", 0.0005, 1.0),
        ),
    ),
)
"""Every node that is started by its own name, with its parameters."""


def declared_node(name: str) -> DeclaredNode:
    """Return the declarations of a node by its module or its name in the graph.

    A node that is not started by its own name, such as that of the command line, has no parameters.
    """
    for node in NODES:
        if name in (node.module, node.name):
            return node
    return DeclaredNode(name, name, "")
