"""What was done to an NC program, with the proof of what error remains."""

from dataclasses import dataclass

from stepdiag_ros.compensation.identified import Origin
from stepdiag_ros.compensation.nc_proof import Proof
from stepdiag_ros.compensation.nc_rewrite import RewriteSettings, Rewritten

REVERSAL = (
    "targets are corrected by the mean of both directions of approach: reversal errors (backlash)"
    " stay, and belong into the control"
)
TOOL = (
    "the errors are those of the point that was measured; a tool of another length is displaced"
    " further by the rotations of the axes"
)


@dataclass(frozen=True)
class NcReport:
    """One rewritten program.

    Attributes:
        program: path of the original.
        program_sha256: of its bytes.
        written: path of the rewritten one; empty if it was not written.
        origin: of the error map.
        settings: how it was rewritten.
        rewritten: the program.
        proof: what remains.
        remarks: about the map.
    """

    program: str
    program_sha256: str
    written: str
    origin: Origin
    settings: RewriteSettings
    rewritten: Rewritten
    proof: Proof
    remarks: tuple[str, ...] = ()

    @property
    def all_remarks(self) -> tuple[str, ...]:
        """Return what the reader must know, each once."""
        return tuple(dict.fromkeys((*self.rewritten.remarks, *self.remarks, REVERSAL, TOOL)))
