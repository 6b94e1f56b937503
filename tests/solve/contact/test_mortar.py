import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.patch import evaluate, refined
from solve.case import Contact, Load
from solve.contact import mortar as mortars
from solve.contact.cells import find_cells
from solve.contact.mortar import assemble_mortar, stacked
from solve.loads import assemble_loads
from solve.space import number_control_points
from tests.cases import block_patch, hollow_cylinder, model_of, outline, turned
from tests.oracles import assert_balanced, assert_rigid_motion_costs_nothing
from tests.strategies import SEEDS, rotations, stacked_blocks

INTEGRATIONS = st.sampled_from(["segment", "element"])


METHODS = ({}, {"multiplier": "p-2"}, {"method": "kts"})


def mortar_of(model, integration="segment", secondary="upper/bottom", primary="lower/top", **values):
    space = number_control_points(model)
    contact = Contact(secondary=secondary, primary=primary, integration=integration, **values)
    return space, assemble_mortar(space, contact, find_cells(model, contact))


@given(st.data(), INTEGRATIONS, st.sampled_from([0.0, 0.1]), rotations())
def test_motions_that_both_bodies_share_leave_all_gaps(data, integration, height, turn):
    space, mortar = mortar_of(data.draw(stacked_blocks(height=height, overhang=False, turn=turn)), integration)
    assert_rigid_motion_costs_nothing(mortar.gap_operator, space.control_points)


@given(st.data(), INTEGRATIONS, SEEDS, st.sampled_from([0.0, 0.1]))
def test_contact_forces_of_any_pressure_balance_each_other(data, integration, seed, height):
    space, mortar = mortar_of(data.draw(stacked_blocks(height=height, overhang=False)), integration)
    pressure = np.random.default_rng(seed).random(len(mortar.area))
    assert_balanced((mortar.gap_operator.T @ pressure).reshape(-1, 3), space.control_points)


@given(SEEDS)
def test_contact_forces_between_curved_faces_balance_each_other(seed):
    inner, outer = hollow_cylinder(1, 2, 3, "inner"), hollow_cylinder(2.1, 3, 3, "outer")
    model = model_of(refined(inner, spans=2), refined(outer, spans=3))
    space, mortar = mortar_of(model, "element", "inner/right", "outer/left")
    pressure = np.random.default_rng(seed).random(len(mortar.area))
    assert_balanced((mortar.gap_operator.T @ pressure).reshape(-1, 3), space.control_points, tolerance=1e-10)
    assert_rigid_motion_costs_nothing(mortar.gap_operator, space.control_points, tolerance=1e-9)


@given(st.data(), INTEGRATIONS, st.floats(-1, 1), st.floats(-1, 1), rotations())
def test_a_constant_gap_is_that_of_every_control_point(data, integration, height, closing, turn):
    model = data.draw(stacked_blocks(height=height, overhang=False, turn=turn))
    space, mortar = mortar_of(model, integration)
    displacement = np.random.default_rng(0).normal(size=3) * np.ones((space.size, 3))
    displacement[space.body_numbers("lower")] += closing * turn.apply([0, 0, 1])
    gap = mortar.control_gaps(displacement)
    np.testing.assert_allclose(gap, height - closing, rtol=0, atol=1e-12)


@given(stacked_blocks())
def test_areas_of_competence_are_positive_and_add_up_to_the_overlap(model):
    space, mortar = mortar_of(model)
    area = outline(model, "upper/bottom").intersection(outline(model, "lower/top")).area
    assert mortar.area.sum() == pytest.approx(area, rel=1e-11)
    assert np.all(mortar.area > 0)
    face = space.face_numbers(model.faces("upper/bottom")[0])
    assert set(mortar.rows) <= set(face)


def test_control_points_off_the_overlap_have_no_area_of_competence():
    lower = block_patch("lower", size=(2, 2, 1))
    upper = block_patch("upper", (1, 0.5, 1), size=(3, 1, 1), spans=(3, 1, 1))
    space, mortar = mortar_of(model_of(lower, upper))
    np.testing.assert_allclose(space.control_points[mortar.rows][:, 0].max(), 2)


@given(stacked_blocks(overhang=False))
def test_a_uniform_contact_pressure_loads_the_secondary_face_as_a_pressure_does(model):
    for integration in ("segment", "element"):
        space, mortar = mortar_of(model, integration)
        forces = (mortar.gap_operator.T @ np.ones(len(mortar.area))).reshape(-1, 3)
        expected = assemble_loads(space, [Load(on="upper/bottom", pressure=1.0)], [], [])
        upper = space.body_numbers("upper")
        np.testing.assert_allclose(forces[upper], expected[upper], rtol=0, atol=1e-12)


@given(stacked_blocks(overhang=False))
def test_a_uniform_contact_pressure_on_the_larger_face_loads_the_covered_one_evenly(model):
    """With segments, the primary face receives a uniform pressure exactly, whatever the knot lines."""
    space, mortar = mortar_of(model, secondary="lower/top", primary="upper/bottom")
    forces = (mortar.gap_operator.T @ np.ones(len(mortar.area))).reshape(-1, 3)
    expected = assemble_loads(space, [Load(on="upper/bottom", pressure=1.0)], [], [])
    upper = space.body_numbers("upper")
    np.testing.assert_allclose(forces[upper], expected[upper], rtol=0, atol=1e-12)


@given(stacked_blocks(), SEEDS, st.floats(-1, 1))
def test_contact_forces_are_the_adjoint_of_the_gaps(model, seed, height):
    """The work of any pressures on any motion is that of their forces."""
    space, mortar = mortar_of(model)
    random = np.random.default_rng(seed)
    before, after = random.normal(size=(2, space.size, 3))
    pressure = random.random(len(mortar.area))
    work = pressure @ (mortar.area * (mortar.control_gaps(after) - mortar.control_gaps(before)))
    forces = mortar.gap_operator.T @ pressure
    assert work == pytest.approx(forces @ (after - before).ravel(), rel=1e-9, abs=1e-12)


