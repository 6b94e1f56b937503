"""Fields at points and along lines, anywhere in the bodies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices
from geom2iga.errors import CaseError
from geom2iga.inversion import find_in_model
from geom2iga.model import Model
from post.case import LineProbe, PointProbe, Post, PostCase
from post.collection import results_of_steps
from post.fields import BodySamples, sample_at
from post.quantities import QUANTITIES
from solve.material import named_bodies
from solve.output import write_rows
from solve.result import Result


@dataclass(frozen=True, eq=False)
class LineSamples:
    """Fields along a line, a row per point and body that holds it, so that curves jump where bodies touch.

    Parameters
    ----------
    distance : (r,)
        From the start [length].
    body : (r,) names
        Empty outside all bodies.
    samples : BodySamples
        Not a number there.
    """

    distance: Array
    body: tuple[str, ...]
    samples: BodySamples


@dataclass(frozen=True, eq=False)
class PointSamples:
    """Fields at a point, a row per load step.

    Parameters
    ----------
    load_factor : (s,)
        Share of the loads.
    body : str
    samples : BodySamples
    """

    load_factor: Array
    body: str
    samples: BodySamples


def probe(result: Result, points: Array, body: str | None = None) -> BodySamples:
    """Evaluate displacement and stress at any points of the undeformed bodies.

    Parameters
    ----------
    points : (q, 3)
        Undeformed positions [length].
    body : str
        The only one that is looked at; left out, the first that holds a point counts.

    Returns
    -------
    BodySamples
        Not a number at points outside.

    Raises
    ------
    CaseError
        An unknown body; an analysis that has not converged.
    """
    points = np.asarray(points, dtype=float)
    return _evaluated(result, points, *find_in_model(result.model, points, body))


def sample_line(result: Result, line: LineProbe) -> LineSamples:
    """Evaluate along a line.

    Where bodies touch, the one that the line leaves comes before the one that it enters. Where patches of one body
    meet, the first of them counts.

    Raises
    ------
    CaseError
        An unknown body; an analysis that has not converged.
    """
    points, bodies = _points_along(line), tuple(result.model.bodies) if line.body is None else (line.body,)
    found = [find_in_model(result.model, points, body) for body in bodies]
    numbers, xi = (np.stack(parts) for parts in zip(*found, strict=True))
    which, at = np.nonzero(numbers >= 0)
    entered = numbers[which, np.maximum(at - 1, 0)] < 0
    outside = np.flatnonzero((numbers < 0).all(axis=0))
    which, at = np.append(which, np.full(len(outside), -1)), np.append(at, outside)
    order = np.lexsort((np.append(entered, np.zeros(len(outside), dtype=bool)), at))
    which, at = which[order], at[order]
    return LineSamples(
        np.linalg.norm(points[at] - points[0], axis=1),
        tuple((*bodies, "")[number] for number in which),
        _evaluated(result, points[at], numbers[which, at], xi[which, at]),
    )


def sample_point(result: Result, point: PointProbe) -> PointSamples:
    """Evaluate at a point in every load step.

    Raises
    ------
    CaseError
        An unknown body; a point in no body, or in several where none is named; an analysis that has not converged.
    """
    return _sample_points(result, [point])[0]


def _sample_points(result: Result, probes: Sequence[PointProbe]) -> list[PointSamples]:
    """Evaluate at points in every load step."""
    result.check_converged()
    bodies, numbers, xi = _holders(result.model, probes)
    at = np.array([probe.at for probe in probes]).reshape(-1, 3)
    parts = [_evaluated(step, at, numbers, xi) for step in results_of_steps(result)]
    factors = np.array([state.load_factor for state in result.states])
    points, displacement, stress = (
        np.stack([getattr(part, name) for part in parts], axis=1) for name in ("points", "displacement", "stress")
    )
    none = np.empty((0, 8), dtype=np.int64)
    return [
        PointSamples(factors, body, BodySamples(points[n], displacement[n], stress[n], none))
        for n, body in enumerate(bodies)
    ]


class Probes(NamedTuple):
    """What the probes of a case found, by their names."""

    lines: Mapping[str, LineSamples]
    points: Mapping[str, PointSamples]


def sample_probes(result: Result, post: Post) -> Probes:
    """Evaluate along all lines and at all points of a case."""
    lines = {line.name: sample_line(result, line) for line in post.line}
    points = _sample_points(result, post.point)
    return Probes(lines, {point.name: found for point, found in zip(post.point, points, strict=True)})


def write_line(path: Path, line: LineSamples) -> None:
    """Write line_<name>.csv, a row per point and body."""
    columns = {"distance": line.distance.tolist(), **_columns(line.samples, line.body)}
    _write_columns(path, columns)


def write_point(path: Path, point: PointSamples) -> None:
    """Write point_<name>.csv, a row per load step."""
    count = len(point.load_factor)
    columns = {"load_step": list(range(1, count + 1)), "load_factor": point.load_factor.tolist()}
    _write_columns(path, {**columns, **_columns(point.samples, [point.body] * count)})


def check_probes(model: Model, case: PostCase) -> None:
    """Raise CaseError where a probe names an unknown body, or meets none, or is a point in several."""
    _holders(model, case.post.point)
    for number, line in enumerate(case.post.line):
        key = f"post.line[{number}]"
        _check_body(model, line.body, key)
        points = _points_along(line)
        if (find_in_model(model, points, line.body)[0] < 0).all():
            ends = f"from {_listed(line.start)} to {_listed(line.end)}"
            raise CaseError(f"{key}: all points of the line {ends} lie outside {_missed(model, points, line.body)}")


def _points_along(line: LineProbe) -> Array:
    """Points (q, 3) at equal distances, both ends exactly."""
    return np.linspace(line.start, line.end, line.points)


def _evaluated(result: Result, points: Array, numbers: Indices, xi: Array) -> BodySamples:
    """Evaluate at parametric points (q, 3) of patches (q,); not a number where that is -1."""
    names = list(result.model.patches)
    displacement, stress = np.full((len(points), 3), np.nan), np.full((len(points), 6), np.nan)
    for number in np.unique(numbers[numbers >= 0]):
        own = numbers == number
        part = sample_at(result, names[number], xi[own])
        displacement[own], stress[own] = part.displacement, part.stress
    return BodySamples(points, displacement, stress, np.empty((0, 8), dtype=np.int64))


def _holders(model: Model, points: Sequence[PointProbe]) -> tuple[list[str], Indices, Array]:
    """Find the body, the number of the patch (q,) and the place in it (q, 3) of points; raise CaseError without one."""
    at = np.array([point.at for point in points]).reshape(-1, 3)
    found = {body: find_in_model(model, at, body) for body in model.bodies} if points else {}
    bodies = []
    for number, point in enumerate(points):
        key = f"post.point[{number}]"
        _check_body(model, point.body, key)
        held = [body for body in found if found[body][0][number] >= 0 and point.body in (None, body)]
        if not held:
            missed = _missed(model, at[number : number + 1], point.body)
            raise CaseError(f"{key}.at = {_listed(point.at)} lies outside {missed}")
        if len(held) > 1:
            names = " and ".join(f'"{body}"' for body in held)
            raise CaseError(f"{key}.at = {_listed(point.at)} lies in {names}: name one of them as body")
        bodies += held
    numbers = np.array([found[body][0][number] for number, body in enumerate(bodies)], dtype=np.int64)
    return bodies, numbers, np.array([found[body][1][number] for number, body in enumerate(bodies)]).reshape(-1, 3)


def _check_body(model: Model, body: str | None, key: str) -> None:
    """Raise CaseError where a body is named that does not exist."""
    named_bodies(model, None if body is None else (body,), f"{key}.body")


def _missed(model: Model, points: Array, body: str | None) -> str:
    """Say where the body that was missed lies, or the nearest, by the boxes around control points."""
    boxes = {name: _box(model, name) for name in ([body] if body else model.bodies)}

    def distance(name: str) -> float:
        low, high = boxes[name]
        return float(np.abs(points - np.clip(points, low, high)).max(axis=1).min())

    nearest = min(boxes, key=distance)
    low, high = (_listed(corner.tolist()) for corner in boxes[nearest])
    which = f'body "{nearest}", which lies' if body else f'every body; the nearest, "{nearest}", lies'
    return f"{which} within {low} to {high}"


def _box(model: Model, body: str) -> tuple[Array, Array]:
    """Lower and upper corner of the box around the control points of a body."""
    points = np.concatenate([model.patches[name].control_points.reshape(-1, 3) for name in model.bodies[body]])
    return points.min(axis=0), points.max(axis=0)


def _listed(values: Sequence[float]) -> str:
    """Write a vector as in a case file."""
    return f"[{', '.join(f'{value:.6g}' for value in values)}]"


def _columns(samples: BodySamples, body: Sequence[str]) -> dict[str, list[Any]]:
    """Position, body and all scalar fields."""
    position = {axis: column.tolist() for axis, column in zip("xyz", samples.points.T, strict=True)}
    fields = {name: quantity.values(samples).tolist() for name, quantity in QUANTITIES.items()}
    return {**position, "body": list(body), **fields}


def _write_columns(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write columns of equal length as CSV."""
    names = list(columns)
    rows = (dict(zip(names, row, strict=True)) for row in zip(*columns.values(), strict=True))
    write_rows(path, names, rows)
