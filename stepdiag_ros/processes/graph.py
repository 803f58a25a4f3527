"""The command line as a part of the ROS graph."""

from collections.abc import Iterator
from contextlib import contextmanager

from stepdiag_ros.processes.node_process import ENCLAVE


@contextmanager
def in_graph(namespace: str = "") -> Iterator[None]:
    """Be part of the ROS graph while the block runs.

    Ctrl-C and a request to end (SIGTERM) both raise KeyboardInterrupt in the block (the latter
    ``run.interruption.Terminated``), which leaves time to stop the machine and to close the bag.

    Args:
        namespace: of the nodes that are made in the block, such as ``/cell_1``; empty for none.

    Raises:
        ValueError: the graph cannot be joined, for example because of a wrong ROS_DOMAIN_ID.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from stepdiag_ros.nodes import interrupts

    with interrupts.raised():
        try:
            arguments = ["--ros-args", "--enclave", f"{ENCLAVE}/operator"]
            # Which client library is in use is for the logs of nodes, not for a short command.
            arguments += ["--log-level", "rclpy:=warn"]
            arguments += ["-r", f"__ns:={namespace}"] if namespace else []
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise ValueError(str(error)) from error
        try:
            yield
        finally:
            rclpy.try_shutdown()
