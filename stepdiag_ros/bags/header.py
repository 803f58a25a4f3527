"""What identifies a run, written in front of all messages so that even a cut bag still has it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

METADATA_NAME = "stepdiag_ros.run"
PLAN = "plan.yaml"
MACHINE = "machine.yaml"
SIMULATED_CELL = "simulated_cell.yaml"
PARAMETERS = "parameters.yaml"
FACT = "source: "
"""Prefix of the facts of a bag that the source of an imported bag states in words."""


@dataclass(frozen=True)
class Attachment:
    """A file inside the bag: its name, media type and bytes."""

    name: str
    media_type: str
    data: bytes

    @classmethod
    def yaml(cls, name: str, text: str) -> "Attachment":
        """Make an attachment of a YAML text."""
        return cls(name, "application/yaml", text.encode())


@dataclass(frozen=True)
class RunHeader:
    """Identity of a run and the texts that it was made from.

    Attributes:
        run_id: unique: time and a random part.
        plan_name: in words.
        software_version: of stepdiag_ros.
        schema_version: SCHEMA_VERSION of RunDescription.msg.
        middleware: ROS client and middleware, for example ``embedded, Cyclone DDS 11.0.1``.
        start_time: ns.
        plan: YAML text of the test plan.
        machine: YAML text of the machine.
        simulated_cell: YAML text of the simulated cell; empty on a real machine.
        parameters: YAML text of all nodes' parameters.
        facts: further facts, as texts.
        further: further files to keep in the bag.
    """

    run_id: str
    plan_name: str
    software_version: str
    schema_version: int
    middleware: str
    start_time: int
    plan: str = ""
    machine: str = ""
    simulated_cell: str = ""
    parameters: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    further: tuple[Attachment, ...] = ()

    def told_by_source(self) -> dict[str, str]:
        """Return the facts that the source of an imported bag states in words: name → text."""
        return {
            name.removeprefix(FACT): text
            for name, text in self.facts.items()
            if name.startswith(FACT)
        }

    def metadata(self) -> dict[str, str]:
        """Return the identity as the texts of a metadata record."""
        return {
            **self.facts,
            "run_id": self.run_id,
            "plan_name": self.plan_name,
            "software_version": self.software_version,
            "schema_version": str(self.schema_version),
            "middleware": self.middleware,
            "start_time": str(self.start_time),
        }

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the files to attach: of the four texts those that are there, then the others."""
        texts = {
            PLAN: self.plan,
            MACHINE: self.machine,
            SIMULATED_CELL: self.simulated_cell,
            PARAMETERS: self.parameters,
        }
        return (
            *(Attachment.yaml(name, text) for name, text in texts.items() if text),
            *self.further,
        )

    @classmethod
    def from_parts(
        cls, metadata: Mapping[str, str], attachments: Iterable[Attachment]
    ) -> "RunHeader":
        """Put the header together again from a bag's metadata record and attachments.

        Raises:
            ValueError: a number of the metadata is malformed, or an attached text is not text.
        """
        rest = dict(metadata)
        files = {attachment.name: attachment for attachment in attachments}
        texts = {
            name: files.pop(name).data.decode() if name in files else ""
            for name in (PLAN, MACHINE, SIMULATED_CELL, PARAMETERS)
        }
        return cls(
            run_id=rest.pop("run_id", ""),
            plan_name=rest.pop("plan_name", ""),
            software_version=rest.pop("software_version", ""),
            schema_version=int(rest.pop("schema_version", "0")),
            middleware=rest.pop("middleware", ""),
            start_time=int(rest.pop("start_time", "0")),
            plan=texts[PLAN],
            machine=texts[MACHINE],
            simulated_cell=texts[SIMULATED_CELL],
            parameters=texts[PARAMETERS],
            facts=rest,
            further=tuple(files.values()),
        )
