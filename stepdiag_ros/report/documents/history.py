"""What becomes of effects from run to run, as a JSON document."""

from collections.abc import Sequence

from stepdiag_ros import schemas
from stepdiag_ros.evaluation.history import HistoryReport, MeasuredTogether
from stepdiag_ros.metrology.discrepancy.course import CHANGE_LEVEL, Figure
from stepdiag_ros.metrology.discrepancy.history import NAME_LEVEL, EffectHistory
from stepdiag_ros.schemas.diagnosis import FurtherRun
from stepdiag_ros.schemas.history import Document, Effect, Followed, Run, Value
from stepdiag_ros.schemas.parts import part_of
from stepdiag_ros.words.history import effect_sentence, remark_sentences


def history_json(report: HistoryReport) -> str:
    """Return the report as JSON text; SI, ``null`` where not known."""
    content = Document(
        model_file=report.model_source or None,
        runs=[_run(number, run) for number, run in enumerate(report.runs, 1)],
        effects=[_effect(one) for one in report.effects],
        change_level=CHANGE_LEVEL,
        name_level=NAME_LEVEL,
        remarks=remark_sentences(report),
    )
    return schemas.json_text(schemas.document("history", content))


def _run(number: int, run: MeasuredTogether) -> Run:
    return Run(
        number=number,
        start=run.start.isoformat(timespec="seconds"),
        files=[
            FurtherRun(run_id=one.run_id or None, bag=str(one.path), sha256=one.sha256)
            for one in run.files
        ],
        verdict=run.diagnosis.verdict,
        sentence=run.diagnosis.sentence,
        noise_m=run.diagnosis.noise,
    )


def _effect(effect: EffectHistory) -> Effect:
    course = effect.course
    return part_of(
        Effect,
        effect,
        shapes=[one.label for one in effect.candidates],
        kind=course.kind,
        sentence=effect_sentence(effect),
        size=part_of(Followed, effect.figure),
        sizes=[_value(one) for one in course.sizes],
        explained=course.explained,
        common=_value(course.common),
        rate=_value(course.rate),
        having=_numbers(course.having),
        lacking=_numbers(course.lacking),
        cannot_show=_numbers(course.blind),
        named_in=_numbers(effect.named_in),
        p_one_size=course.p_common,
        p_line=course.p_line,
        p_some=course.p_some,
    )


def _value(figure: Figure) -> Value:
    return part_of(Value, figure, band_95=figure.band)


def _numbers(indices: Sequence[int]) -> list[int]:
    return [index + 1 for index in indices]
