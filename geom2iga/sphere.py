"""Four-sided patches that lie exactly on a sphere.

A point of the unit sphere is the direction of two complex numbers s = (s_1, s_2), a spinor: with the Pauli matrices,
s s† = (w I + x X + y Y + z Z) / 2 holds its homogeneous coordinates. A polynomial s(u, v) of degree n thus gives a
rational surface of degree 2 n on the sphere (generalised stereographic projection, Dietz, Hoschek & Jüttler 1993);
turning the sphere only multiplies s by a matrix. A circular arc with weights 1, cos(half its angle), 1 is linear in s.

Four arcs need not close: along them s comes back with another phase, by half of what the four angles of the
quadrilateral sum to beyond 360 degrees, and this at any degree. The closing angle is made up on the edges: those with
a `turn` have their homogeneous coordinates multiplied by the quadratic of coefficients 1, cos(turn), 1; each stays the
same curve at the same parameters, its degree becomes 4. Two faces that share an edge must use the same turn.
"""

from collections.abc import Collection, Hashable, Sequence
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geom2iga.bspline import Array, open_knots
from geom2iga.errors import GeometryError
from geom2iga.patch import Patch

Spinors = NDArray[np.complex128]

ON_SPHERE = 1e-9  # how far an edge may lie off the sphere, in radii
CLOSED = 1e-9  # how well turns must make up a closing angle [radians]

PAULI = np.array([[[0, 1], [1, 0]], [[0, -1j], [1j, 0]], [[1, 0], [0, -1]]])


def spherical_patch(
    edges: Sequence[Patch], centre: ArrayLike, radius: float, turns: ArrayLike | None = None, name: str = "sphere"
) -> Patch:
    """Span a patch on a sphere between four circular arcs.

    Parameters
    ----------
    edges : four curves
        Rational quadratic arcs with the weights 1, cos(half the angle), 1: v = 0 and v = 1 running along u, then u = 0
        and u = 1 running along v.
    centre : (3,)
        [length]
    turns : (4,)
        Of the edges [radians], summing to the `closing_angle`; left out, a quarter of it each.

    Returns
    -------
    Patch
        Degree (4, 4), weights 1 at the corners; its edges are `turned_arc(edge, turn)` up to rounding.

    Raises
    ------
    GeometryError
        Edges that are no such arcs, do not lie on the sphere or do not meet; a quadrilateral too large for one patch.
    ValueError
        Turns that do not sum to the closing angle.
    """
    middle = np.asarray(centre, dtype=float)
    corners, phases = _corners(edges, middle, radius)
    angle = _closing(phases)
    turns = np.full(4, abs(angle) / 4) if turns is None else np.asarray(turns, dtype=float)
    if abs(turns.sum() - abs(angle)) > CLOSED:
        raise ValueError(f"the turns of the edges sum to {turns.sum():g}, the closing angle is {abs(angle):g}")
    shifts = np.sign(angle) * turns * (-1, 1, 1, -1)  # of the phase along each edge
    phases = phases + shifts
    along = np.exp(1j * np.array([[0, phases[2]], [phases[0], phases[0] + phases[3]]]))
    spinors = corners * along[..., None]
    ends = (spinors[:, 0], spinors[:, 1], spinors[0], spinors[1])
    quadratics = [_turned(two, shift) for two, shift in zip(ends, shifts, strict=True)]
    homogeneous = _on_sphere(_blended(quadratics))
    if homogeneous[..., 3].min() <= 0:
        raise GeometryError("a quadrilateral on a sphere is too large for one patch: split it")
    points, weights = middle + radius * homogeneous[..., :3] / homogeneous[..., 3:], homogeneous[..., 3]
    patch = Patch(name, (4, 4), (open_knots([0, 1], 4),) * 2, points, weights)
    _check_edges(patch, edges, turns, radius)
    return patch


def closing_angle(edges: Sequence[Patch], centre: ArrayLike, radius: float) -> float:
    """Tell by how much the phases miss along four arcs, [0, pi] radians; the turns of the edges must sum to it.

    It is |sum of the four angles of the quadrilateral - 2 pi| / 2; between great circles, half the solid angle.
    """
    return abs(_closing(_corners(edges, np.asarray(centre, dtype=float), radius)[1]))


def turned_arc(edge: Patch, turn: float) -> Patch:
    """Multiply a rational quadratic curve by the quadratic 1, cos(turn), 1: degree 4, the same points."""
    homogeneous = _product(edge.homogeneous, np.array([1, np.cos(turn), 1]))
    weights = homogeneous[..., 3]
    return Patch(edge.name, (4,), (open_knots([0, 1], 4),), homogeneous[..., :3] / weights[:, None], weights)


