"""What launch files use of ROS 2's launch packages, to be looked at afterwards."""

import sys
from types import ModuleType, SimpleNamespace


class Noted:
    """Keeps the arguments that it was made with."""

    def __init__(self, *arguments, **options):
        self.arguments, self.options = arguments, options


def modules():
    """Return modules to be put into ``sys.modules``; each class is one that only takes notes."""
    classes = {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": (
            "DeclareLaunchArgument",
            "ExecuteProcess",
            "IncludeLaunchDescription",
            "OpaqueFunction",
        ),
        "launch.events": (),
        "launch.events.process": ("ProcessExited",),
        "launch_ros": (),
        "launch_ros.actions": ("LifecycleNode", "Node"),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
        "launch_ros.substitutions": ("ExecutableInPackage", "FindPackageShare"),
        "launch_testing": (),
        "launch_testing.actions": ("ReadyToTest",),
        "launch_testing.asserts": ("assertExitCodes",),
    }
    made = {}
    for name, members in classes.items():
        made[name] = ModuleType(name)
        for member in members:
            setattr(made[name], member, type(member, (Noted,), {}))
    made["launch_testing"].post_shutdown_test = lambda: lambda tests: tests
    return made


def launched(path, **given):
    """Return the declared arguments of a launch file, and the actions for some values of them."""
    text = path.read_text()
    # Otherwise the classes of an earlier test would stay in it.
    sys.modules.pop("stepdiag_ros.processes.launching", None)
    module = {"__name__": path.name}
    exec(compile(text, str(path), "exec"), module)
    *declared, function = module["generate_launch_description"]().arguments[0]
    arguments = {action.arguments[0]: action.options for action in declared}
    values = {
        name: given.get(name, options["default_value"]) for name, options in arguments.items()
    }
    context = SimpleNamespace(launch_configurations=values)
    return arguments, function.options["function"](context)
