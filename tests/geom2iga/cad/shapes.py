"""Shapes that several CAD models are made of, built with gmsh's OpenCASCADE, and integrals for their volumes."""

from collections.abc import Callable, Sequence
from math import cos, hypot, pi, sin, sqrt, tan
from typing import Any

import numpy as np

from geom2iga.bspline import Array

Occ = Any  # gmsh.model.occ
Points = Sequence[Sequence[float]] | Array

HEX_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])


def level(corners: Points, height: float) -> Array:
    """Corners (n, 2) in a plane of constant z, as points (n, 3)."""
    corners = np.asarray(corners, dtype=float)
    return np.column_stack([corners, np.full(len(corners), height)])


def on_circle(radius: float, degrees: float, height: float = 0.0) -> tuple[float, float, float]:
    """A point of a circle about z."""
    return radius * cos(degrees * pi / 180), radius * sin(degrees * pi / 180), height


def polyhedron(occ: Occ, corners: Points, faces: Sequence[Sequence[int]] = HEX_FACES) -> int:
    """A volume with straight edges; plane faces, or ruled ones where four corners lie in no plane."""
    corners = np.asarray(corners, dtype=float)
    tags = [occ.addPoint(*corner) for corner in corners]
    lines: dict[frozenset[int], int] = {}
    surfaces = []
    for face in faces:
        sides = [frozenset(side) for side in zip(face, (*face[1:], face[0]), strict=True)]
        for side in sides:
            if side not in lines:
                lines[side] = occ.addLine(*(tags[k] for k in side))
        loop = [lines[side] for side in sides]
        surfaces.append(surface_within(occ, loop, plane=is_flat(corners[list(face)])))
    return solid(occ, surfaces)


def is_flat(corners: Array) -> bool:
    """Whether points lie in one plane."""
    return bool(np.linalg.svd(corners - corners.mean(axis=0))[1][2] < 1e-12 * np.ptp(corners))


def surface_within(occ: Occ, curves: Sequence[int], plane: bool) -> int:
    """A plane surface, or the Coons surface ("stretched") of a closed loop of curves."""
    if plane:
        return occ.addPlaneSurface([occ.addCurveLoop(curves)])
    return occ.addBSplineFilling(occ.addWire(curves), type="Stretch")


def solid(occ: Occ, surfaces: Sequence[int]) -> int:
    """The volume within surfaces that share their edges."""
    return occ.addVolume([occ.addSurfaceLoop(surfaces)])


def outline(occ: Occ, corners: Points, arcs: dict[int, tuple[float, float, float]] | None = None) -> list[int]:
    """The closed polygon through points (n, 3); sides k in `arcs` are circles about the centre given."""
    tags = [occ.addPoint(*corner) for corner in np.asarray(corners, dtype=float)]
    curves = []
    for k, start in enumerate(tags):
        end = tags[(k + 1) % len(tags)]
        if arcs and k in arcs:
            curves.append(occ.addCircleArc(start, occ.addPoint(*arcs[k]), end))
        else:
            curves.append(occ.addLine(start, end))
    return curves


def plate(occ: Occ, corners: Points, arcs: dict[int, tuple[float, float, float]] | None = None) -> int:
    """The plane surface within a polygon, some sides of which may be circular arcs."""
    return occ.addPlaneSurface([occ.addCurveLoop(outline(occ, corners, arcs))])


def fused(occ: Occ, dimension: int, tags: Sequence[int]) -> list[int]:
    """Let neighbours share what they have in common."""
    found, _ = occ.fragment([(dimension, tags[0])], [(dimension, tag) for tag in tags[1:]])
    return [tag for dim, tag in found if dim == dimension]


def lifted(occ: Occ, surfaces: Sequence[int], height: float) -> list[int]:
    """Extrude surfaces along z; those that share an edge make volumes that share a face."""
    made = occ.extrude([(2, tag) for tag in surfaces], 0, 0, height)
    return [tag for dim, tag in made if dim == 3]


def turned_about_z(occ: Occ, surface: int, degrees: float) -> int:
    """Revolve a surface about z."""
    made = occ.revolve([(2, surface)], 0, 0, 0, 0, 0, 1, degrees * pi / 180)
    return next(tag for dim, tag in made if dim == 3)


def loft(occ: Occ, *sections: Points, ruled: bool = True) -> int:
    """A solid through polygons (n, 3)."""
    wires = [occ.addWire(outline(occ, section)) for section in sections]
    return occ.addThruSections(wires, makeSolid=True, makeRuled=ruled)[0][1]


