"""The spline space on a model: numbering of control points, Gauss points."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from geom2iga.bspline import Array, Indices, breaks, find_spans
from geom2iga.errors import GeometryError
from geom2iga.model import Model, oriented
from geom2iga.patch import Face, Patch, basis, evaluate, face_indices

log = logging.getLogger("geom2iga")

BALANCED = 1e-12  # largest error of the forces of a uniform stress, in units of the forces on a span
MORE_POINTS = 12  # Gauss points beyond degree + 1 per direction, at most
UNBALANCED = 1e-9  # error of the same with the most points that is worth a word
SAMPLED = 3  # spans per direction whose integrands are looked at; lines across each other direction


@dataclass(frozen=True, eq=False)
class Space:
    """Displacement space on the basis of the geometry; degree of freedom 3 n + i is component i of control point n.

    Parameters
    ----------
    model : Model
    numbers : patch name to (n,)
        Global number of each control point, in the flat numbering of its patch; glued control points share one.
    size : int
        Number of control points, each counted once.
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

    @cached_property
    def point_counts(self) -> Mapping[str, tuple[int, ...]]:
        """Gauss points per span of each patch, as `point_counts` chooses them."""
        return MappingProxyType({name: point_counts(patch) for name, patch in self.model.patches.items()})

    def spread(self, patch: str) -> csr_array:
        """Matrix (size, n) that adds up what control points of a patch have, where one may stand twice."""
        numbers = self.numbers[patch]
        return csr_array((np.ones(len(numbers)), (numbers, np.arange(len(numbers)))), shape=(self.size, len(numbers)))

    def face_grid(self, face: Face) -> Indices:
        """Global control-point numbers of a face, (n_1, n_2) in the sequence of `Face.axes`."""
        return self.numbers[face.patch][face_indices(self.model.patches[face.patch], face)]

    def face_numbers(self, face: Face) -> Indices:
        """Global control-point numbers of a face, flat in the numbering of its surface."""
        return self.face_grid(face).ravel()

    def group_numbers(self, group: str) -> Indices:
        """Global control-point numbers of all faces of a group, each once."""
        return np.unique(np.concatenate([self.face_numbers(face) for face in self.model.faces(group)]))

    def body_numbers(self, body: str) -> Indices:
        """Global control-point numbers of a body, each once."""
        return np.unique(np.concatenate([self.numbers[patch] for patch in self.model.bodies[body]]))


def number_control_points(model: Model) -> Space:
    """Number the control points of all patches, one patch after the other; what glued faces share counts once."""
    counts = [prod(patch.shape) for patch in model.patches.values()]
    ends = dict(zip(model.patches, np.cumsum(counts).tolist(), strict=True))
    alone = {name: np.arange(end - count, end) for (name, end), count in zip(ends.items(), counts, strict=True)}
    apart = Space(model, alone, sum(counts))
    pairs = [np.empty((2, 0), dtype=np.int64)]
    for glued in model.glued:
        first, second = (apart.face_grid(face) for face in (glued.first, glued.second))
        pairs.append(np.stack([first.ravel(), oriented(second, glued.orientation).ravel()]))
    numbers, size = united(np.concatenate(pairs, axis=1), apart.size)
    return Space(model, MappingProxyType({name: numbers[own] for name, own in alone.items()}), size)


def united(pairs: Indices, size: int) -> tuple[Indices, int]:
    """Number 0 ... size - 1 anew in the same sequence, the same number for all that pairs (2, k) link; and how many."""
    links = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(size, size))
    count, cluster = connected_components(links, directed=False)
    smallest = np.full(count, size)
    np.minimum.at(smallest, cluster, np.arange(size))
    return np.unique(smallest[cluster], return_inverse=True)[1], count


def check_right_handed(model: Model) -> None:
    """Raise GeometryError where the directions of a patch form a left-handed system: its normals would point inward."""
    for name, patch in model.patches.items():
        if np.linalg.det(middle_jacobian(patch)) <= 0:
            raise GeometryError(f'patch "{name}" is left-handed: reverse one direction (geom2iga.reversed_along)')


def is_straight(patch: Patch) -> bool:
    """Whether the map is affine and the basis functions are polynomials on each span."""
    return patch.is_affine and not patch.is_rational


def middle_jacobian(patch: Patch) -> Array:
    """Jacobian (3, 3) of a volume in the middle of its parameters; of an affine map, everywhere."""
    return evaluate(patch, np.array([[at.mean() for at in patch.breaks]]), 1)[1][0]


