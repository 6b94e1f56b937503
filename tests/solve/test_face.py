import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.bspline import find_spans
from geom2iga.errors import CaseError
from geom2iga.model import SIDES
from geom2iga.patch import Face, basis, evaluate
from solve.face import area_vectors, find_plane, nodal_forces, surface_of, trace_matrix
from solve.space import gauss_points, number_control_points
from tests.cases import AXES, bent_patch, block_patch, hollow_cylinder, model_of
from tests.strategies import SEEDS, bent_patches, rotations

FACES = [Face("bent", axis, side) for axis in range(3) for side in range(2)]


def lifted(face, xi):
    """Points of a volume (q, 3) from points of its face (q, 2)."""
    return np.insert(xi, face.axis, float(face.side), axis=1)


@given(bent_patches(), st.sampled_from(FACES), SEEDS)
def test_a_trace_is_the_volume_basis_on_the_face_and_adds_up_to_one(patch, face, seed):
    space = number_control_points(model_of(block_patch(), patch))
    xi = np.random.default_rng(seed).random((7, 2))
    trace = trace_matrix(space, face, xi)
    np.testing.assert_allclose(trace.sum(axis=1), 1, rtol=0, atol=1e-14)
    functions = basis(patch, lifted(face, xi))
    expected = np.zeros(trace.shape)
    np.put_along_axis(expected, space.numbers["bent"][functions.indices], functions.values, axis=1)
    np.testing.assert_allclose(trace.toarray(), expected, rtol=0, atol=1e-14)


@given(bent_patches(), st.sampled_from(FACES), SEEDS)
def test_normals_point_out_of_the_body_on_all_six_faces(patch, face, seed):
    xi = np.random.default_rng(seed).random((5, 2))
    points, normal, stretch = area_vectors(surface_of(model_of(patch), face), xi)
    position, jacobian = evaluate(patch, lifted(face, xi), 1)
    outward = np.linalg.inv(jacobian)[:, face.axis] * (1 if face.side else -1)  # gradient of the face's own parameter
    cofactor = np.linalg.det(jacobian)[:, None] * outward  # Nanson's formula
    np.testing.assert_allclose(points, position, rtol=0, atol=1e-14)
    np.testing.assert_allclose(normal * stretch[:, None], cofactor, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=1e-14)


@given(bent_patches(rational=False))
def test_area_vectors_of_a_closed_surface_add_up_to_nothing(patch):
    total = np.zeros(3)
    for face in FACES:
        surface = surface_of(model_of(patch), face)
        points = gauss_points(surface.patch)
        _, normal, stretch = area_vectors(surface, points.xi)
        total += (points.weights * stretch) @ normal
    assert np.abs(total).max() < 1e-12


@pytest.mark.parametrize("face", FACES, ids=SIDES)
@given(turn=rotations())
def test_the_plane_of_a_block_face_has_the_turned_axis_as_outward_normal(face, turn):
    patch = block_patch("bent", origin=(3, -2, 1), size=(1, 2, 0.5), degree=2, spans=(2, 1, 2), turn=turn)
    surface = surface_of(model_of(patch), face)
    plane = find_plane(surface)
    expected = turn.apply(np.array(AXES[face.axis]) * (1 if face.side else -1))
    np.testing.assert_allclose(plane.normal, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(plane.frame @ plane.frame.T, np.eye(2), rtol=0, atol=1e-13)
    heights = (surface.patch.control_points - plane.origin) @ plane.normal
    assert np.abs(heights).max() < 1e-13


@pytest.mark.parametrize("face", FACES, ids=SIDES)
def test_a_face_along_the_axes_has_exactly_an_axis_as_normal(face):
    patch = block_patch("bent", origin=(0.1, 0.7, 0.3), size=(1.1, 0.9, 1.3), spans=(3, 3, 3))
    normal = find_plane(surface_of(model_of(patch), face)).normal
    np.testing.assert_array_equal(normal, np.array(AXES[face.axis]) * (1 if face.side else -1))


def test_a_curved_face_has_no_plane_and_is_named():
    model = model_of(hollow_cylinder())
    for side in ("front", "back", "bottom", "top"):
        find_plane(surface_of(model, model.faces(f"ring/{side}")[0]))
    for side in ("left", "right"):
        with pytest.raises(CaseError, match=f'"ring/{side}" is curved'):
            find_plane(surface_of(model, model.faces(f"ring/{side}")[0]))


@pytest.mark.parametrize("face", FACES, ids=SIDES)
@given(SEEDS)
def test_nodal_forces_do_the_work_of_the_forces_at_the_points(face, seed):
    patch, random = bent_patch(seed), np.random.default_rng(seed)
    surface = surface_of(model_of(patch), face)
    xi, forces = random.random((20, 2)), random.normal(size=(20, 3))
    spans = np.stack(
        [find_spans(k, p, x) for k, p, x in zip(surface.patch.knots, surface.patch.degrees, xi.T, strict=True)], axis=1
    )
    motion = random.normal(size=(surface.patch.weights.size, 3))
    work = np.sum(evaluate(surface.patch, xi, 0, motion)[0] * forces)
    assert np.sum(motion * nodal_forces(surface, xi, spans, forces)) == pytest.approx(work, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("face", FACES, ids=SIDES)
@given(SEEDS)
def test_all_normals_lie_in_the_cone(face, seed):
    surface = surface_of(model_of(bent_patch(seed)), face)
    _, normal, _ = area_vectors(surface, np.random.default_rng(seed).random((200, 2)))
    assert (normal @ surface.cone.axis).min() >= np.cos(surface.cone.angle)