def rectangle(occ: Occ, x: Sequence[float], z: Sequence[float]) -> int:
    """A rectangle in the plane y = 0."""
    return plate(occ, [(x[0], 0, z[0]), (x[1], 0, z[0]), (x[1], 0, z[1]), (x[0], 0, z[1])])


def pipe_quarter(occ: Occ, height: float, start: float = 0.0) -> int:
    """A quarter of a pipe of radii 1 and 2 about z."""
    quarter = turned_about_z(occ, rectangle(occ, (1, 2), (0, height)), 90)
    occ.rotate([(3, quarter)], 0, 0, 0, 0, 0, 1, start * pi / 180)
    return quarter


def cut_above(occ: Occ, volume: int, height: float = 3.0) -> int:
    """Cut a volume by the plane through (0, 0, height) that falls by tan(0.4) along (2, -1, 0)."""
    tool = occ.addBox(-20, -20, 0, 40, 40, 20)
    occ.rotate([(3, tool)], 0, 0, 0, 1, 2, 0, 0.4)
    occ.translate([(3, tool)], 0, 0, height)
    return occ.cut([(3, volume)], [(3, tool)])[0][0][1]


def cut_height(x: Any, y: Any, height: float = 3.0) -> Any:
    """The z of that plane."""
    return height - tan(0.4) * (2 * x - y) / sqrt(5)


def ogrid_plates(occ: Occ, radius: float = 1.0, half: float = 0.5, height: float = 0.0) -> list[int]:
    """A disc in 5: a square and 4 sectors."""
    inner = level(half * SQUARE, height)
    outer = level(radius / hypot(1, 1) * SQUARE, height)
    plates = [plate(occ, inner)]
    for k in range(4):
        ends = (k + 1) % 4
        plates.append(plate(occ, [inner[k], outer[k], outer[ends], inner[ends]], {1: (0, 0, height)}))
    return fused(occ, 2, plates)


def cap_block(occ: Occ, quad: Points, radius: float) -> int:
    """The block between a plane quadrilateral and the sphere about the origin, its sides on rays from there."""
    quad = np.asarray(quad, dtype=float)
    middle = quad.mean(axis=0)
    reach = 1.5 * radius / np.linalg.norm(middle)
    cone = polyhedron(occ, np.concatenate([quad, reach * quad]))
    ball = occ.addSphere(0, 0, 0, radius)  # its seam lies in the half plane y = 0 < x, its poles on z
    axis = np.cross([-1.0, 0, 0], middle)  # turned so that -x comes to lie along the middle of the block
    angle = np.arctan2(np.linalg.norm(axis), -middle[0])
    if np.linalg.norm(axis) < 1e-9 * radius:
        axis = np.array([0.0, 0, 1])
    occ.rotate([(3, ball)], 0, 0, 0, *axis, angle)
    found, _ = occ.intersect([(3, cone)], [(3, ball)])
    return found[0][1]


def integral(height: Callable[..., Any], x: tuple[float, float], y: tuple[float, float], count: int = 40) -> float:
    """Integrate over a rectangle by Gauss's rule: to rounding errors for what is smooth there."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    at = [(high - low) / 2 * nodes + (high + low) / 2 for low, high in (x, y)]
    scale = (x[1] - x[0]) * (y[1] - y[0]) / 4
    values = np.broadcast_to(height(at[0][:, None], at[1][None, :]), (count, count))
    return float(scale * weights @ values @ weights)


def sector_integral(height: Callable[..., Any], radii: tuple[float, float], degrees: tuple[float, float]) -> float:
    """Integrate over a sector of an annulus about z."""
    angles = (degrees[0] * pi / 180, degrees[1] * pi / 180)
    return integral(lambda r, t: r * height(r * np.cos(t), r * np.sin(t)), radii, angles)


def hexahedron_volume(corners: Points) -> float:
    """Volume of a hexahedron whose faces are ruled, its corners as those of `polyhedron`."""
    c = np.asarray(corners, dtype=float)[[0, 4, 3, 7, 1, 5, 2, 6]].reshape(2, 2, 2, 3)
    nodes, weights = (0.5 + np.array([-1, 1]) / 12**0.5), np.array([0.5, 0.5])
    values, slopes = np.stack([1 - nodes, nodes]), np.array([[-1.0, -1], [1, 1]])
    each = [np.einsum("ijkc,iq,jr,ks->qrsc", c, *[slopes if d == a else values for a in range(3)]) for d in range(3)]
    return abs(float(np.einsum("qrs,q,r,s->", np.linalg.det(np.stack(each, axis=-1)), *[weights] * 3)))
