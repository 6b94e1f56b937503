"""Faces by where they lie: in a plane, on a sphere, on a cylinder, near a point."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from geom2iga.body_case import Round, Selector
from geom2iga.bspline import Array
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Face
from geom2iga.patch import Patch, evaluate, surface
from geom2iga.projection import closest_points

LIES_ON = 1e-6  # how far a face may lie off what it is said to lie on, in sizes of the model
SAMPLES = np.linspace(0, 1, 7)


@dataclass(frozen=True, eq=False)
class OuterFace:
    """A face that no other patch is glued to.

    Parameters
    ----------
    face : Face
    body : str
    patch : Patch
        Of two directions.
    points, normals : (q, 3)
        Samples, and the outward unit normals there.
    tag : int or None
        Of the CAD face, in gmsh.
    name : str
        What to call it in messages.
    """

    face: Face
    body: str
    patch: Patch
    points: Array
    normals: Array
    tag: int | None
    name: str


def outer_face(patch: Patch, face: Face, body: str, tag: int | None, name: str) -> OuterFace:
    """Sample a face of a patch whose knots run from 0 to 1."""
    plane = surface(patch, face)
    grid = np.stack(np.meshgrid(SAMPLES, SAMPLES, indexing="ij"), axis=-1).reshape(-1, 2)
    points, tangents = evaluate(plane, grid, 1)
    normals = np.cross(tangents[:, :, 0], tangents[:, :, 1]) * face.outward
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return OuterFace(face, body, plane, points, normals / np.where(lengths > 0, lengths, 1), tag, name)


def select(
    faces: Sequence[OuterFace], selector: Selector, groups: Mapping[str, Sequence[int]], where: str
) -> tuple[Face, ...]:
    """Choose the faces that a selector means.

    Parameters
    ----------
    groups : physical group to tags of CAD faces
    where : str
        Key of the selector in the case file, for messages.

    Raises
    ------
    CaseError
        There is no such group, or no face is left.
    """
    if selector.group is not None and selector.group not in groups:
        raise CaseError(f'{where}: there is no physical group "{selector.group}"; {suggestion(selector.group, groups)}')
    size = float(np.ptp(np.concatenate([face.points for face in faces]), axis=0).max())
    tests = _tests(selector, groups, LIES_ON * size)
    left = [face for face in faces if all(test(face) for test in tests)]
    if not left:
        known = "; ".join(describe(face) for face in faces[:12])
        raise CaseError(f"{where}: no face is like that; there are: {known}{' ...' if len(faces) > 12 else ''}")
    if selector.near is not None:
        left = [min(left, key=lambda face: _distance(face, np.array(selector.near)))]
    return tuple(face.face for face in left)


def _tests(selector: Selector, groups: Mapping[str, Sequence[int]], reach: float) -> list[Callable[[OuterFace], bool]]:
    """Make one test of a face for each key that is given."""
    tests: list[Callable[[OuterFace], bool]] = []
    for axis, key in enumerate("xyz"):
        value = getattr(selector, key)
        if value is not None:
            tests.append(partial(_in_plane, axis=axis, value=value, reach=reach))
    if selector.normal is not None:
        direction = np.array(selector.normal) / max(np.linalg.norm(selector.normal), 1e-300)
        tests.append(lambda face: bool(np.abs(face.normals - direction).max() <= LIES_ON))
    for shape, project in ((selector.sphere, _onto_sphere), (selector.cylinder, _onto_cylinder)):
        if shape is not None:
            tests.append(partial(_is_round, shape=shape, project=project, reach=reach))
    if selector.group is not None:
        members = groups[selector.group]
        tests.append(lambda face: face.tag in members)
    if selector.tags is not None:
        numbers = selector.tags
        tests.append(lambda face: face.tag in numbers)
    return tests


def _in_plane(face: OuterFace, axis: int, value: float, reach: float) -> bool:
    """Say whether a face lies in a plane across an axis."""
    return bool(np.abs(face.points[:, axis] - value).max() <= reach)


def _is_round(face: OuterFace, shape: Round, project: Callable[[OuterFace], Array | None], reach: float) -> bool:
    """Say whether a face lies on a sphere or a cylinder of a radius, and about a centre if that is given."""
    axes = project(face)
    if axes is None:
        return False
    flat = face.points @ axes.T
    system = np.column_stack([2 * flat, np.ones(len(flat))])  # |x|² = 2 c x + (r² - c²): linear in what is sought
    middle = flat.mean(axis=0)
    system[:, :-1] -= 2 * middle
    solution, _, rank, _ = np.linalg.lstsq(system, np.sum((flat - middle) ** 2, axis=1), rcond=1e-10)
    if rank < system.shape[1]:
        return False
    centre = solution[:-1] + middle
    if shape.centre is not None and np.abs(centre - axes @ shape.centre).max() > reach:
        return False
    return bool(np.abs(np.linalg.norm(flat - centre, axis=1) - shape.radius).max() <= reach)


def _onto_sphere(_: OuterFace) -> Array | None:
    """All of space."""
    return np.eye(3)


def _onto_cylinder(face: OuterFace) -> Array | None:
    """Find two axes (2, 3) across the cylinder: all normals lie in their plane; None for other faces."""
    _, widths, axes = np.linalg.svd(face.normals, full_matrices=False)
    return axes[:2] if widths[2] <= LIES_ON * widths[0] < widths[1] else None


def _distance(face: OuterFace, point: Array) -> float:
    return float(np.linalg.norm(closest_points(face.patch, point[None]).points[0] - point))


def describe(face: OuterFace) -> str:
    """Say in a few words which face this is: its number, whether it is plane, where its middle lies.

    A plane face is told by its normal, any other by its middle alone.
    """
    name = face.name if face.tag is None else f"{face.name}, number {face.tag},"
    middle = ", ".join(f"{x:.4g}" for x in face.points[len(face.points) // 2].round(12) + 0.0)
    if np.abs(face.normals - face.normals[0]).max() <= LIES_ON:
        normal = ", ".join(f"{x:.3g}" for x in face.normals[0].round(9) + 0.0)
        return f"{name} with normal ({normal}) about ({middle})"
    return f"{name} curved about ({middle})"
