"""The spline space on a model: numbering of control points, Gauss points."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array, Indices, find_spans
from geom2iga.errors import GeometryError
from geom2iga.model import Model
from geom2iga.patch import CHUNK, Face, Patch, basis, chunks, evaluate, face_indices


@dataclass(frozen=True, eq=False)
class Space:
    """Displacement space on the basis of the geometry; degree of freedom 3 n + i is component i of control point n.

    Parameters
    ----------
    model : Model
    numbers : patch name to (n,)
        Global number of each control point, in the flat numbering of its patch.
    size : int
        Number of control points.
    """

    model: Model
    numbers: Mapping[str, Indices]
    size: int

    @property
    def dofs(self) -> int:
        """Number of degrees of freedom."""
        return 3 * self.size

    @property
    def control_points(self) -> Array:
        """Positions of all control points (n, 3) [length]."""
        points = np.empty((self.size, 3))
        for name, patch in self.model.patches.items():
            points[self.numbers[name]] = patch.control_points.reshape(-1, 3)
        return points

    def face_numbers(self, face: Face) -> Indices:
        """Global control-point numbers of a face, flat in the numbering of its surface."""
        return self.numbers[face.patch][face_indices(self.model.patches[face.patch], face).ravel()]

    def body_numbers(self, body: str) -> Indices:
        """Global control-point numbers of a body."""
        return np.unique(np.concatenate([self.numbers[patch] for patch in self.model.bodies[body]]))


def number_control_points(model: Model) -> Space:
    """Number the control points of all patches, one patch after the other."""
    numbers, size = {}, 0
    for name, patch in model.patches.items():
        count = prod(patch.shape)
        numbers[name] = np.arange(size, size + count)
        size += count
    return Space(model, MappingProxyType(numbers), size)


def check_right_handed(model: Model) -> None:
    """Raise GeometryError where the directions of a patch form a left-handed system: its normals would point inward."""
    for name, patch in model.patches.items():
        middle = np.array([[at.mean() for at in patch.breaks]])
        if np.linalg.det(evaluate(patch, middle, 1)[1][0]) <= 0:
            raise GeometryError(f'patch "{name}" is left-handed: reverse one direction (geom2iga.reversed_along)')


class Points(NamedTuple):
    """Gauss points of a patch, span by span (the last direction runs fastest)."""

    xi: Array  # (q, d)
    weights: Array  # (q,) parametric
    spans: Indices  # (q, d) knot index of the span
    per_span: int


def gauss_points(patch: Patch, counts: Sequence[int] | None = None) -> Points:
    """Place Gauss-Legendre points in every span, degree + 1 per direction unless counts are given."""
    counts = [p + 1 for p in patch.degrees] if counts is None else counts
    axes = []
    for knots, at, degree, count in zip(patch.knots, patch.breaks, patch.degrees, counts, strict=True):
        nodes, shares = np.polynomial.legendre.leggauss(count)
        half = np.diff(at)[:, None] / 2
        first = np.broadcast_to(find_spans(knots, degree, at[:-1])[:, None], (len(at) - 1, count))
        axes.append((at[:-1, None] + half * (1 + nodes), half * shares, first))
    shapes = [axis[0].shape for axis in axes]
    xi, weights, spans = (
        np.stack([_spread(a[kind], d, shapes) for d, a in enumerate(axes)], axis=1) for kind in range(3)
    )
    return Points(xi, weights.prod(axis=1), spans, prod(counts))


def _spread(values: Any, d: int, shapes: Sequence[tuple[int, ...]]) -> Any:
    """Spread (spans, points) of one direction over all spans and points of the patch, flat."""
    shape = [1] * (2 * len(shapes))
    shape[d], shape[len(shapes) + d] = values.shape
    full = [s for s, _ in shapes] + [n for _, n in shapes]
    return np.broadcast_to(values.reshape(shape), full).ravel()


class Quadrature(NamedTuple):
    """Basis functions of a volume at its Gauss points, for a run of whole spans."""

    indices: Indices  # (e, a) flat control-point numbers of the patch
    values: Array  # (e, q, a)
    gradients: Array  # (e, q, a, 3) with respect to position [1/length]
    volume: Array  # (e, q) [length^3]


def volume_quadrature(patch: Patch) -> Iterator[Quadrature]:
    """Yield the quadrature tables of a volume, as many spans at a time as fit a bounded memory.

    Raises
    ------
    GeometryError
        The Jacobian is not positive at a Gauss point.
    """
    points = gauss_points(patch)
    per_span, width = points.per_span, prod(p + 1 for p in patch.degrees)
    run = per_span * max(1, CHUNK // (9 * width * max(per_span, width)))
    for part in chunks(len(points.xi), run):
        functions = basis(patch, points.xi[part], 1, points.spans[part])
        local = patch.control_points.reshape(-1, 3)[functions.indices]
        jacobian = np.einsum("qak,qad->qkd", local, functions.gradients, optimize=True)
        determinant = np.linalg.det(jacobian)
        if determinant.min() <= 0:
            worst = np.argmin(determinant)
            at = ", ".join(f"{x:.3g}" for x in points.xi[part][worst])
            raise GeometryError(
                f'patch "{patch.name}": Jacobian {determinant[worst]:.3g} at xi = ({at}): the patch is folded there'
            )
        gradients = functions.gradients @ np.linalg.inv(jacobian)
        yield Quadrature(
            functions.indices[::per_span],
            functions.values.reshape(-1, per_span, width),
            gradients.reshape(-1, per_span, width, 3),
            (determinant * points.weights[part]).reshape(-1, per_span),
        )
