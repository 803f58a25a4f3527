"""The candidates of a run: every effect in every setting, as columns that the baseline leaves.

Whether a run can show a candidate, how small, and which candidates look alike in it, is decided by
the plan and the noise alone, before any reading is looked at.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.findings import Candidate
from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector

_HIDDEN = 1e-3
"""Share of a column beyond the baseline below which nothing but rounding is left of it."""
_NEW = 1e-2
"""Share of a further size's column beyond the first sizes' below which it tells nothing new."""
_ALIKE = 0.995
"""Share of one signature that another must make up to count as the same (squared cosine)."""
_SHARP = 0.9
"""Correlation of a column with itself under other noise below which it is blurred."""
_SAME_BEGINNING = 1.0 - 1e-9
_SEEN = 1.645
"""Normal quantile of 95 %: a limit is seen 19 times in 20."""


@dataclass(frozen=True)
class Signatures:
    """Candidates with their columns, whitened and projected.

    Attributes:
        candidates: that the run can show.
        columns: of all sizes of all candidates, beyond the baseline, shape (rows, c).
        first: column of each candidate's first size, shape (candidates,).
        count: number of each candidate's sizes, shape (candidates,).
        units: orthonormal columns, those of a candidate's first m sizes spanning what these show;
            zero where a size adds nothing, shape (rows, c).
        share: 1 / number of candidates of the same effect, shape (candidates,).
        not_testable: label → why.
        names: what each counts as; candidates of one name are not told apart (``_names``).
        unknown: candidate → what the run does not tell of it, columns beyond the baseline that
            become free with it (``Effect.unknown``).
    """

    candidates: tuple[Candidate, ...]
    columns: Vector
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    units: Vector
    share: Vector
    not_testable: Mapping[str, str]
    names: tuple[str, ...]
    unknown: Mapping[int, Vector]

    def of(self, index: int) -> slice:
        """Return the columns of a candidate."""
        return slice(int(self.first[index]), int(self.first[index] + self.count[index]))

    def subset(self, chosen: Sequence[int]) -> "Signatures":
        """Return some of the candidates, with the shares that they have among all."""
        places = [np.arange(self.of(index).start, self.of(index).stop) for index in chosen]
        where = np.concatenate(places) if places else np.zeros(0, dtype=np.int64)
        count = self.count[list(chosen)]
        return Signatures(
            tuple(self.candidates[index] for index in chosen),
            self.columns[:, where],
            np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(count)])[:-1],
            count,
            self.units[:, where],
            self.share[list(chosen)],
            self.not_testable,
            tuple(self.names[index] for index in chosen),
            {n: self.unknown[one] for n, one in enumerate(chosen) if one in self.unknown},
        )


def signatures(
    catalogue: Iterable[Effect],
    stops: Stops,
    problem: Whitened,
    taken: Container[tuple[str, str]] = (),
) -> Signatures:
    """Make the candidates of a run and leave out those that it cannot show.

    Args:
        catalogue: effects to try.
        stops: of the run.
        problem: whitened, the baseline projected out.
        taken: name and label of those that the model has already with a free size.
    """
    hidden: dict[str, str] = {}
    candidates: list[Candidate] = []
    blocks: list[Vector] = []
    free: dict[str, Vector] = {}
    # The same run with other noise: what depends on readings must not depend on their noise.
    noise = problem.noise * np.random.default_rng(0).standard_normal(len(stops.time))
    again = replace(stops, displacement=stops.displacement + noise)
    good = problem.baseline.good
    for effect in catalogue:
        if effect.typical:
            continue
        tried = 0
        for setting in effect.settings(stops):
            tried += 1
            candidate = Candidate(effect, setting, effect.label(setting))
            if (effect.name, candidate.label) in taken:
                continue
            try:
                columns = effect.columns(setting, stops)[good]
                blurred = "displacement" in effect.needs and _blurred(
                    columns, effect.columns(setting, again)[good]
                )
            except ValueError as error:
                hidden[candidate.label] = str(error)
                continue
            if not np.all(np.isfinite(columns)):
                hidden[candidate.label] = "the run does not tell all that it depends on"
            elif not np.any(columns):
                hidden[candidate.label] = "it changes no reading of this run"
            elif blurred:
                hidden[candidate.label] = (
                    "it depends on the reading itself more finely than the noise lets it be known"
                )
            else:
                candidates.append(candidate)
                blocks.append(columns)
                unknown = effect.unknown(setting, stops)[good]
                if unknown.shape[1]:
                    free[candidate.label] = problem.projected(problem.of(unknown))
        if not tried:
            needs = f" ({', '.join(effect.needs)})" if effect.needs else ""
            hidden[effect.name] = f"this run lacks what would show it{needs}"
    return _left_by_baseline(candidates, blocks, free, problem, hidden)


def _blurred(columns: Vector, again: Vector) -> bool:
    """Say whether columns made from readings with other noise are others."""
    one, two = columns - np.mean(columns, axis=0), again - np.mean(again, axis=0)
    lengths = np.linalg.norm(one, axis=0) * np.linalg.norm(two, axis=0)
    return bool(np.any(np.sum(one * two, axis=0) < _SHARP * lengths))


def _left_by_baseline(
    candidates: list[Candidate],
    blocks: list[Vector],
    free: Mapping[str, Vector],
    problem: Whitened,
    hidden: dict[str, str],
) -> Signatures:
    rows = len(problem.gap)
    raw = problem.of(np.column_stack(blocks)) if blocks else np.zeros((rows, 0))
    left = problem.projected(raw)
    before, after = np.linalg.norm(raw, axis=0), np.linalg.norm(left, axis=0)
    kept: list[int] = []
    buried: list[tuple[str, Vector]] = []
    columns: list[NDArray[np.int64]] = []
    place = 0
    for index, candidate in enumerate(candidates):
        here = np.arange(place, place + blocks[index].shape[1])
        place += len(here)
        if np.all(after[here] <= _HIDDEN * before[here]):
            buried.append((candidate.label, raw[:, here[0]]))
            continue
        # A size that nothing is left of must not pass its rounding off as a signature.
        left[:, here[after[here] <= _HIDDEN * before[here]]] = 0.0
        kept.append(index)
        columns.append(here)
    hidden.update(_hidden_in(buried, problem))
    count = np.array([len(here) for here in columns], dtype=np.int64)
    first = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(count)])[:-1]
    chosen = left[:, np.concatenate(columns)] if columns else left[:, :0]
    effects = [candidates[index].effect.name for index in kept]
    share = np.array([1.0 / effects.count(name) for name in effects])
    units = _orthonormal(chosen, first, count, np.linalg.norm(chosen, axis=0))
    some = tuple(candidates[index] for index in kept)
    leading = raw[:, [int(here[0]) for here in columns]]
    unknown = {n: free[one.label] for n, one in enumerate(some) if one.label in free}
    names = _names(some, leading, count)
    return Signatures(some, chosen, first, count, units, share, hidden, names, unknown)


def _names(
    candidates: tuple[Candidate, ...], leading: Vector, count: NDArray[np.int64]
) -> tuple[str, ...]:
    """Return what each candidate counts as.

    That is its family; but an effect that begins as a simpler one in the same place does, and only
    adds sizes to it, is that effect in more detail, not another name.
    """
    names = [candidate.family for candidate in candidates]
    unit = leading / np.maximum(np.linalg.norm(leading, axis=0), 1e-300)
    places: dict[str, list[int]] = {}
    for index, candidate in enumerate(candidates):
        words = [str(value) for value in candidate.setting.values() if isinstance(value, str)]
        places.setdefault(" ".join(words), []).append(index)
    for members in places.values():
        simple = sorted(members, key=lambda index: int(count[index]))
        for index in (one for one in members if count[one] > 1):
            for other in simple:
                if count[other] >= count[index]:
                    break
                if abs(float(unit[:, index] @ unit[:, other])) > _SAME_BEGINNING:
                    names[index] = names[other]
                    break
    return tuple(names)


def _hidden_in(buried: list[tuple[str, Vector]], problem: Whitened) -> dict[str, str]:
    """Say of labelled columns which part of the baseline does the same."""
    if not buried:
        return {}
    baseline = problem.baseline
    matrix = problem.of(baseline.matrix)
    lengths = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)
    together = np.column_stack([column for _, column in buried])
    values = np.linalg.lstsq(scaled, together, rcond=1e-9)[0]
    sizes = {
        name: np.linalg.norm(scaled[:, columns] @ values[columns], axis=0)
        for name, columns in baseline.parts.items()
    }
    words = {}
    for number, (label, _) in enumerate(buried):
        largest = max(float(size[number]) for size in sizes.values())
        parts = [name for name, size in sizes.items() if size[number] > 0.05 * largest]
        some = f"{' and '.join(parts[:4])}{' and others' if len(parts) > 4 else ''}"
        words[label] = f"{some}, free in the model, would do the same"
    return words


def _orthonormal(
    columns: Vector, first: NDArray[np.int64], count: NDArray[np.int64], reference: Vector
) -> Vector:
    """Return orthonormal columns of each candidate, in the order of its sizes."""
    units = columns.copy()
    lengths = np.linalg.norm(columns, axis=0)
    seen = (lengths > _NEW * reference) & (lengths > 0.0)
    units[:, seen] /= lengths[seen]
    units[:, ~seen] = 0.0
    for index in np.flatnonzero(count > 1):
        for place in range(int(first[index]), int(first[index] + count[index])):
            before = units[:, int(first[index]) : place]
            if not before.shape[1] or not seen[place]:
                continue
            rest = units[:, place] - before @ (before.T @ units[:, place])
            rest -= before @ (before.T @ rest)
            length = float(np.linalg.norm(rest))
            units[:, place] = rest / length if length > _NEW else 0.0
    made: Vector = units
    return made


def alike(found: Signatures, index: int, others: Sequence[int]) -> list[int]:
    """Return which of the others show in this run just as a candidate does, whatever its sizes."""
    own = _real(found.units[:, found.of(index)])
    same = []
    for other in others:
        units = _real(found.units[:, found.of(other)])
        cosines = np.linalg.svd(own.T @ units, compute_uv=False)
        if own.shape[1] == units.shape[1] and cosines[-1] ** 2 >= _ALIKE:
            same.append(other)
    return same


def _real(units: Vector) -> Vector:
    real: Vector = units[:, np.any(units != 0.0, axis=0)]
    return real


def limits(found: Signatures, threshold: float) -> tuple[dict[str, float], dict[str, str]]:
    """Return the detection limit of each candidate, and why some are too large to be of use.

    A size is seen 19 times in 20 if its gain is expected beyond the threshold by that much. Of an
    effect with several sizes it is that of the first that shows, the others being zero.

    Args:
        found: the candidates.
        threshold: gain of χ² beyond which an effect is named.
    """
    seen: dict[str, float] = {}
    hidden: dict[str, str] = {}
    needed = np.sqrt(threshold) + _SEEN
    lengths = np.linalg.norm(found.columns, axis=0)
    for index, candidate in enumerate(found.candidates):
        place = found.of(index)
        which = int(np.flatnonzero(lengths[place] > 0.0)[0])
        limit = float(needed / lengths[place][which])
        size = candidate.effect.sizes[which]
        if limit > max(abs(size.low), abs(size.high)):
            unit = "" if size.unit == "1" else f" {size.unit}"
            hidden[candidate.label] = (
                f"it would be seen only beyond {limit:.2g}{unit} ({size.meaning}), larger than is "
                f"plausible ({max(abs(size.low), abs(size.high)):.2g}{unit})"
            )
        else:
            seen[candidate.label] = limit
    return seen, hidden
