"""The parameters of the nodes, declared once: name, default, meaning, unit, range, when to set.

Plain data, no ROS client. ``nodes/declared.py`` declares them on the nodes and refuses what is
wrong, ``stepdiag parameters`` prints them, ``docs/parameters.md`` is made of them.

What the numbers of a run depend on cannot be changed while one is going on; the settings of a
device cannot while it is open, and take effect when it is opened again.
"""

from stepdiag_ros.parameters.declaration import Changeable, Declaration, DeclaredNode
from stepdiag_ros.parameters.devices import CELL, DEVICE_FILE, INTERFEROMETER, MANAGED, WEATHER

_MACHINE = Declaration(
    "machine", "demo", "machine under test: YAML file, or a name in config/machines"
)
_READING_TIMEOUT = Declaration(
    "reading_timeout",
    3.0,
    "time without a reading after which a run is stopped",
    "s",
    0.05,
    3600.0,
    change=Changeable.ANY_TIME,
)


def _shown_methods() -> tuple[str, ...]:
    # With the solvers comes numpy, which no other parameter needs.
    from stepdiag_ros.metrology.solvers import solvers

    return ("preferred", "all", *solvers())


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
                change=Changeable.BETWEEN_RUNS,
            ),
            Declaration(
                "until",
                "",
                "uncertainty at which runs that are started without one end, before their last"
                " line: 0.5um, E_XX=0.3um, C0Y=2urad or X:A=1um; empty: all lines are measured",
                change=Changeable.BETWEEN_RUNS,
            ),
            Declaration(
                "result_limit",
                300.0,
                "real time after the end of a run for which the result of ~/measure waits for the"
                " nodes that still evaluate or record it",
                "s",
                0.0,
                86400.0,
                change=Changeable.ANY_TIME,
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
            DEVICE_FILE,
            _MACHINE,
            CELL,
            Declaration(
                "position_rate",
                50.0,
                "actual positions in a second",
                "Hz",
                1.0,
                10000.0,
                change=Changeable.WHILE_CLOSED,
            ),
            Declaration(
                "position_timeout",
                2.0,
                "time without an actual position after which the axes are stale and a run is"
                " stopped",
                "s",
                0.05,
                3600.0,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "silence_limit",
                0.5,
                "time without a message of the sequencer, or an actual position of the"
                " controller, after which a move is stopped",
                "s",
                0.05,
                10.0,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "correction",
                "",
                "error map by which commanded targets are corrected: volumetric_map.json of"
                " 'stepdiag compensate --for generic'; empty: targets are sent as they are",
                change=Changeable.BETWEEN_RUNS,
            ),
            Declaration(
                "correction_limit",
                0.2e-3,
                "largest correction of an axis; a move that needs more is refused",
                "m",
                0.0,
                0.5e-3,
                change=Changeable.BETWEEN_RUNS,
            ),
            *MANAGED,
        ),
    ),
    DeclaredNode(
        "by_hand",
        "by_hand",
        "follows a run by the readings alone, in place of sequencer and bridge; it moves nothing",
        (
            Declaration(
                "plan",
                "demo",
                "test plan whose NC program the operator runs: YAML file, or a name in"
                " config/plans",
                change=Changeable.BETWEEN_RUNS,
            ),
            _MACHINE,
        ),
    ),
    INTERFEROMETER,
    WEATHER,
    DeclaredNode(
        "assembler",
        "assembler",
        "settles the readings of each stop and makes block displacements and lines of them",
        (_READING_TIMEOUT,),
    ),
    DeclaredNode(
        "solver",
        "solver",
        "solves for the volumetric errors after every finished line",
        (
            Declaration(
                "tolerance",
                0.0,
                "largest permissible length of an error vector in the measured volume, for"
                " result/verdict (ISO 14253-1); 0: none is agreed",
                "m",
                0.0,
                5e-3,
                change=Changeable.ANY_TIME,
                example=10e-6,
            ),
        ),
    ),
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
                change=Changeable.BETWEEN_RUNS,
            ),
            Declaration(
                "seed",
                0,
                "seed of the random draws that guard against false names",
                low=0,
                high=2**31 - 1,
                change=Changeable.BETWEEN_RUNS,
            ),
            Declaration(
                "pause_s",
                10.0,
                "least real time between the end of one diagnosis and the start of the next"
                " during a run; the diagnosis of the whole run starts at once",
                "s",
                0.0,
                3600.0,
                change=Changeable.ANY_TIME,
            ),
        ),
    ),
    DeclaredNode(
        "archive",
        "archive",
        "adds the bag of each run to an archive, and reports what its machine's history shows",
        (
            Declaration("place", "", "the archive: a folder, or a URL such as s3://bucket/name"),
            Declaration(
                "machine",
                "",
                "name in the archive of the machine whose history is reported from the start;"
                " empty: that of the last run that was added",
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
                "method whose result is shown; preferred: the most reliable one so far",
                choices=_shown_methods,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "exaggeration",
                0.0,
                "factor by which errors are drawn longer than they are; 0: a round number, so"
                " that the longest is at most a fifth of the box's shortest edge",
                low=0.0,
                high=1e9,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "laser_distance",
                0.3,
                "distance from the laser to the mirror at the first stop of a line, for the"
                " picture only",
                "m",
                0.0,
                100.0,
                change=Changeable.ANY_TIME,
            ),
            *(
                Declaration(
                    f"mirror_offset_{axis}",
                    0.0,
                    f"offset of the mirror from the tool point along {axis.upper()}, for the"
                    " picture",
                    "m",
                    -10.0,
                    10.0,
                    change=Changeable.ANY_TIME,
                )
                for axis in "xyz"
            ),
            Declaration(
                "tool_rate",
                30.0,
                "most frames of the tool in a real second",
                "Hz",
                0.1,
                1000.0,
            ),
            Declaration(
                "frame_prefix",
                "",
                "prefix of the names of all frames, such as cell_1/, where several cells share /tf",
            ),
        ),
    ),
    DeclaredNode(
        "monitor",
        "monitor",
        "serves one live page about the run to browsers",
        (
            Declaration(
                "address",
                "127.0.0.1",
                "address of the page; an address that other computers can reach requires"
                " token_file too",
            ),
            Declaration(
                "port",
                8470,
                "port of the page; 0: any free port, which the log names",
                low=0,
                high=65535,
            ),
            Declaration(
                "token_file",
                "",
                "file, readable by its owner alone, whose first line is the token that control"
                " needs, and viewing from other computers; empty: one is made and printed",
            ),
        ),
    ),
    DeclaredNode(
        "foxglove_server",
        "foxglove_server",
        "serves all topics to Foxglove and other viewers that speak its WebSocket protocol",
        (
            Declaration(
                "address",
                "127.0.0.1",
                "address that viewers connect to; one that other computers can reach requires"
                " open_to_network too",
            ),
            Declaration(
                "port",
                8765,
                "port that viewers connect to; 0: any free port, which the log names",
                low=0,
                high=65535,
            ),
            Declaration(
                "open_to_network",
                False,
                "allow an address that other computers can reach; viewers do not log in, so"
                " everyone there can view the run",
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
                "folder in which the bags are written, RUN.mcap each; created if missing",
                change=Changeable.BETWEEN_RUNS,
            ),
            _READING_TIMEOUT,
            Declaration(
                "position_timeout",
                3.0,
                "time without an actual position after which a run is stopped",
                "s",
                0.05,
                3600.0,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "space_wanted",
                2e9,
                "free disk space below which /diagnostics warns",
                "B",
                0.0,
                1e15,
                change=Changeable.ANY_TIME,
            ),
            Declaration(
                "space_needed",
                2e8,
                "free disk space below which no run starts or continues",
                "B",
                0.0,
                1e15,
                change=Changeable.ANY_TIME,
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
                change=Changeable.ANY_TIME,
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
