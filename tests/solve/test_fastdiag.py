from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from geom2iga.patch import Face, elevated, face_indices, refined
from solve.elasticity import assemble_stiffness
from solve.fastdiag import diagonal_of, local_frames, rotations, straightened
from solve.material import Material
from solve.space import number_control_points
from tests import strategies
from tests.cases import bent_patch, block_patch, hollow_cylinder, model_of
from tests.strategies import SEEDS, bent_patches

STEEL = Material(200.0, 0.3)
FACES = [Face("block", axis, side) for axis in range(3) for side in range(2)]
FREE, CLAMPED = np.zeros((3, 3, 2), dtype=bool), np.zeros((3, 3, 2), dtype=bool)
CLAMPED[:, 2, 0] = True


def diagonalise(patch, material, fixed):
    """The three components of a patch, fixed (3, 3, 2) at the two ends of each direction or not."""
    return tuple(diagonal_of(lines, ends) for lines, ends in zip(straightened(patch, material), fixed, strict=True))


def fixations():
    """Which components are fixed on which faces; each on at least one, and never two opposite ones."""
    one_end = st.sampled_from([(False, False), (True, False), (False, True)])
    held = st.tuples(*[one_end] * 3).filter(lambda ends: np.any(ends))
    return st.tuples(*[held] * 3).map(np.array)


def stiffness_of(patch, material=STEEL):
    return assemble_stiffness(number_control_points(model_of(patch)), {patch.name: material}).toarray()


def inverse_of(component):
    """All of a component's inverse, dense."""
    grids = np.eye(np.prod([len(basis) for basis in component.bases])).reshape(-1, *map(len, component.bases))
    return np.array([component.displacements(component.modes(grid)).ravel() for grid in grids])


def free_functions(patch, fixed):
    """Control points of a patch on none of the fixed faces (3, 2)."""
    free = np.ones(patch.shape, dtype=bool)
    for axis, side in zip(*np.nonzero(fixed), strict=True):
        free.reshape(-1)[face_indices(patch, Face(patch.name, axis, side)).ravel()] = False
    return np.flatnonzero(free)


@settings(max_examples=12)
@given(
    strategies.rotations(),
    st.tuples(*[st.integers(1, 4)] * 3),
    st.tuples(*[st.integers(1, 3)] * 3),
    st.floats(-0.5, 0.49),
    fixations(),
)
def test_on_a_turned_cuboid_it_inverts_the_stiffness_of_each_component_along_its_edges(
    turn, degrees, spans, poisson, fixed
):
    """The components of a cuboid only see each other through the coupling that is left out."""
    patch, material = block_patch("block", (0, 0, 0), (1, 0.3, 2), degrees, spans, turn), Material(10.0, poisson)
    axes = np.kron(np.eye(np.prod(patch.shape)), turn.as_matrix())
    stiffness = axes.T @ stiffness_of(patch, material) @ axes
    for i, component in enumerate(diagonalise(patch, material, fixed)):
        free = free_functions(patch, fixed[i])
        found = inverse_of(component)
        own = stiffness[i::3, i::3][np.ix_(free, free)]
        np.testing.assert_allclose(found[np.ix_(free, free)] @ own, np.eye(len(free)), rtol=0, atol=1e-8)
        held = np.delete(np.arange(len(found)), free)
        np.testing.assert_array_equal(found[held], 0)
        np.testing.assert_array_equal(found[:, held], 0)


@settings(max_examples=10)
@given(bent_patches(), fixations())
def test_it_is_symmetric_and_positive_whatever_the_map(patch, fixed):
    for i, component in enumerate(diagonalise(patch, STEEL, fixed)):
        assert np.all(component.values > 0)
        found, free = inverse_of(component), free_functions(patch, fixed[i])
        np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-12 * np.abs(found).max())
        assert np.linalg.eigvalsh(found[np.ix_(free, free)])[0] > 0


@settings(max_examples=8)
@given(bent_patches())
def test_motions_that_nothing_resists_get_a_finite_displacement_too(patch):
    for component in diagonalise(patch, STEEL, FREE):
        energies = np.sort(component.values.ravel())
        assert 0 < energies[0] <= energies[1]
        assert energies[0] >= 0.1 * energies[1]


def condition(patch, fixed=CLAMPED):
    """Largest over smallest eigenvalue of the stiffness with the diagonalised inverse as preconditioner."""
    count = np.prod(patch.shape)
    frames = np.broadcast_to(local_frames(patch), (count, 3, 3))
    local = np.zeros((3 * count, 3 * count))
    for point, frame in enumerate(frames):
        local[3 * point : 3 * point + 3, 3 * point : 3 * point + 3] = frame
    stiffness, near = local.T @ stiffness_of(patch) @ local, np.zeros((3 * count, 3 * count))
    free = np.sort(np.concatenate([3 * free_functions(patch, fixed[i]) + i for i in range(3)]))
    for i, component in enumerate(diagonalise(patch, STEEL, fixed)):
        near[i::3, i::3] = inverse_of(component)
    inner = np.ix_(free, free)
    values = eigh(stiffness[inner], np.linalg.inv(near[inner]), eigvals_only=True)
    return values[-1] / values[0], values[-1]


