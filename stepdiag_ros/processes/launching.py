"""What the launch files share: nodes and arguments as ``ros2 launch`` wants them.

Only the files in ``launch/`` use this module; it needs ROS 2's own ``launch`` and ``launch_ros``.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.events.process import ProcessExited
from launch_ros.actions import LifecycleNode, Node
from launch_ros.parameter_descriptions import ParameterValue

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.processes.node_process import OVERRIDE, NodeProcess, exit_words
from stepdiag_ros.run.supervision import DISPENSABLE

PACKAGE = "stepdiag_ros"
TRUTHS = ("true", "false")


@dataclass(frozen=True)
class Argument:
    """One launch argument, given as ``NAME:=VALUE``.

    Attributes:
        description: what ``--show-args`` says.
        default: None where it must be given.
        choices: the only values allowed; empty if any is.
    """

    description: str
    default: str | None = None
    choices: tuple[str, ...] = ()


ARCHIVE = Argument("archive for the bag of each run: a folder, or a URL; empty: none", "")
NAMESPACE = Argument("namespace of all nodes and topics, for several machines in one network", "")


def description(
    arguments: Mapping[str, Argument], make: Callable[[Mapping[str, str]], list[Any]]
) -> LaunchDescription:
    """Return a launch description.

    Args:
        arguments: by name.
        make: is given the value of each argument, and returns the actions.
    """

    def start(context: LaunchContext) -> list[Any]:
        return make({name: context.launch_configurations[name] for name in arguments})

    declared = [
        DeclareLaunchArgument(
            name,
            default_value=argument.default,
            description=argument.description,
            **({"choices": argument.choices} if argument.choices else {}),
        )
        for name, argument in arguments.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def number(values: Mapping[str, str], name: str) -> float:
    """Return the value of an argument that is a number.

    Raises:
        ValueError: it is not valid.
    """
    try:
        return float(values[name])
    except ValueError:
        raise Refusal(
            f"the argument {name} is '{values[name]}'; expected a number", fault="malformed"
        ) from None


def ends_launch(name: str) -> Callable[[ProcessExited, LaunchContext], None]:
    """Return what is to be done when a process has ended: one that failed ends the whole launch.

    The launch reports which process it was, and its exit code is 1. A process that was killed ends
    nothing: a run that is held by its loss goes on when it is back.

    Args:
        name: what the process is called in the sentence.
    """

    def ended(event: ProcessExited, context: LaunchContext) -> None:
        if event.returncode > 0 and not context.is_shutdown:
            # An action that shuts down would end the launch with exit code 0.
            raise RuntimeError(
                f"{name} has ended ({exit_words(event.returncode)}) and is needed, so all others"
                " are ended too; the cause is shown above"
            )

    return ended


def started(
    processes: Iterable[NodeProcess],
    namespace: str = "",
    parameter_files: Iterable[str] = (),
    dispensable: Collection[str] = DISPENSABLE,
) -> list[Any]:
    """Return what starts nodes; those of devices can be led by launch events.

    Args:
        processes: which nodes, with parameters that win over those of the files.
        namespace: of all of them; empty for none.
        parameter_files: ROS 2 parameter files for all of them.
        dispensable: names of the nodes whose failure does not end the launch.
    """
    files = tuple(parameter_files)
    return [
        _start(process, namespace, files, process.name not in dispensable) for process in processes
    ]


def _start(
    process: NodeProcess, namespace: str, parameter_files: tuple[str, ...], needed: bool
) -> Any:
    declared = declared_node(process.name)
    given = {name: _value(value) for name, value in process.parameters.items()}
    managed = any(declaration.name == "autostart" for declaration in declared.parameters)
    kind = LifecycleNode if managed else Node
    return kind(
        package=PACKAGE,
        executable=process.name,
        name=declared.name,
        namespace=namespace,
        output="screen",
        parameters=[*parameter_files, *([given] if given else [])],
        ros_arguments=["--enclave", process.enclave],
        # That of ros2 launch itself is not for the nodes.
        additional_env={OVERRIDE: ""},
        **({"on_exit": ends_launch(f"the {process.name} node")} if needed else {}),
    )


def _value(value: object) -> object:
    if isinstance(value, str | Path):
        # Otherwise a file that is called 12 would become a number.
        return ParameterValue(str(value), value_type=str)
    return value
