"""NURBS patches of one, two or three directions: evaluate, differentiate, elevate, refine, reverse."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from geom2iga import bspline
from geom2iga.bspline import Array, Indices
from geom2iga.display import boxed, html_table

CHUNK = 4_000_000  # numbers in the largest temporary array of an evaluation
FLAT = 1e-9  # how far from plane, straight or affine, in sizes of the patch
EQUAL = 1e-14  # weights that differ less, relative, are the same
ROUNDED = 8 * float(np.finfo(float).eps)  # what places may be off by, in units of the farthest coordinate


@dataclass(frozen=True, eq=False)
class Patch:
    """A tensor-product NURBS map x(xi) = sum_a R_a(xi) P_a.                     paper, eqs. (4)-(6)

    Parameters
    ----------
    name : str
    degrees : (d,)
        One to three directions: curve, surface, volume.
    knots : d arrays
        Open knot vectors.
    control_points : (n_1, ..., n_d, 3)
        Position [length]; the last direction runs fastest in flat numbering.
    weights : (n_1, ..., n_d)
        Positive; left out, all one.

    Raises
    ------
    ValueError
        Knots that are not open or decrease, shapes that do not fit, values that are not finite, weights <= 0.

    Examples
    --------
    >>> quarter = Patch("circle", (2,), ([0, 0, 0, 1, 1, 1],), [[1, 0, 0], [1, 1, 0], [0, 1, 0]], [1, 0.5**0.5, 1])
    >>> radius = np.linalg.norm(evaluate(quarter, np.linspace(0, 1, 9)[:, None])[0], axis=1)
    >>> bool(abs(radius - 1).max() < 1e-15)
    True
    """

    name: str
    degrees: tuple[int, ...]
    knots: tuple[Array, ...]
    control_points: Array
    weights: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        degrees = tuple(int(p) for p in self.degrees)
        if degrees != tuple(self.degrees):
            raise ValueError(f'patch "{self.name}": degrees must be whole numbers, found {self.degrees}')
        knots = tuple(_frozen(k) for k in self.knots)
        points = _frozen(self.control_points)
        weights = _frozen(np.ones(points.shape[:-1]) if self.weights is None else self.weights)
        for name, value in zip(
            ("degrees", "knots", "control_points", "weights"), (degrees, knots, points, weights), strict=True
        ):
            object.__setattr__(self, name, value)
        self._check()

    def _check(self) -> None:
        if not 1 <= len(self.degrees) <= 3:
            raise ValueError(f'patch "{self.name}" has {len(self.degrees)} directions, a patch has one to three')
        if len(self.knots) != len(self.degrees):
            raise ValueError(f'patch "{self.name}": {len(self.degrees)} degrees but {len(self.knots)} knot vectors')
        for direction, (knots, degree) in enumerate(zip(self.knots, self.degrees, strict=True)):
            try:
                if degree < 1:
                    raise ValueError(f"degree must be at least 1, found {degree}")
                bspline.check_knots(knots, degree)
            except ValueError as error:
                raise ValueError(f'patch "{self.name}", direction {direction}: {error}') from None
        shape = tuple(len(k) - p - 1 for k, p in zip(self.knots, self.degrees, strict=True))
        if self.control_points.shape != (*shape, 3) or self.weights.shape != shape:
            raise ValueError(
                f'patch "{self.name}": degrees and knots ask for {shape} control points, found control points of '
                f"shape {self.control_points.shape} and weights of shape {self.weights.shape}"
            )
        if not np.all(np.isfinite(self.control_points)):
            raise ValueError(f'patch "{self.name}": control points must be finite')
        if not (np.all(np.isfinite(self.weights)) and np.all(self.weights > 0)):
            raise ValueError(f'patch "{self.name}": weights must be positive, found {self.weights.min():g}')

    @property
    def directions(self) -> int:
        """Number of parametric directions."""
        return len(self.degrees)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of control points in each direction."""
        return self.weights.shape

    @property
    def breaks(self) -> tuple[Array, ...]:
        """Distinct knots of each direction."""
        return tuple(bspline.breaks(k) for k in self.knots)

    @property
    def homogeneous(self) -> Array:
        """Control points (n_1, ..., n_d, 4) as (w x, w y, w z, w)."""
        return np.concatenate([self.control_points * self.weights[..., None], self.weights[..., None]], axis=-1)

    @property
    def is_rational(self) -> bool:
        """Whether weights differ, by more than rounding; if not, they do not matter."""
        return bool(np.ptp(self.weights) > EQUAL * self.weights.max())

    @property
    def is_affine(self) -> bool:
        """Whether position is an affine function of the parameters."""
        return self.is_affine_within(resolution(self.control_points))

    def is_affine_within(self, rounding: float) -> bool:
        """The same, of control points that are off by so much as they are rounded [length]."""
        size = float(np.ptp(self.control_points.reshape(-1, 3), axis=0).max())
        return self._bent <= FLAT * size + rounding

    @cached_property
    def _bent(self) -> float:
        """How far position is from an affine function of the parameters [length]."""
        if np.ptp(self.weights) > FLAT * self.weights.max():
            return np.inf
        points = self.control_points
        corner = points[(0,) * self.directions]
        misfit = points - corner
        for d, (knots, degree) in enumerate(zip(self.knots, self.degrees, strict=True)):
            places = bspline.greville(knots, degree)
            share = (places - places[0]) / (places[-1] - places[0])
            edge = points[tuple(-1 if axis == d else 0 for axis in range(self.directions))] - corner
            others = tuple(axis for axis in range(self.directions) if axis != d)
            misfit = misfit - np.expand_dims(np.multiply.outer(share, edge), others)
        return float(np.abs(misfit).max())

    def __repr__(self) -> str:
        return f"Patch({self.name!r}, {', '.join(self._facts.values())})"

    def _repr_html_(self) -> str:
        return html_table(f"Patch {self.name}", tuple(self._facts), [tuple(self._facts.values())])

    @property
    def _facts(self) -> dict[str, str]:
        """What is said of it."""
        kind = "rational" if self.is_rational else "polynomial"
        return {"mesh": self.mesh, "kind": kind, "control points": boxed(self.control_points)}

    @property
    def mesh(self) -> str:
        """Degrees and spans, in words."""
        same = len(set(self.degrees)) == 1
        degrees = f"degree {self.degrees[0]}" if same else f"degrees {self.degrees}"
        return f"{degrees}, {' x '.join(str(len(at) - 1) for at in self.breaks)} spans"