def point_counts(patch: Patch) -> tuple[int, ...]:
    """Choose how many Gauss points a span of a volume needs in each direction.

    A uniform stress is in equilibrium with its tractions only where the quadrature makes no error in the forces
    sigma ∫ grad R_a dV of either: the patch test is a condition on the rule (Strang & Fix 1973, ch. 4). In terms of
    the parameters their integrand is dR_a/dxi cof(J). Where the map is affine, degree + 1 points integrate it exactly;
    where it is polynomial, its degree 3p - 1 may ask for more from p = 3 on; where it is rational, none are exact, but
    the error falls geometrically with their number (Hughes, Reali & Sangalli 2010 call for no more than the accuracy
    of the functions, which is less than equilibrium asks for).

    n points are exact up to degree 2n - 1, and the largest coefficient of the integrand's Legendre expansion beyond
    that degree is about their error: n is the smallest number from degree + 1 to degree + 13 for which it is below
    1e-12 of the integrand. Lines through the first, middle and last spans are looked at, so that the cost does not
    grow with the mesh.

    Returns
    -------
    (3,)
        Points per span and direction; a face takes those of its own two directions.
    """
    exact = all(3 * degree - 1 <= 2 * degree + 1 for degree in patch.degrees) and np.ptp(patch.weights) == 0
    if exact or patch.is_affine:
        return tuple(degree + 1 for degree in patch.degrees)
    counts, errors = zip(*(_count_along(patch, d) for d in range(patch.directions)), strict=True)
    if max(errors) > UNBALANCED:
        log.warning(
            'warning: patch "%s": the forces of a uniform stress are integrated to %.0e of themselves only, its '
            "weights differ by a factor of %.2g: cut it into more spans, or bring the weights closer together",
            *(patch.name, max(errors), patch.weights.max() / patch.weights.min()),
        )
    return counts


def _count_along(patch: Patch, direction: int) -> tuple[int, float]:
    """Gauss points per span that one direction needs, and the error of the forces that stays."""
    least = patch.degrees[direction] + 1
    counts = np.arange(least, least + MORE_POINTS + 1)
    nodes, weights = np.polynomial.legendre.leggauss(2 * counts[-1] + 2)
    powers = np.arange(len(nodes))
    legendre = np.polynomial.legendre.legvander(nodes, powers[-1])
    forces = _stress_forces(patch, direction, nodes)
    forces /= np.maximum(np.abs(forces).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    coefficients = np.abs(((powers + 0.5) * weights[:, None] * legendre).T @ forces).max(axis=(0, 2))
    beyond = np.maximum.accumulate(coefficients[::-1])[::-1][2 * counts]
    chosen = np.argmax(np.append(beyond[:-1] <= BALANCED, True))
    return int(counts[chosen]), float(beyond[chosen])


def _stress_forces(patch: Patch, direction: int, nodes: Array) -> Array:
    """Integrands det J grad R_a (spans, nodes, others) at nodes in -1 ... 1 along a direction, on sampled lines."""
    xi, first, shape = _sampled_lines(patch, direction, nodes)
    functions = basis(patch, xi, 1, first)
    local = patch.control_points.reshape(-1, 3)[functions.indices]
    local = local - local[:, :1]  # so that a place far from the origin costs no digits
    tangents = np.moveaxis(np.einsum("qak,qad->qkd", local, functions.gradients, optimize=True), 2, 0)
    cofactors = np.stack([np.cross(tangents[d - 2], tangents[d - 1]) for d in range(3)], axis=1)
    forces = np.moveaxis((functions.gradients @ cofactors).reshape(*shape, -1), 1 + direction, 1)
    return forces.reshape(shape[0], len(nodes), -1)


def _sampled_lines(patch: Patch, direction: int, nodes: Array) -> tuple[Array, Indices, tuple[int, ...]]:
    """Parametric points (q, 3), their spans (q, 3), and how many there are: spans, then points per direction."""
    axes = []
    for d, (knots, degree, at) in enumerate(zip(patch.knots, patch.degrees, patch.breaks, strict=True)):
        if d == direction:
            xi, _, first = _placed(knots, degree, nodes, np.unique(np.linspace(0, len(at) - 2, SAMPLED).astype(int)))
        else:
            xi = np.linspace(at[0], at[-1], SAMPLED)[None]
            first = find_spans(knots, degree, xi)
        axes.append((xi, first))
    shapes = [xi.shape for xi, _ in axes]
    xi, first = (np.stack([_spread(axis[k], d, shapes) for d, axis in enumerate(axes)], axis=1) for k in range(2))
    return xi, first, (shapes[direction][0], *(count for _, count in shapes))


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
        xi, half, first = _placed(knots, degree, nodes, np.arange(len(at) - 1))
        axes.append((xi, half * shares, first))
    shapes = [axis[0].shape for axis in axes]
    xi, weights, spans = (
        np.stack([_spread(a[kind], d, shapes) for d, a in enumerate(axes)], axis=1) for kind in range(3)
    )
    return Points(xi, weights.prod(axis=1), spans, prod(counts))


def _placed(knots: Array, degree: int, nodes: Array, chosen: Indices) -> tuple[Array, Array, Indices]:
    """Nodes in -1 ... 1 in chosen spans: places (s, n), half the spans' lengths (s, 1), knot indices (s, n)."""
    at = breaks(knots)
    half = np.diff(at)[chosen, None] / 2
    first = np.broadcast_to(find_spans(knots, degree, at[chosen])[:, None], (len(chosen), len(nodes)))
    return at[chosen, None] + half * (1 + nodes), half, first


def _spread(values: Any, d: int, shapes: Sequence[tuple[int, ...]]) -> Any:
    """Spread (spans, points) of one direction over all spans and points of the patch, flat."""
    shape = [1] * (2 * len(shapes))
    shape[d], shape[len(shapes) + d] = values.shape
    full = [s for s, _ in shapes] + [n for _, n in shapes]
    return np.broadcast_to(values.reshape(shape), full).ravel()
