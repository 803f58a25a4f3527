"""Parameters that the nodes of devices share, and those of interferometer and weather station.

Part of ``parameters.py``, which says what they are for.
"""

from stepdiag_ros.parameters.declaration import Changeable, Declaration, DeclaredNode

HIGHEST_SAMPLE_RATE = 1e5
"""Hz: of the simulated interferometer."""
CELL = Declaration(
    "cell",
    "demo",
    "simulated cell, if the device is simulated: YAML file, or a name in config/cells",
)
WEATHER_BEGINS = Declaration(
    "weather_begins",
    0,
    "ROS time at which the weather of the simulated cell begins, the same for all its nodes;"
    " 0: when this node starts",
    unit="ns",
    low=0,
    high=2**62,
)
DEVICE_FILE = Declaration(
    "device_file",
    "",
    "settings of the driver: YAML file, or a name in config/devices; empty: the driver's defaults",
    change=Changeable.WHILE_CLOSED,
)
MANAGED = (
    Declaration(
        "autostart",
        True,
        "open the device and use it as soon as the ROS clock runs; false: only when a manager"
        " requests it (ros2 lifecycle set, a launch file)",
    ),
    Declaration(
        "retry_after",
        5.0,
        "real time after which a device that has failed is opened again, with autostart",
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

INTERFEROMETER = DeclaredNode(
    "interferometer",
    "interferometer",
    "streams the readings of a laser interferometer",
    (
        Declaration("device", "simulated", "driver of the instrument (docs/devices.md)"),
        DEVICE_FILE,
        CELL,
        Declaration(
            "rate",
            0.0,
            "readings of the simulated instrument in a second; 0: the cell's own",
            "Hz",
            0.0,
            HIGHEST_SAMPLE_RATE,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "reading_rate_limit",
            1000.0,
            "readings in a second, at most, of an instrument that gives samples: faster ones"
            " travel as blocks, and readings are made of them by a filter (docs/streams.md)",
            "Hz",
            1.0,
            1e4,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "stamps_late",
            0.0,
            "known delay of the time stamps of the readings against those of the positions"
            " ('stepdiag info' estimates it); the node subtracts it",
            "s",
            -10.0,
            10.0,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "seed",
            0,
            "seed of the noise of the simulated readings",
            low=0,
            high=2**31,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "hold_after",
            1.0,
            "time without axis positions after which the last one is taken to hold",
            "s",
            0.0,
            3600.0,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "weather_age",
            10.0,
            "age above which a value of a weather sensor counts as unknown",
            "s",
            0.1,
            86400.0,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "index_equation",
            "edlen",
            "equation for the refractive index of air; edlen is the modified one",
            choices=("edlen", "ciddor"),
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "compensation",
            "instrument",
            "who compensates the readings for the air: the instrument; own: this node, by the"
            " weather topics; off: nobody, and displacements are 270 ppm too long (the bag"
            " keeps the count and the weather: 'stepdiag solve --air own')",
            choices=("instrument", "own", "off"),
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "dead_path",
            0.0,
            "distance from the interferometer's reference to the mirror at the first stop of a"
            " line, where this node compensates",
            "m",
            0.0,
            100.0,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "wavelength",
            632.9908e-9,
            "wavelength of the laser in vacuum, where this node compensates",
            "m",
            300e-9,
            1700e-9,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "reading_timeout",
            2.0,
            "time without a reading after which the beam is stale and a run is stopped",
            "s",
            0.05,
            3600.0,
            change=Changeable.ANY_TIME,
        ),
        Declaration(
            "dim_signal",
            0.2,
            "part of the full signal below which the beam counts as dim",
            low=0.0,
            high=1.0,
            change=Changeable.ANY_TIME,
        ),
        Declaration(
            "rate_tolerance",
            0.1,
            "relative deviation of the reading rate above which the node reports it",
            low=0.0,
            high=1.0,
            change=Changeable.ANY_TIME,
        ),
        WEATHER_BEGINS,
        *MANAGED,
    ),
)
WEATHER = DeclaredNode(
    "weather",
    "weather",
    "publishes what the weather sensors say",
    (
        Declaration("device", "simulated", "driver of the weather station (docs/devices.md)"),
        DEVICE_FILE,
        CELL,
        Declaration(
            "rate",
            1.0,
            "values in a second",
            "Hz",
            0.001,
            1000.0,
            change=Changeable.WHILE_CLOSED,
        ),
        Declaration(
            "value_timeout",
            10.0,
            "age above which a value of the weather station is reported as unknown",
            "s",
            0.1,
            86400.0,
            change=Changeable.ANY_TIME,
        ),
        WEATHER_BEGINS,
        *MANAGED,
    ),
)