@dataclass(frozen=True)
class Face:
    """The side of a patch at the lower (side 0) or upper (side 1) end of direction `axis`."""

    patch: str
    axis: int
    side: int

    def __post_init__(self) -> None:
        if self.axis not in range(3) or self.side not in range(2):
            raise ValueError(f'patch "{self.patch}" has no face at side {self.side} of direction {self.axis}')

    @property
    def axes(self) -> tuple[int, ...]:
        """The two directions of the face, in increasing order."""
        return tuple(axis for axis in range(3) if axis != self.axis)

    @property
    def outward(self) -> int:
        """Sign that turns the cross product of the two face tangents outward on a right-handed patch."""
        return (1 if self.side else -1) * (-1 if self.axis == 1 else 1)


class Basis(NamedTuple):
    """Nonzero rational basis functions at q points."""

    indices: Indices  # (q, a) flat control-point numbers of the patch
    values: Array  # (q, a)
    gradients: Array  # (q, a, d), empty for order 0
    hessians: Array  # (q, a, d, d), empty for order below 2


def basis(patch: Patch, xi: Array, order: int = 0, spans: Indices | None = None) -> Basis:
    """Evaluate the rational basis functions that are nonzero at points.         paper, eqs. (4), (5)

    Parameters
    ----------
    xi : (q, d)
        Parametric points.
    order : 0, 1 or 2
        Highest derivative with respect to xi.
    spans : (q, d)
        Whose polynomial to evaluate, as knot index; left out, the span that holds the point.
    """
    count, directions = xi.shape
    each = [
        bspline.basis(knots, degree, xi[:, d], order, None if spans is None else spans[:, d])
        for d, (knots, degree) in enumerate(zip(patch.knots, patch.degrees, strict=True))
    ]
    indices = np.zeros((count, 1), dtype=np.int64)
    for d, degree in enumerate(patch.degrees):
        local = each[d][0][:, None] + np.arange(degree + 1)
        indices = (indices[:, :, None] * patch.shape[d] + local[:, None, :]).reshape(count, -1)
    weights = patch.weights.ravel()[indices]

    def weighted(*derivative: int) -> Array:
        """(q, a) w_a N_a, differentiated once along each of the named directions."""
        values = weights
        factor = np.ones((count, 1))
        for d in range(directions):
            factor = (factor[:, :, None] * each[d][1][derivative.count(d)][:, None, :]).reshape(count, -1)
        return values * factor

    numerator = weighted()
    total = numerator.sum(axis=1, keepdims=True)
    values = numerator / total
    gradients = np.empty((count, values.shape[1], directions if order > 0 else 0))
    hessians = np.empty((*gradients.shape, directions if order > 1 else 0))
    slopes = []
    for i in range(gradients.shape[2]):
        numerator = weighted(i)
        slopes.append(numerator.sum(axis=1, keepdims=True))
        gradients[:, :, i] = (numerator - values * slopes[i]) / total
    for i, j in combinations_with_replacement(range(hessians.shape[3]), 2):
        numerator = weighted(i, j)
        bend = numerator.sum(axis=1, keepdims=True)
        mixed = numerator - slopes[i] * gradients[:, :, j] - slopes[j] * gradients[:, :, i] - bend * values
        hessians[:, :, i, j] = hessians[:, :, j, i] = mixed / total
    return Basis(indices, values, gradients, hessians)