def test_stacked_mortars_keep_their_gaps_one_contact_after_the_other():
    lower = block_patch("lower", size=(3, 1, 1))
    space = number_control_points(
        model_of(lower, block_patch("one", (0, 0, 1.1)), block_patch("two", (2, 0, 1.2), degree=2))
    )
    parts = []
    for name in ("one", "two"):
        contact = Contact(secondary=f"{name}/bottom", primary="lower/top")
        parts.append(assemble_mortar(space, contact, find_cells(space.model, contact)))
    both = stacked(parts, space.dofs)
    displacement = np.random.default_rng(0).normal(size=(space.size, 3))
    expected = np.concatenate([part.control_gaps(displacement) for part in parts])
    np.testing.assert_array_equal(both.control_gaps(displacement), expected)
    np.testing.assert_array_equal(both.rows, np.concatenate([part.rows for part in parts]))


def test_no_contact_at_all_has_no_gaps():
    mortar = stacked([], 24)
    assert mortar.control_gaps(np.zeros((8, 3))).shape == (0,)


@given(stacked_blocks(height=0.1), rotations())
def test_all_pressure_spaces_add_up_to_the_same_forces_gap_and_area(model, turn):
    """Each is a partition of unity, so that one uniform pressure is the same for all."""
    model = model_of(*(turned(patch, turn) for patch in model.patches.values()))
    smooth = min(model.patches["upper"].degrees) >= 2
    one, *others = [mortar_of(model, **v)[1] for v in METHODS if smooth or v != METHODS[1]]
    for other in others:
        sums = [abs(m.gap_operator).max() * len(m.area) for m in (one, other)]
        difference = one.gap_operator.sum(axis=0) - other.gap_operator.sum(axis=0)
        assert np.abs(difference).max() <= 1e-12 * max(sums)
        assert other.area.sum() == pytest.approx(one.area.sum(), rel=1e-12)
        assert other.initial_gap.sum() == pytest.approx(one.initial_gap.sum(), rel=1e-11)
        moments = [m.area @ m.centres for m in (one, other)]
        np.testing.assert_allclose(*moments, rtol=0, atol=1e-11 * (1 + one.area.sum()))


@pytest.mark.parametrize("values", METHODS)
@given(data=st.data())
def test_areas_of_competence_lie_about_their_centres_in_the_overlap(values, data):
    model = data.draw(stacked_blocks())
    if "multiplier" in values and min(model.patches["upper"].degrees) < 2:
        return
    _, mortar = mortar_of(model, **values)
    overlap = outline(model, "upper/bottom").intersection(outline(model, "lower/top"))
    np.testing.assert_allclose(mortar.centres[:, 2], 1, rtol=0, atol=1e-12)
    assert all(overlap.distance(shapely.Point(centre[:2])) < 1e-9 for centre in mortar.centres)
    centroid = mortar.area @ mortar.centres / mortar.area.sum()
    np.testing.assert_allclose(centroid[:2], overlap.centroid.coords[0], rtol=0, atol=1e-9)


@given(stacked_blocks(overhang=False))
def test_the_pressure_of_each_quadrature_point_acts_on_its_own_area(model):
    space, mortar = mortar_of(model, method="kts")
    (part,) = find_cells(model, Contact(secondary="upper/bottom", primary="lower/top"))
    np.testing.assert_allclose(mortar.area, part.area[mortar.rows], rtol=1e-12)
    displacement = np.random.default_rng(0).normal(size=(space.size, 3))
    (secondary,), (primary,) = model.faces("upper/bottom"), model.faces("lower/top")
    moved = [
        evaluate(model.surface(face), xi, 0, displacement[space.face_numbers(face)])[0]
        for face, xi in ((secondary, part.secondary_xi), (primary, part.primary_xi))
    ]
    gap = part.gap + np.einsum("qk,qk->q", moved[0] - moved[1], part.normal)
    np.testing.assert_allclose(mortar.control_gaps(displacement), gap[mortar.rows], rtol=0, atol=1e-12)


@pytest.mark.parametrize("values", METHODS)
@pytest.mark.parametrize("integration", ["segment", "element"])
def test_the_memory_that_integrals_may_take_does_not_change_them(integration, values, monkeypatch):
    turn = Rotation.from_rotvec([0, 0, 30], degrees=True)
    lower = turned(block_patch("lower", (-1, -1, 0), (2, 2, 1), degree=2, spans=(4, 3, 1)), turn)
    model = model_of(lower, block_patch("upper", (-0.5, -0.4, 1.1), degree=2, spans=(3, 4, 1)))
    whole = mortar_of(model, integration, **values)[1]
    monkeypatch.setattr(mortars, "CHUNK", 5000)  # a few runs of points at a time
    pieces = mortar_of(model, integration, **values)[1]
    np.testing.assert_array_equal(pieces.rows, whole.rows)
    for name in ("initial_gap", "area", "centres"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=0, atol=1e-14)
    assert abs(pieces.gap_operator - whole.gap_operator).max() < 1e-15


def test_gaps_along_an_axis_depend_on_displacements_along_it_alone():
    lower, upper = block_patch("lower", degree=2, spans=(7, 3, 1)), block_patch("upper", (0, 0, 1), spans=(5, 4, 1))
    _, mortar = mortar_of(model_of(lower, upper))
    assert set(mortar.gap_operator.indices % 3) == {2}
