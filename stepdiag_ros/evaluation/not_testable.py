"""What a run cannot show, in sentences: they are published and recorded with its diagnosis."""

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import takewhile

import numpy as np

from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import two_digits

_MOST_SETTINGS = 4
"""Settings of one effect that are listed one by one; of more, only the range is printed."""


_LENGTH_IN_WORDS = re.compile(r"(\d[\d.]*(?:e[+-]?\d+)?) m\b")


def settings_words(name: str, labels: Sequence[str]) -> str:
    """Name several settings of one effect in one label: ``backlash of X, Y, Z``."""
    if len(labels) > _MOST_SETTINGS:
        return f"{name} ({len(labels):,} settings)"
    words = [label.split(" ") for label in labels]
    same = len(list(takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))))
    if len(labels) == 1 or not same:
        return ", ".join(labels)
    return " ".join([*words[0][:same], ", ".join(" ".join(one[same:]) for one in words)])


def by_effect(report: DiagnosisReport, labels: Collection[str]) -> dict[str, list[str]]:
    """Return which of these labels belong to which effect of the catalogue: name → labels."""
    found: dict[str, list[str]] = {}
    for effect in report.catalogue.values():
        for setting in effect.settings(report.diagnosis.stops):
            label = effect.label(setting)
            if label in labels:
                found.setdefault(effect.name, []).append(label)
    return found


def not_testable_sentences(report: DiagnosisReport) -> list[str]:
    """Say what this run cannot show, one sentence for each reason.

    Reasons that differ only in a length are one, with its range.
    """
    reasons = report.diagnosis.not_testable
    kinds: dict[str, list[str]] = {}
    for label, why in reasons.items():
        kinds.setdefault(_LENGTH_IN_WORDS.sub("{}", why), []).append(label)
    known = by_effect(report, reasons)
    sentences = []
    for kind, labels in kinds.items():
        shown = _shown(labels, known)
        lengths = np.array([_LENGTH_IN_WORDS.findall(reasons[label]) for label in labels], float)
        words = kind
        for column in lengths.T * IN_MICRO:
            low, high = two_digits(column.min()), two_digits(column.max())
            words = words.replace("{}", f"{low if low == high else f'{low} .. {high}'} µm", 1)
        sentences.append(f"{shown}: {words.rstrip('.')}.")
    return sentences


def _shown(labels: list[str], known: Mapping[str, list[str]]) -> str:
    """List labels; many of one effect are only counted."""
    left, parts = set(labels), []
    for name, own in known.items():
        here = [label for label in own if label in left]
        if len(here) > _MOST_SETTINGS:
            parts.append(f"{name} ({len(here):,} settings)")
            left -= set(here)
    return ", ".join([*(label for label in labels if label in left), *parts])