def find_turns(
    faces: Sequence[Sequence[Hashable]], angles: Sequence[float], fixed: Collection[Hashable] = ()
) -> dict[Hashable, float]:
    """Find the smallest turns of shared edges that close all spherical faces of a model.

    Parameters
    ----------
    faces : four edges each
        Any keys, such as tags; two faces with the same key share that edge.
    angles : one per face
        Their closing angles [radians].
    fixed : edges
        That must not turn, because a face beside them cannot follow.

    Raises
    ------
    GeometryError
        The angles cannot be made up.
    """
    keys = list(dict.fromkeys(edge for face in faces for edge in face))
    matrix = np.array([[float(key in face and key not in fixed) for key in keys] for face in faces])
    turns = np.linalg.lstsq(matrix, np.asarray(angles, dtype=float), rcond=None)[0]
    if np.abs(matrix @ turns - angles).max() > CLOSED:
        raise GeometryError("the spherical faces do not close all at once: split one of them")
    return dict(zip(keys, turns.tolist(), strict=True))


def _corners(edges: Sequence[Patch], centre: Array, radius: float) -> tuple[Spinors, Array]:
    """Unit spinors (2, 2, 2) of the corners and by how much phase (4,) the second end of each edge must be ahead."""
    for edge in edges:
        if edge.degrees != (2,) or edge.shape != (3,):
            raise GeometryError(f'edge "{edge.name}" of a face on a sphere is no rational quadratic arc: split it')
    spinors = [[_spinor((edge.control_points[end] - centre) / radius) for end in (0, -1)] for edge in edges[:2]]
    corners = np.array(spinors).swapaxes(0, 1)
    ends = (corners[:, 0], corners[:, 1], corners[0], corners[1])
    middles = [edge.weights[1] * (edge.control_points[1] - centre) / radius for edge in edges]
    return corners, np.array([_phase(two, middle) for two, middle in zip(ends, middles, strict=True)])


def _spinor(point: Array) -> Spinors:
    """Find a unit spinor (2,) of a point (3,) of the unit sphere: the larger column of its projector."""
    projector = (np.eye(2) + np.tensordot(point, PAULI, 1)) / 2
    column = projector[:, np.argmax(np.diagonal(projector).real)]
    return np.asarray(column / np.linalg.norm(column), dtype=np.complex128)


def _phase(ends: Spinors, middle: Array) -> float:
    """Phase that the second spinor needs so that the arc is the one with this weighted middle control point (3,)."""
    start, end = ends
    across = np.array([-start[1], start[0]])  # times the conjugate of a spinor: 0 for the start itself
    return float(np.angle((across @ np.tensordot(middle, PAULI, 1) @ start) / (across @ end)))


def _closing(phases: Array) -> float:
    """Phase by which the way over u = 1 is ahead of that over u = 0, in (-pi, pi]."""
    return float(np.angle(np.exp(1j * (phases[0] + phases[3] - phases[1] - phases[2]))))


def _turned(ends: Spinors, shift: float) -> Spinors:
    """Quadratic (3, 2) between two spinors: their linear form times the linear form from 1 to exp(i shift)."""
    start, end = ends
    return np.array([start, (np.exp(1j * shift) * start + np.exp(-1j * shift) * end) / 2, end])


def _blended(edges: Sequence[Spinors]) -> Spinors:
    """Blend four quadratic edges (3, 2) after Coons, (3, 3, 2)."""
    low, high, first, last = edges
    u, v = np.ix_([0, 0.5, 1], [0, 0.5, 1], [1])[:2]
    along_u = (1 - v) * low[:, None] + v * high[:, None]
    along_v = (1 - u) * first[None] + u * last[None]
    corners = (1 - u) * ((1 - v) * low[0] + v * high[0]) + u * ((1 - v) * low[-1] + v * high[-1])
    return along_u + along_v - corners


def _on_sphere(spinors: Spinors) -> Array:
    """Homogeneous coordinates (5, 5, 4) of a biquadratic (3, 3, 2) spinor."""
    table = _product_table(2, 2)
    product = np.einsum("ack,bdl,abi,cdj->klij", table, table, spinors, spinors.conj(), optimize=True)
    return np.einsum("klij,nji->kln", product, [*PAULI, np.eye(2)]).real


def _product(first: NDArray, second: Array) -> NDArray:
    """Bernstein coefficients (n + m - 1, ...) of the product of a curve (n, ...) with a polynomial (m,)."""
    return np.einsum("ijk,i...,j->k...", _product_table(len(first) - 1, len(second) - 1), first, second)


def _product_table(degree: int, other: int) -> Array:
    """Share (degree + 1, other + 1, degree + other + 1) of two Bernstein functions' product in a third."""
    table = np.zeros((degree + 1, other + 1, degree + other + 1))
    for i, j in np.ndindex(table.shape[:2]):
        table[i, j, i + j] = comb(degree, i) * comb(other, j) / comb(degree + other, i + j)
    return table


def _check_edges(patch: Patch, edges: Sequence[Patch], turns: Array, radius: float) -> None:
    """Raise GeometryError unless the patch has the given edges."""
    found = patch.homogeneous
    for row, edge, turn in zip((found[:, 0], found[:, -1], found[0], found[-1]), edges, turns, strict=True):
        apart = np.abs(row - turned_arc(edge, turn).homogeneous)
        if apart[:, :3].max() > ON_SPHERE * radius or apart[:, 3].max() > ON_SPHERE:
            raise GeometryError(
                f'edge "{edge.name}" is no circular arc on the sphere of radius {radius:g} that meets its neighbours, '
                f"off by {apart.max():g}"
            )