@pytest.mark.parametrize(("degree", "spans"), [(1, 2), (1, 4), (2, 1), (2, 4), (3, 2), (4, 1)])
def test_on_a_clamped_cube_the_condition_depends_on_neither_mesh_nor_degree(degree, spans):
    """Three coupled components have at most three times the energy of uncoupled ones; Korn's constant is below."""
    found, largest = condition(block_patch(degree=degree, spans=(spans,) * 3))
    assert largest <= 3
    assert found < 16  # it rises towards 14.5 as the mesh gets finer


GRADED = [0.001, 0.01, 0.1]
CURVED = {
    "graded by 1000": refined(block_patch(degree=2), knots=[GRADED] * 3),
    "bent": bent_patch(1, spans=(2, 2, 2)),
    "quarter of a hollow cylinder": refined(elevated(hollow_cylinder(), (2, 2, 2)), spans=2),
    "quarter of a disc with a small hole": refined(elevated(hollow_cylinder(0.1, 1.0, 0.5), (2, 2, 2)), spans=2),
}


@pytest.mark.parametrize("name", CURVED)
def test_on_graded_and_curved_patches_that_are_not_slender_the_condition_is_at_most_twice_that_of_the_cube(name):
    assert condition(CURVED[name])[0] < 2 * 16


@pytest.fixture(scope="module")
def component():
    patch = refined(bent_patch(4, (2, 3, 1), (1, 1, 1)), knots=[[0.3], [0.2, 0.9], [0.5]])
    fixed = np.zeros((3, 3, 2), dtype=bool)
    fixed[1, 0, 1] = True
    return patch, diagonalise(patch, STEEL, fixed)[1]


@pytest.mark.parametrize(("one", "other"), list(product(FACES, FACES)), ids=lambda face: f"{face.axis}{face.side}")
def test_what_forces_on_a_face_do_to_another_is_part_of_the_whole_inverse(component, one, other):
    patch, part = component
    here, there = (face_indices(patch, face) for face in (one, other))
    expected = inverse_of(part)[np.ix_(here.ravel(), there.ravel())]
    tolerance = 1e-12 * np.abs(part.bases[0]).max() ** 6 / part.values.min()
    np.testing.assert_allclose(part.between(one, other), expected, rtol=0, atol=tolerance)
    forces = np.random.default_rng(0).normal(size=there.shape)
    moved = part.traced(one, part.pushed(other, forces))
    assert moved.shape == here.shape
    np.testing.assert_allclose(moved.ravel(), expected @ forces.ravel(), rtol=0, atol=100 * tolerance)


@pytest.mark.parametrize("face", FACES, ids=lambda face: f"{face.axis}{face.side}")
def test_the_modes_of_a_face_make_up_what_its_forces_do_to_it(component, face):
    _, part = component
    modes = part.face_modes(face)
    bases = np.kron(modes.first, modes.second)
    expected = part.between(face, face)
    found = (bases * modes.mobility.ravel()) @ bases.T
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_in_single_precision_it_is_as_exact_as_that_allows(component):
    _, part = component
    rounded, forces = part.rounded(np.float32), np.random.default_rng(0).normal(size=tuple(map(len, part.bases)))
    exact = part.displacements(part.modes(forces))
    found = rounded.displacements(rounded.modes(forces.astype(np.float32)))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-5 * np.abs(exact).max())


@given(SEEDS)
def test_frames_are_rotations_that_undo_any_stretch_along_their_axes(seed):
    random = np.random.default_rng(seed)
    turn = Rotation.random(4, random_state=seed).as_matrix()
    np.testing.assert_allclose(rotations(turn * random.uniform(0.001, 1000, 3)), turn, rtol=0, atol=1e-12)
    frames = rotations(turn @ (np.diag(random.uniform(1, 9, 3)) + random.uniform(-0.2, 0.2, (4, 3, 3))))
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-12)


def test_frames_follow_a_curved_map():
    ring = elevated(hollow_cylinder(), (2, 2, 2))
    radial = local_frames(ring)[..., 0]
    points = ring.control_points.reshape(-1, 3) * [1, 1, 0]
    np.testing.assert_allclose(radial, points / np.linalg.norm(points, axis=1)[:, None], rtol=0, atol=0.05)
