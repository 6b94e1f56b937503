"""Patches, models and cases that several tests use."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

import solve
from geom2iga.bspline import Array, open_knots
from geom2iga.model import Face, Model, side_faces
from geom2iga.patch import Patch, elevated, evaluate, refined
from solve import Result
from solve.contact.laws import Penalty
from solve.linear import DirectSolver
from solve.newton import exact_step, iterate
from solve.system import System
from solve.tangents import Factorised

UNIT = np.stack(np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1], indexing="ij"), axis=-1)  # corners (2, 2, 2, 3)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

TWO_BLOCKS = """
title = "two blocks"

[geometry]
degree = 1

[[geometry.block]]
name = "lower"
size = [2.0, 2.0, 1.0]
spans = [2, 2, 1]

[[geometry.block]]
name = "upper"
origin = [0.5, 0.5, 1.0]
size = [1.0, 1.0, 1.0]

[[solve.material]]
young = 1000.0
poisson = 0.3

[[solve.support]]
on = "lower/bottom"
ux = 0.0
uy = 0.0
uz = 0.0

[[solve.support]]
on = "upper/top"
ux = 0.0
uy = 0.0
uz = -0.01

[[solve.contact]]
secondary = "upper/bottom"
primary = "lower/top"

[solve.newton]
max_steps = 50
"""


def block_patch(
    name: str = "block",
    origin: Sequence[float] = (0, 0, 0),
    size: Sequence[float] = (1, 1, 1),
    degree: int | Sequence[int] = 1,
    spans: Sequence[int] = (1, 1, 1),
    turn: Rotation | None = None,
) -> Patch:
    """A cuboid with uniform spans, turned about the origin of space."""
    degrees = (degree,) * 3 if isinstance(degree, int) else degree
    corners = np.asarray(origin, dtype=float) + UNIT * np.asarray(size, dtype=float)
    patch = elevated(Patch(name, (1, 1, 1), (open_knots([0, 1], 1),) * 3, corners), degrees)
    inner = [np.arange(1, count) / count for count in spans]
    return turned(refined(patch, knots=inner), turn)


def turned(patch: Patch, turn: Rotation | None) -> Patch:
    """Turn a patch about the origin of space."""
    if turn is None:
        return patch
    return replace(patch, control_points=patch.control_points @ turn.as_matrix().T)


def moved(patch: Patch, by: Sequence[float]) -> Patch:
    """Move a patch."""
    return replace(patch, control_points=patch.control_points + np.asarray(by, dtype=float))


def bent_patch(
    seed: int,
    degrees: Sequence[int] = (2, 2, 2),
    spans: Sequence[int] = (2, 1, 2),
    name: str = "bent",
    rational: bool = True,
) -> Patch:
    """A turned cuboid with displaced control points and, if rational, uneven weights; its Jacobian is positive."""
    random = np.random.default_rng(seed)
    patch = block_patch(name, size=(2.0, 1.5, 1.0), degree=tuple(degrees), spans=spans)
    reach = 0.15 * np.min([np.diff(patch.control_points, axis=d)[..., d].min() for d in range(3)])
    points = patch.control_points + reach * random.uniform(-1, 1, patch.control_points.shape)
    weights = random.uniform(0.8, 1.25, patch.shape) if rational else None
    return turned(replace(patch, control_points=points, weights=weights), Rotation.random(random_state=seed))


def hollow_cylinder(inner: float = 1.0, outer: float = 2.0, height: float = 1.0, name: str = "ring") -> Patch:
    """A quarter of a hollow cylinder about z, exact: along the radius, the angle and the height."""
    arc = np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    points = np.array([[[radius * p + [0, 0, z] for z in (0.0, height)] for p in arc] for radius in (inner, outer)])
    weights = np.broadcast_to(np.array([1, 0.5**0.5, 1])[None, :, None], (2, 3, 2))
    return Patch(
        name, (1, 2, 1), (open_knots([0, 1], 1), open_knots([0, 1], 2), open_knots([0, 1], 1)), points, weights
    )


def block_groups(patch: str) -> dict[str, tuple[Face, ...]]:
    """Groups of the six faces of a body of one patch, named as those of blocks."""
    return {f"{patch}/{side}": faces for side, faces in side_faces(patch).items()}


def model_of(*patches: Patch) -> Model:
    """A model of one body per patch, its faces named as those of blocks."""
    groups = {group: faces for patch in patches for group, faces in block_groups(patch.name).items()}
    return Model({p.name: p for p in patches}, {p.name: (p.name,) for p in patches}, groups)


def patch_test_case(
    degree: int = 1,
    lower_spans: Sequence[int] = (4, 4, 4),
    upper_spans: Sequence[int] = (4, 4, 4),
    upper_origin: Sequence[float] = (0.5, 0.5, 1.0),
    upper_size: Sequence[float] = (1.0, 1.0, 1.0),
    upper_degree: int | None = None,
    angle: float = 0.0,
    turn: dict[str, Any] | None = None,
    integration: str = "segment",
    penalty: float | str = 1e5,
    swap: bool = False,
) -> dict[str, Any]:
    """The contact patch test: a block on a block of 2 x 2 x 1, pressure 1 on both, so that the stress is uniform.

    Parameters
    ----------
    angle :
        Of the upper block about its own vertical axis [degrees].
    turn :
        Rotation of both blocks about one common axis, in place of `angle`.
    swap :
        The lower block is the secondary one.
    """
    lower = {"name": "lower", "size": [2.0, 2.0, 1.0], "spans": list(lower_spans)}
    upper = {"name": "upper", "origin": list(upper_origin), "size": list(upper_size), "spans": list(upper_spans)}
    if turn is not None:
        lower["rotate"] = upper["rotate"] = turn
    elif angle:
        upper["rotate"] = {"angle": angle}
    if upper_degree is not None:
        upper["degree"] = upper_degree
    sides = ("lower/top", "upper/bottom") if swap else ("upper/bottom", "lower/top")
    held = ("lower/bottom", "lower/left", "lower/front", "upper/left", "upper/front")
    contact = {"secondary": sides[0], "primary": sides[1], "penalty": penalty, "integration": integration}
    return {
        "geometry": {"degree": degree, "block": [lower, upper]},
        "solve": {
            "material": [{"young": 1000.0, "poisson": 0.3}],
            "support": [{"on": face, "normal": 0.0} for face in held],
            "load": [
                {"on": "upper/top", "pressure": 1.0},
                {"on": "lower/top", "pressure": 1.0, "exposed": True},
                {"on": "upper/bottom", "pressure": 1.0, "exposed": True},
            ],
            "contact": [contact],
        },
    }


def outline(model: Model, group: str) -> shapely.Polygon:
    """Seen along z, the outline of a plane face with straight edges."""
    corners = evaluate(model.surface(model.faces(group)[0]), [[0, 0], [1, 0], [1, 1], [0, 1]])[0]
    return shapely.Polygon(corners[:, :2])


def contact_system(seed: int, free: int, contacts: int, rigid_motions: int = 0) -> System:
    """A small random contact problem; its loads press against the contacts along any rigid motions."""
    random = np.random.default_rng(seed)
    factor = random.normal(size=(free, free))
    stiffness, load = factor @ factor.T + 0.1 * np.eye(free), random.normal(size=free)
    operator = random.normal(size=(contacts, free))
    rigid = np.linalg.qr(random.normal(size=(free, rigid_motions)))[0]
    rest = np.eye(free) - rigid @ rigid.T
    pressure = random.uniform(0.1, 1, contacts)  # of some state of equilibrium
    return System(
        csr_array(rest @ stiffness @ rest),
        rest @ load - rigid @ (rigid.T @ (operator.T @ pressure)),
        csr_array(operator),
        random.normal(size=contacts),
        random.uniform(0.5, 2.0, contacts),
        Penalty(10 ** random.uniform(-1, 3, contacts)),
        rigid,
    )


def exact_step_along(system: System, free: Array, direction: Array) -> float:
    """The step that is exactly best from a displacement (free,) along a direction (free,)."""
    return exact_step(system, iterate(system, free), direction, system.stiffness @ direction)


def solved(solver: DirectSolver, matrix: csr_array, right: Array) -> Array:
    """Factorise, solve and refine."""
    return Factorised(lambda active: matrix, solver).solved(np.empty(0, dtype=bool), right)


def converged(model: Model, case: Any) -> Result:
    """Solve, and insist on equilibrium."""
    result = solve.solve(model, case)
    assert result.status is solve.Status.CONVERGED, result.status.value
    return result


def displacement_at(result: Result, patch: str, xi: Array) -> Array:
    """Displacements (q, 3) at parametric points of a patch."""
    return evaluate(result.model.patches[patch], xi, 0, result.displacement_of(patch))[0]


def stress_at(result: Result, patch: str, xi: Array) -> Array:
    """Stresses (q, 6) at parametric points of a patch: xx yy zz xy yz xz."""
    volume = result.model.patches[patch]
    _, jacobian = evaluate(volume, xi, 1)
    _, slope = evaluate(volume, xi, 1, result.displacement_of(patch))
    return result.materials[result.model.body_of(patch)].stress(slope @ np.linalg.inv(jacobian))


def largest_stress_error(result: Result, expected: Sequence[float], count: int = 1000) -> float:
    """Largest difference of any component from a uniform stress (6,), at random points of every patch."""
    random = np.random.default_rng(0)
    found = [stress_at(result, name, random.random((count, 3))) for name in result.model.patches]
    return float(np.abs(np.concatenate(found) - np.asarray(expected)).max())


def sample_points(patch: Patch, count: int = 12, seed: int = 0) -> Array:
    """Parametric points (q, d) of a patch: random ones, random crossings of knot lines, both far corners."""
    random = np.random.default_rng(seed)
    inside = np.stack([random.uniform(at[0], at[-1], count) for at in patch.breaks], axis=1)
    crossings = np.stack([random.choice(at, count) for at in patch.breaks], axis=1)
    corners = np.array([[at[end] for at in patch.breaks] for end in (0, -1)])
    return np.concatenate([inside, crossings, corners])
