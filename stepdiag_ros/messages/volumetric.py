"""The message of a result, the volumetric errors, to its data class and back; see ``conversion``.

It stands alone because the data class is one of the solvers', which take long to import: most nodes
have nothing to do with results.
"""

from typing import Any

from stepdiag_ros.messages.conversion import vector
from stepdiag_ros.messages.fields import doubles, set_header
from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.geometry import CURVES, Vector, moving_axis
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.result import Figure, VolumetricErrors


def to_volumetric_errors(message: Any) -> VolumetricErrors:
    """Convert a ``VolumetricErrors`` message; the covariance is not in the message and stays empty.

    Raises:
        ValueError: a curve does not have one value a node, or the figures' arrays differ in length.
    """
    nodes = (vector(message.x), vector(message.y), vector(message.z))
    curves: dict[str, Vector] = {}
    uncertainties: dict[str, Vector] = {}
    for name in CURVES:
        values = vector(getattr(message, name.lower()))
        spread = vector(getattr(message, f"u_{name.lower()}"))
        if len(values) == 0 and len(spread) == 0:
            continue
        count = len(nodes[moving_axis(name)])
        if not len(values) == len(spread) == count:
            raise Refusal(
                f"VolumetricErrors: {name} does not have one value at each node", fault="mismatch"
            )
        curves[name], uncertainties[name] = values, spread
    columns = (message.parameter, message.value, message.standard_uncertainty, message.unit)
    if len({len(column) for column in columns}) > 1:
        raise ValueError("VolumetricErrors: the arrays of its figures differ in length")
    return VolumetricErrors(
        method=str(message.method),
        nodes=nodes,
        curves=curves,
        standard_uncertainty=uncertainties,
        figures=tuple(
            Figure(str(name), float(value), float(uncertainty), str(unit))
            for name, value, uncertainty, unit in zip(*columns, strict=True)
        ),
        lines=int(message.lines),
        chi_squared=float(message.chi_squared),
        degrees_of_freedom=int(message.degrees_of_freedom),
        not_determined=tuple(str(text) for text in message.not_determined),
        remarks=tuple(str(text) for text in message.remarks),
        frame=str(message.frame),
    )


def from_volumetric_errors(
    result: VolumetricErrors, run_id: str, time: int, new: NewMessage = new_message
) -> Any:
    """Make a ``VolumetricErrors`` message; time: of the last line that was used, ns."""
    message = new("stepdiag_ros/msg/VolumetricErrors")
    set_header(message, time)
    message.run_id = run_id
    message.method = result.method
    message.lines = int(result.lines)
    message.frame = result.frame
    message.x, message.y, message.z = (doubles(nodes) for nodes in result.nodes)
    for name in result.curves:
        setattr(message, name.lower(), doubles(result.curves[name]))
        setattr(message, f"u_{name.lower()}", doubles(result.standard_uncertainty[name]))
    message.parameter = [figure.name for figure in result.figures]
    message.value = doubles([figure.value for figure in result.figures])
    message.standard_uncertainty = doubles(
        [figure.standard_uncertainty for figure in result.figures]
    )
    message.unit = [figure.unit for figure in result.figures]
    message.chi_squared = float(result.chi_squared)
    message.degrees_of_freedom = int(result.degrees_of_freedom)
    message.not_determined = list(result.not_determined)
    message.remarks = list(result.remarks)
    return message
