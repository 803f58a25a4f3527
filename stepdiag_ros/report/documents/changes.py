"""Two measurements of one machine beside each other, as a program reads it."""

from dataclasses import asdict

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.changes import ChangesReport
from stepdiag_ros.metrology import agreement
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.schemas.changes import (
    Curve,
    Document,
    Family,
    Figure,
    Joint,
    Judgement,
    Nodes,
    Place,
    Sources,
    Volume,
)
from stepdiag_ros.schemas.origin import origin_of
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.changes import meaning, remarks_of, sentences_of, uncertainty_words, verdict


def changes_json(report: ChangesReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known (schema ``changes``)."""
    changes = report.changes
    moved = changes.moved
    content = Document(
        before=origin_of(asdict(report.before.origin)),
        after=origin_of(asdict(report.after.origin)),
        verdict=verdict(changes).kind,
        words=sentences_of(report),
        meaning=meaning(changes),
        frame=changes.before.frame,
        chain=changes.chain or None,
        nodes=Nodes(
            **{axis: at.tolist() for axis, at in zip(AXES, changes.before.nodes, strict=True)}
        ),
        uncertainty=Sources(
            words=uncertainty_words(report),
            instrument_before=report.instruments[0] or None,
            instrument_after=report.instruments[1] or None,
            shared=changes.shared,
            lower_bound=changes.at_least,
        ),
        judgement=Judgement(
            probability=changes.judgement.probability,
            families=[
                part_of(Family, one, members=len(one.probabilities))
                for one in changes.judgement.families
            ],
        ),
        joint=part_of(Joint, changes.joint),
        volume=Volume(
            rms=_figure(changes.rms),
            worst=_figure(changes.worst),
            worst_place_before=changes.worst_places[0].tolist(),
            worst_place_after=changes.worst_places[1].tolist(),
            rms_standard_uncertainty_before=changes.rms_noise[0],
            rms_standard_uncertainty_after=changes.rms_noise[1],
            moved_most=None if moved is None else _place(moved),
        ),
        figures=[_figure(one) for one in changes.figures],
        curves={one.name: _curve(one) for one in changes.curves},
        remarks=remarks_of(report),
    )
    return schemas.json_text(schemas.document("changes", content))


def _figure(one: agreement.FigureChange) -> Figure:
    return part_of(
        Figure,
        one,
        before_standard_uncertainty=one.before_uncertainty,
        after_standard_uncertainty=one.after_uncertainty,
        difference_standard_uncertainty=one.difference_uncertainty,
    )


def _curve(one: agreement.CurveChange) -> Curve:
    return part_of(
        Curve,
        one,
        before_standard_uncertainty=one.before_uncertainty,
        after_standard_uncertainty=one.after_uncertainty,
        difference_standard_uncertainty=one.difference_uncertainty,
        joint=part_of(Joint, one.joint),
    )


def _place(moved: agreement.PlaceChange) -> Place:
    return part_of(
        Place,
        moved,
        difference_standard_uncertainty=moved.difference_uncertainty,
        length_standard_uncertainty=moved.length_uncertainty,
    )
