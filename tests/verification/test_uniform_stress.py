"""A uniform stress is in equilibrium with its tractions on curved bodies: the quadrature makes no error in it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

import geom2iga
from geom2iga.glue import all_faces
from geom2iga.model import Model
from geom2iga.patch import evaluate
from solve.case import Load
from solve.elasticity import assemble_stiffness
from solve.loads import assemble_loads
from solve.material import Material
from solve.space import number_control_points
from tests.cases import block_patch, converged, largest_stress_error, model_of

TOLERANCE = 1e-10
STEEL = Material(1000.0, 0.3)
SQUEEZED = -np.eye(3) * (1 - 2 * STEEL.poisson) / STEEL.young  # displacement gradient of a pressure of 1
SHEARED = 1e-3 * np.array([[1.0, 0.2, -0.3], [0.1, -0.5, 0.2], [0.3, 0.1, 0.7]])
SLOW = pytest.mark.slow

PRIMITIVES = {
    "ball": ("sphere", {"radius": 1.0}),
    "hemisphere with shank": ("hemisphere", {"radius": 1.0, "height": 0.5}),
    "pipe": ("pipe", {"inner": 1.0, "outer": 2.0, "height": 1.0, "angle": 90.0}),
    "cylinder": ("cylinder", {"radius": 1.0, "height": 1.0}),
    "spherical dome": ("domed_block", {"size": [2.0, 2.0, 1.5], "radius": 2.0}),
    "cylindrical dome": ("domed_block", {"size": [2.0, 2.0, 1.5], "radius": 2.0, "bottom": "cylinder"}),
    "parabolic dome": ("domed_block", {"size": [2.0, 2.0, 1.5], "radius": 2.0, "bottom": "paraboloid"}),
}
# the ball has degree 4 at least; by default each body on a mesh that takes little time
QUICK = [
    ("ball", 2, 1),
    ("hemisphere with shank", 2, 1),
    *(("pipe", degree, spans) for degree in (2, 3, 4) for spans in (1, 2)),
    ("pipe", 2, 4),
    ("cylinder", 2, 1),
    ("cylinder", 2, 2),
    ("cylinder", 3, 1),
    *((f"{kind} dome", degree, 1) for kind in ("spherical", "cylindrical", "parabolic") for degree in (3, 4)),
    ("spherical dome", 2, 2),
    *(("loft", degree, 2) for degree in (2, 3, 4)),
]
LARGE = [(name, degree, 4) for name in ("ball", "hemisphere with shank") for degree in (3, 4)]
ALL = [(name, degree, spans) for name in (*PRIMITIVES, "loft") for degree in (2, 3, 4) for spans in (1, 2, 4)]
MESHES = pytest.mark.parametrize(
    ("name", "degree", "spans"),
    [*QUICK, *(pytest.param(*mesh, marks=SLOW) for mesh in ALL if mesh not in QUICK + LARGE)],
)


def body(name, degree, spans):
    if name == "loft":
        return twisted(degree, spans)
    kind, sizes = PRIMITIVES[name]
    return geom2iga.build({"geometry": {"degree": degree, kind: [{"name": "body", **sizes, "spans": spans}]}})


def twisted(degree, spans):
    """A polynomial prism that turns and narrows on its way up."""
    patch = block_patch("body", (-0.5, -0.5, 0), degree=degree, spans=(spans,) * 3)
    flat = patch.control_points.reshape(-1, 3)
    turn = Rotation.from_rotvec(flat[:, 2:] * [0, 0, 1.0]).as_matrix()
    points = np.einsum(
        "nij,nj->ni", turn, flat * np.column_stack([1 - 0.4 * flat[:, 2:] ** 2] * 2 + [flat[:, 2:] ** 0])
    )
    return model_of(replace(patch, control_points=points.reshape(patch.control_points.shape)))


def stress_of(gradient):
    """Stress tensor of a displacement gradient."""
    xx, yy, zz, xy, yz, xz = STEEL.stress(gradient[None])[0]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def pressed_all_around(model):
    """Space, and the forces (n, 3) of a pressure of 1 on all faces that are not glued: -∫ R_A n dΓ."""
    inside = {face for pair in model.glued for face in (pair.first, pair.second)}
    skin = tuple(face for face in all_faces(model.patches.values()) if face not in inside)
    space = number_control_points(Model(model.patches, model.bodies, {"skin": skin}, model.glued))
    return space, assemble_loads(space, [Load(on="skin", pressure=1.0)], [], [])


def freed(space, stiffness, forces, linear):
    """Displacements (n, 3) under forces, three points far apart held at a linear field (n, 3)."""
    arms = space.control_points - space.control_points[0]
    far = np.argmax(np.linalg.norm(arms, axis=1))
    aside = np.argmax(np.linalg.norm(np.cross(arms, arms[far]), axis=1))
    held = np.isin(np.arange(space.size), [0, far, aside]).repeat(3)
    found = linear.ravel().copy()
    right = (forces.ravel() - stiffness[:, held] @ found[held])[~held]
    found[~held] = spsolve(stiffness[~held][:, ~held].tocsc(), right)
    return found.reshape(-1, 3)


@MESHES
def test_a_linear_displacement_is_in_equilibrium_with_its_tractions_and_only_it_is_found(name, degree, spans):
    space, pressed = pressed_all_around(body(name, degree, spans))
    stiffness = assemble_stiffness(space, dict.fromkeys(space.model.bodies, STEEL))
    for gradient in (SQUEEZED, SHEARED):
        stress = stress_of(gradient)
        forces = -pressed @ stress  # of its tractions: sigma ∫ R_A n dΓ
        linear = space.control_points @ gradient.T
        residual = stiffness @ linear.ravel() - forces.ravel()
        assert np.abs(residual).max() < 1e-2 * TOLERANCE * np.abs(forces).max()
        found = freed(space, stiffness, forces, linear)
        xi = np.random.default_rng(0).random((200, 3))
        for own, patch in space.model.patches.items():
            slope = evaluate(patch, xi, 1, found[space.numbers[own]])[1] @ np.linalg.inv(evaluate(patch, xi, 1)[1])
            error = np.abs(STEEL.stress(slope - gradient)).max()
            assert error < TOLERANCE * np.abs(stress).max(), f"patch {own}: {error:.2g}"


@MESHES
def test_a_pressure_all_around_a_body_adds_up_to_nothing(name, degree, spans):
    _, forces = pressed_all_around(body(name, degree, spans))
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()


@pytest.mark.parametrize("spans", [1, 2, pytest.param(4, marks=SLOW)])
@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize(
    ("name", "held"), [("pipe", ("start", "end", "bottom")), ("spherical dome", ("left", "front", "top"))]
)
def test_a_body_held_in_three_planes_and_pressed_elsewhere_has_that_pressure_everywhere(name, held, degree, spans):
    model = body(name, degree, spans)
    pressed = [group for group in model.groups if group.removeprefix("body/") not in held]
    tables = {
        "material": [{"young": STEEL.young, "poisson": STEEL.poisson}],
        "support": [{"on": f"body/{face}", "normal": 0.0} for face in held],
        "load": [{"on": group, "pressure": 1.0} for group in pressed],
    }
    result = converged(model, {"solve": tables})
    assert largest_stress_error(result, (-1.0, -1.0, -1.0, 0.0, 0.0, 0.0)) < TOLERANCE
