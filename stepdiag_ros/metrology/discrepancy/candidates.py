"""The candidates of a run: every effect in every setting, as columns that the baseline leaves.

Whether a run can show a candidate, how small, and which candidates look alike in it, is decided by
the plan and the noise alone, before any reading is looked at.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stepdiag_ros.metrology.discrepancy.baseline import AT_ONCE, Whitened
from stepdiag_ros.metrology.discrepancy.columns import ColumnChanges, Columns, changes_of, in_blocks
from stepdiag_ros.metrology.discrepancy.findings import Candidate
from stepdiag_ros.metrology.effects.effect import Effect, Setting, fault_named
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal

HIDDEN = 1e-3
"""Share of a column beyond the baseline below which nothing but rounding is left of it."""
_ROUNDING = 1e-14
"""m: a change of readings below this is that of a sine at whole turns."""
_NEW = 1e-2
"""Share of a further size's column beyond the first sizes' below which it adds nothing new."""
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
        lengths: of these columns, shape (c,).
        first: column of each candidate's first size, shape (candidates,).
        count: number of each candidate's sizes, shape (candidates,).
        units: orthonormal columns, those of a candidate's first m sizes spanning what these show;
            zero where a size adds nothing, shape (rows, c).
        share: 1 / number of candidates of the same effect, shape (candidates,).
        not_testable: label → why.
        names: what each counts as; candidates of one name are not distinguished (``_names``).
        unknown: candidate → what the run does not determine of it, columns beyond the baseline that
            become free with it (``Effect.unknown``).
    """

    candidates: tuple[Candidate, ...]
    columns: Columns
    lengths: Vector
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    units: Columns
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
            self.columns.chosen(where),
            self.lengths[where],
            np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(count)])[:-1],
            count,
            self.units.chosen(where),
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

    Raises:
        ValueError: the code of an effect fails; names the effect and what it raises.
    """
    hidden: dict[str, str] = {}
    candidates: list[Candidate] = []
    changes: list[ColumnChanges] = []
    free: dict[str, Vector] = {}
    # The same run with other noise: what depends on readings must not depend on their noise.
    noise = problem.noise * np.random.default_rng(0).standard_normal(len(stops.time))
    again = replace(stops, displacement=stops.displacement + noise)
    good = problem.baseline.good
    for effect in catalogue:
        if effect.typical or effect.learned:
            continue
        tried = 0
        with fault_named(effect):
            settings = effect.settings(stops)
            if isinstance(settings, Mapping):
                raise TypeError("'settings' returns one setting; yield each")
            for setting in settings:
                effect.check(setting)
                tried += 1
                candidate = Candidate(effect, setting, _label(effect, setting))
                if (effect.name, candidate.label) in taken:
                    continue
                try:
                    if tried == 1:
                        effect.check_change(setting, stops)
                    columns = _more_than_rounding(effect.columns(setting, stops)[good], effect)
                    blurred = "displacement" in effect.needs and _blurred(
                        columns, effect.columns(setting, again)[good]
                    )
                except Refusal as error:
                    hidden[candidate.label] = str(error)
                    continue
                if not np.all(np.isfinite(columns)):
                    hidden[candidate.label] = "the run does not show all that it depends on"
                elif not np.any(columns):
                    hidden[candidate.label] = "it changes no reading of this run"
                elif blurred:
                    hidden[candidate.label] = (
                        "it depends on the reading itself more finely than the noise lets it be"
                        " known"
                    )
                else:
                    candidates.append(candidate)
                    changes.append(changes_of(columns))
                    unknown = effect.unknown(setting, stops)[good]
                    if unknown.shape[1]:
                        free[candidate.label] = problem.projected(problem.of(unknown))
        if not tried:
            hidden[effect.name] = _why_not_tried(effect, stops)
    return _left_by_baseline(candidates, changes, free, problem, hidden)


def _why_not_tried(effect: Effect, stops: Stops) -> str:
    """Say why an effect has no setting in a run."""
    missing = [name for name in effect.needs if not np.any(np.isfinite(getattr(stops, name)))]
    if effect.needs and not missing:
        recorded = " and ".join(effect.needs).replace("_", " ")
        return f"it changes nothing at the recorded {recorded}"
    needs = f" ({', '.join(missing)})" if missing else ""
    return f"this run lacks what would show it{needs}"


def _label(effect: Effect, setting: Setting) -> str:
    label = effect.label(setting)
    if not isinstance(label, str) or not label:
        raise TypeError(f"'label' returns {label!r} instead of a text")
    return label


def _more_than_rounding(columns: Vector, effect: Effect) -> Vector:
    """Return the columns of sizes, zero where the largest plausible size changes no reading."""
    largest = np.array([size.largest for size in effect.sizes])
    hidden = np.max(np.abs(columns), axis=0, initial=0.0) * largest <= _ROUNDING
    return np.where(hidden & np.isfinite(largest), 0.0, columns)


def _blurred(columns: Vector, again: Vector) -> bool:
    """Say whether columns made from readings with other noise are others."""
    one, two = columns - np.mean(columns, axis=0), again - np.mean(again, axis=0)
    lengths = np.linalg.norm(one, axis=0) * np.linalg.norm(two, axis=0)
    return bool(np.any(np.sum(one * two, axis=0) < _SHARP * lengths))


def _left_by_baseline(
    candidates: list[Candidate],
    changes: list[ColumnChanges],
    free: Mapping[str, Vector],
    problem: Whitened,
    hidden: dict[str, str],
) -> Signatures:
    whole = Columns.of(changes, problem)
    before, after = whole.lengths()
    kept: list[int] = []
    buried: list[tuple[str, int]] = []
    columns: list[NDArray[np.int64]] = []
    place = 0
    for index, candidate in enumerate(candidates):
        here = np.arange(place, place + len(changes[index].counts))
        place += len(here)
        if np.all(after[here] <= HIDDEN * before[here]):
            buried.append((candidate.label, int(here[np.argmax(before[here])])))
            continue
        kept.append(index)
        columns.append(here)
    hidden.update(_hidden_in(buried, whole))
    count = np.array([len(here) for here in columns], dtype=np.int64)
    first = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(count)])[:-1]
    places = np.concatenate([np.zeros(0, dtype=np.int64), *columns])
    # A size that nothing is left of must not pass its rounding off as a signature.
    shown = after[places] > HIDDEN * before[places]
    left = whole.chosen(places).turned(sparse.csc_array(sparse.diags_array(shown * 1.0)))
    lengths = np.where(shown, after[places], 0.0)
    effects = [candidates[index].effect.name for index in kept]
    share = np.array([1.0 / effects.count(name) for name in effects])
    units = left.turned(_orthonormal(left, first, count, lengths))
    some = tuple(candidates[index] for index in kept)
    leading = whole.chosen(places[first])
    unknown = {n: free[one.label] for n, one in enumerate(some) if one.label in free}
    names = _names(some, leading, before[places[first]], count)
    return Signatures(some, left, lengths, first, count, units, share, hidden, names, unknown)


def _names(
    candidates: tuple[Candidate, ...],
    leading: Columns,
    lengths: Vector,
    count: NDArray[np.int64],
) -> tuple[str, ...]:
    """Return what each candidate counts as.

    That is its family; but an effect that begins as a simpler one in the same place does, and only
    adds sizes to it, is that effect in more detail, not another name.

    Args:
        candidates: that the run can show.
        leading: the first column of each.
        lengths: of these before the baseline is taken away.
        count: number of each candidate's sizes.
    """
    names = [candidate.family for candidate in candidates]
    places: dict[str, list[int]] = {}
    for index, candidate in enumerate(candidates):
        words = [str(value) for value in candidate.setting.values() if isinstance(value, str)]
        places.setdefault(" ".join(words), []).append(index)
    for members in places.values():
        simple = np.array(sorted(members, key=lambda index: int(count[index])))
        others = leading.chosen(simple)
        for index in (one for one in members if count[one] > 1):
            fewer = np.flatnonzero(count[simple] < count[index])
            products = others.raw_products(leading.raw(np.array([index])))[fewer, 0]
            both = lengths[simple[fewer]] * lengths[index]
            cosines = np.abs(products) / np.where(both > 0.0, both, np.inf)
            same = np.flatnonzero(cosines > _SAME_BEGINNING)
            if len(same):
                names[index] = names[simple[fewer[same[0]]]]
    return tuple(names)


def _hidden_in(buried: list[tuple[str, int]], columns: Columns) -> dict[str, str]:
    """Say of labelled columns which part of the baseline does the same.

    Args:
        buried: label and place of each.
        columns: of all candidates.
    """
    if not buried:
        return {}
    problem = columns.problem
    matrix = problem.of(problem.baseline.matrix)
    lengths = np.linalg.norm(matrix, axis=0)
    matrix /= np.where(lengths > 0.0, lengths, 1.0)
    words = {}
    for start in range(0, len(buried), AT_ONCE):
        some = buried[start : start + AT_ONCE]
        together = columns.raw(np.array([place for _, place in some]))
        values = np.linalg.lstsq(matrix, together, rcond=1e-9)[0]
        sizes = {
            name: np.linalg.norm(matrix[:, part] @ values[part], axis=0)
            for name, part in problem.baseline.parts.items()
        }
        for number, (label, _) in enumerate(some):
            largest = max(float(size[number]) for size in sizes.values())
            parts = [name for name, size in sizes.items() if size[number] > 0.05 * largest]
            first = f"{' and '.join(parts[:4])}{' and others' if len(parts) > 4 else ''}"
            words[label] = f"{first}, free in the model, would do the same"
    return words


def _orthonormal(
    columns: Columns, first: NDArray[np.int64], count: NDArray[np.int64], lengths: Vector
) -> sparse.csc_array:
    """Return what turns columns into orthonormal ones of each candidate, in the order of its sizes.

    Args:
        columns: of all sizes.
        first: column of each candidate's first size.
        count: number of its sizes.
        lengths: of the columns.

    Returns:
        shape (c, c); a column of zeros where a size adds nothing new.
    """
    scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    rows, places, values = [], [], []
    single = first[count == 1]
    rows.append(single)
    places.append(single)
    values.append(scale[single])
    several = np.flatnonzero(count > 1)
    for members, here in in_blocks(first[several], count[several]):
        units = columns.dense(here) * scale[here]
        ends = np.cumsum(count[several[members]])
        for end, size in zip(ends, count[several[members]], strict=True):
            own = slice(int(end - size), int(end))
            made = _gram_schmidt(units[:, own]) * scale[here[own], None]
            row, column = np.nonzero(made)
            rows.append(here[own][row])
            places.append(here[own][column])
            values.append(made[row, column])
    shape = (columns.count, columns.count)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(places)))
    return sparse.csc_array(sparse.coo_array(entries, shape=shape))


def _gram_schmidt(columns: Vector) -> Vector:
    """Return what turns columns of unit length into orthonormal ones, shape (k, k)."""
    turn: Vector = np.eye(columns.shape[1]) * np.any(columns != 0.0, axis=0)
    units = columns.copy()
    for place in range(1, columns.shape[1]):
        before = units[:, :place]
        rest = units[:, place]
        for _ in range(2):
            parts = before.T @ rest
            rest = rest - before @ parts
            turn[:, place] -= turn[:, :place] @ parts
        length = float(np.linalg.norm(rest))
        scale = 1.0 / length if length > _NEW else 0.0
        units[:, place] = rest * scale
        turn[:, place] *= scale
    return turn


def alike(found: Signatures, index: int, others: Sequence[int]) -> list[int]:
    """Return which of the others show in this run just as a candidate does, whatever its sizes."""
    units = found.units
    real = units.real
    own = units.dense(_told(found, index, real))
    products = units.products(own)
    same = []
    for other in others:
        cosines = np.linalg.svd(products[_told(found, other, real)], compute_uv=False)
        if own.shape[1] == np.count_nonzero(real[found.of(other)]) and cosines[-1] ** 2 >= _ALIKE:
            same.append(other)
    return same


def aliases(found: Signatures, index: int) -> list[int]:
    """Return which settings of one name, beyond neighbours, show just as a candidate does.

    A time constant a little longer is the same effect less well located. A period that shows the
    same at stops of this distance, although periods in between do not, is another one.
    """
    own = found.candidates[index]
    numbers = [key for key, value in own.setting.items() if isinstance(value, float)]
    if len(numbers) != 1:
        return []
    (key,) = numbers
    family = [n for n, one in enumerate(found.candidates) if one.family == own.family]
    family.sort(key=lambda n: float(found.candidates[n].setting[key]))
    same = {index, *alike(found, index, [n for n in family if n != index])}
    place = family.index(index)
    first = last = place
    while first > 0 and family[first - 1] in same:
        first -= 1
    while last + 1 < len(family) and family[last + 1] in same:
        last += 1
    return [n for at, n in enumerate(family) if n in same and not first <= at <= last]


def _told(found: Signatures, index: int, real: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the columns of a candidate that contain something."""
    return int(found.first[index]) + np.flatnonzero(real[found.of(index)])


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
    for index, candidate in enumerate(found.candidates):
        place = found.of(index)
        which = int(np.flatnonzero(found.lengths[place] > 0.0)[0])
        limit = float(needed / found.lengths[place][which])
        size = candidate.effect.sizes[which]
        if limit > size.largest:
            unit = "" if size.unit == "1" else f" {size.unit}"
            hidden[candidate.label] = (
                f"it would be seen only beyond {limit:.2g}{unit} ({size.meaning}), larger than is "
                f"plausible ({size.largest:.2g}{unit})"
            )
        else:
            seen[candidate.label] = limit
    return seen, hidden