def evaluate(
    patch: Patch, xi: ArrayLike, order: int = 0, field: Array | None = None, spans: Indices | None = None
) -> tuple[Array, ...]:
    """Evaluate the map, or a field on the same basis, and its derivatives.

    Parameters
    ----------
    xi : (q, d)
        Parametric points.
    order : 0, 1 or 2
        Highest derivative.
    field : (n, k)
        Coefficients of a field in flat numbering; left out, the control points (k = 3) [length].

    Returns
    -------
    tuple of order + 1 arrays
        (q, k) values, (q, k, d) first and (q, k, d, d) second derivatives with respect to xi.
    """
    xi = np.asarray(xi, dtype=float)
    coefficients = patch.control_points.reshape(-1, 3) if field is None else field
    kinds = ("values", "gradients", "hessians")[: order + 1]
    tails = [(patch.directions,) * k for k in range(order + 1)]
    results = tuple(np.empty((len(xi), coefficients.shape[1], *tail)) for tail in tails)
    width = prod(p + 1 for p in patch.degrees) * (1 + 3 * order + 9 * (order > 1))
    for part in chunks(len(xi), max(1, CHUNK // width)):
        functions = basis(patch, xi[part], order, None if spans is None else spans[part])
        local = coefficients[functions.indices]
        for result, kind in zip(results, kinds, strict=True):
            result[part] = np.einsum("qa...,qak->qk...", getattr(functions, kind), local, optimize=True)
            if kind == "values":
                local = local - local[:, :1] if order else local  # so that far from the origin slopes keep their digits
    return results


def chunks(count: int, size: int) -> Iterator[slice]:
    """Yield slices that cover range(count), each at most `size` long."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def resolution(points: Array) -> float:
    """How far places (..., 3) may be off as numbers are rounded, which grows with the way to the origin [length]."""
    return ROUNDED * float(np.abs(points).max(initial=0.0))


def surface(patch: Patch, face: Face) -> Patch:
    """Return a face of a volume as a patch of two directions, in the sequence of `Face.axes`."""
    index = (slice(None),) * face.axis + (-face.side,)
    return Patch(
        f"{patch.name} axis {face.axis} side {face.side}",
        tuple(patch.degrees[a] for a in face.axes),
        tuple(patch.knots[a] for a in face.axes),
        patch.control_points[index],
        patch.weights[index],
    )


def face_indices(patch: Patch, face: Face) -> Indices:
    """Flat control-point numbers of a face, (n_1, n_2) in the sequence of `Face.axes`."""
    return np.take(np.arange(prod(patch.shape)).reshape(patch.shape), -face.side, axis=face.axis)


def elevated(patch: Patch, degrees: Sequence[int]) -> Patch:
    """Raise the degrees to the given ones; the map stays the same.

    Raises
    ------
    ValueError
        A degree below the patch's own.
    """
    if any(new < old for new, old in zip(degrees, patch.degrees, strict=True)):
        raise ValueError(f'patch "{patch.name}": degrees {patch.degrees} cannot be lowered to {tuple(degrees)}')
    steps = [
        bspline.elevation(k, old, new - old) for k, old, new in zip(patch.knots, patch.degrees, degrees, strict=True)
    ]
    return _mapped(patch, degrees, steps)


def refined(patch: Patch, spans: int | None = None, knots: Sequence[ArrayLike] | None = None) -> Patch:
    """Insert knots; the map stays the same.

    Parameters
    ----------
    spans : int
        Cut every span into this many equal ones.
    knots : d arrays
        Or the knots to insert in each direction, repeated as often as they are to be inserted.
    """
    if spans is not None and spans < 1:
        raise ValueError(f"every span can be cut into 1 or more, found {spans}")
    inserted = [_between(b, spans or 1) for b in patch.breaks] if knots is None else knots
    steps = [bspline.insertion(k, p, new) for k, p, new in zip(patch.knots, patch.degrees, inserted, strict=True)]
    return _mapped(patch, patch.degrees, steps)


def reversed_along(patch: Patch, axis: int) -> Patch:
    """Run direction `axis` backwards; the same body, seen the other way."""
    knots = list(patch.knots)
    knots[axis] = knots[axis][0] + knots[axis][-1] - knots[axis][::-1]
    return replace(
        patch,
        knots=tuple(knots),
        control_points=np.flip(patch.control_points, axis),
        weights=np.flip(patch.weights, axis),
    )


def _mapped(patch: Patch, degrees: Sequence[int], steps: Sequence[tuple[Array, csr_array]]) -> Patch:
    """Apply one matrix per direction to the homogeneous control points."""
    points = patch.homogeneous
    for axis, (_, matrix) in enumerate(steps):
        points = bspline.applied(matrix, points, axis)
    return Patch(
        patch.name,
        tuple(degrees),
        tuple(k for k, _ in steps),
        points[..., :3] / points[..., 3:],
        points[..., 3],
    )


def _between(at: Array, parts: int) -> Array:
    """Inner points that cut each interval between breaks into equal parts."""
    fractions = np.arange(1, parts) / parts
    return (at[:-1, None] + np.diff(at)[:, None] * fractions).ravel()


def _frozen(values: ArrayLike) -> Array:
    copy = np.array(values, dtype=float)
    copy.flags.writeable = False
    return copy
