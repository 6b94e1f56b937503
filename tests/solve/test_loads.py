import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.errors import CaseError
from geom2iga.model import SIDES, Model
from geom2iga.patch import Face
from solve import loads as load_module
from solve.case import BodyForce, Contact, Load
from solve.contact.cells import find_cells
from solve.contact.mortar import assemble_mortar
from solve.face import area_vectors, surface_of
from solve.loads import assemble_loads
from solve.space import gauss_points, number_control_points
from tests.cases import AXES, block_patch, hollow_cylinder, model_of, moved, outline, turned
from tests.oracles import assert_balanced, volume_quadrature
from tests.strategies import bent_patches, rotations, stacked_blocks
from tests.verification.glued_bodies import glued_model, wall

PRESSURES = st.floats(-5, 5)
VECTORS = st.tuples(PRESSURES, PRESSURES, PRESSURES)
CONTACT = Contact(secondary="upper/bottom", primary="lower/top")


def forces_of(model, *loads, body_force=(), contacts=()):
    space = number_control_points(model)
    covers = [(contact, find_cells(model, contact)) for contact in contacts]
    return space, assemble_loads(space, [Load(**load) for load in loads], body_force, covers)


def resultant(space, forces, about=(0.0, 0, 0)):
    """Force and moment about a point."""
    return forces.sum(axis=0), np.cross(space.control_points - about, forces).sum(axis=0)


@given(rotations(), st.sampled_from(range(6)), PRESSURES, VECTORS, st.integers(1, 3))
def test_a_uniform_pressure_is_its_area_at_the_centre_of_the_face_pushing_inward(turn, number, pressure, about, degree):
    size = np.array([2.0, 3.0, 0.5])
    model = model_of(block_patch(size=size, degree=degree, spans=(2, 1, 3), turn=turn))
    space, forces = forces_of(model, {"on": f"block/{SIDES[number]}", "pressure": pressure})
    axis, side = divmod(number, 2)
    outward = turn.apply(np.array(AXES[axis]) * (1 if side else -1))
    centre = turn.apply(np.where(np.arange(3) == axis, side, 0.5) * size)
    expected = -pressure * np.delete(size, axis).prod() * outward
    force, moment = resultant(space, forces, about)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(moment, np.cross(centre - about, expected), rtol=0, atol=1e-11)


@given(bent_patches(highest=2), PRESSURES.filter(lambda p: abs(p) > 0.1))
def test_a_pressure_all_around_a_body_balances_whatever_its_shape(patch, pressure):
    space, forces = forces_of(model_of(patch), *[{"on": f"bent/{side}", "pressure": pressure} for side in SIDES])
    assert_balanced(forces, space.control_points)


def test_a_pressure_inside_a_cylinder_pushes_its_projected_area():
    ring = hollow_cylinder(inner=1.5, outer=2.0, height=3.0)
    _, forces = forces_of(model_of(ring), {"on": "ring/left", "pressure": 2.0})
    np.testing.assert_allclose(forces.sum(axis=0), [2 * 1.5 * 3, 2 * 1.5 * 3, 0], rtol=0, atol=1e-11)


@given(bent_patches(), st.sampled_from(SIDES), VECTORS)
def test_a_traction_is_a_force_per_area_of_fixed_direction(patch, side, traction):
    model = model_of(patch)
    space, forces = forces_of(model, {"on": f"bent/{side}", "traction": traction})
    (face,) = model.faces(f"bent/{side}")
    surface = surface_of(model, face)
    points = gauss_points(surface.patch, [space.point_counts["bent"][axis] for axis in face.axes])
    area = points.weights @ area_vectors(surface, points.xi)[2]
    np.testing.assert_allclose(forces.sum(axis=0), np.array(traction) * area, rtol=0, atol=1e-12)


@given(bent_patches(rational=False), VECTORS)
def test_a_body_force_is_a_force_per_volume_of_the_named_body(patch, force):
    model = model_of(block_patch("other"), patch)
    entry = BodyForce(bodies=("bent",), force=force)
    space, forces = forces_of(model, body_force=[entry])
    volume = sum(part.volume.sum() for part in volume_quadrature(patch))
    np.testing.assert_allclose(forces.sum(axis=0), np.array(force) * volume, rtol=0, atol=1e-12)
    assert not forces[space.body_numbers("other")].any()


@given(rotations(), VECTORS)
def test_a_body_force_without_names_acts_on_all_bodies_at_their_centres(turn, force):
    size = np.array([1.0, 2, 3])
    patches = [block_patch(name, size=size, degree=degree, turn=turn) for name, degree in (("one", 1), ("two", 3))]
    space, forces = forces_of(model_of(*patches), body_force=[BodyForce(force=force)])
    for name in ("one", "two"):
        of_body = np.zeros_like(forces)
        of_body[space.body_numbers(name)] = forces[space.body_numbers(name)]
        total, moment = resultant(space, of_body, turn.apply(size / 2))
        np.testing.assert_allclose(total, 6 * np.array(force), rtol=0, atol=1e-12)
        np.testing.assert_allclose(moment, 0, rtol=0, atol=1e-11)


def test_a_body_force_acts_on_every_patch_of_a_body():
    one, two = block_patch("one"), block_patch("two", origin=(1, 0, 0), degree=2)
    model = Model({"one": one, "two": two}, {"pair": ("one", "two")}, {})
    _, forces = forces_of(model, body_force=[BodyForce(force=(1.0, 2.0, 3.0), bodies=("pair",))])
    np.testing.assert_allclose(forces.sum(axis=0), [2, 4, 6], rtol=0, atol=1e-13)


def test_loads_add_up():
    model = model_of(block_patch(degree=2))
    loads = [{"on": "block/top", "pressure": 1.0}, {"on": "block/top", "traction": (1.0, 2.0, 3.0)}]
    gravity = [BodyForce(force=(0.0, 0.0, -1.0)), BodyForce(force=(1.0, 0.0, 0.0), bodies=("block",))]
    _, together = forces_of(model, *loads, body_force=gravity)
    alone = [forces_of(model, load)[1] for load in loads]
    alone += [forces_of(model, body_force=[entry])[1] for entry in gravity]
    np.testing.assert_allclose(together, sum(alone), rtol=0, atol=1e-15)


@given(st.data(), rotations(), st.sampled_from(["upper/bottom", "lower/top"]), st.sampled_from(["segment", "element"]))
def test_an_exposed_load_acts_on_the_part_of_the_face_that_the_partner_leaves_open(data, turn, face, integration):
    straight = data.draw(stacked_blocks(overhang=integration == "segment"))  # else no Gauss point may lie opposite
    model = model_of(*(turned(patch, turn) for patch in straight.patches.values()))
    sides = {name: outline(straight, name) for name in ("upper/bottom", "lower/top")}
    open_part = sides[face].difference(sides["lower/top" if face == "upper/bottom" else "upper/bottom"])
    contact = CONTACT.model_copy(update={"integration": integration})
    load = {"on": face, "pressure": 2.0, "exposed": True}
    space, forces = forces_of(model, load, contacts=[contact])
    centre = [*open_part.centroid.coords[0], 1] if open_part.area > 1e-9 else [0, 0, 1]
    direction = np.array([0, 0, 1.0 if face == "upper/bottom" else -1.0])
    force, moment = resultant(space, forces, turn.apply(centre))
    np.testing.assert_allclose(force, turn.apply(2 * open_part.area * direction), rtol=0, atol=1e-11)
    np.testing.assert_allclose(moment, 0, rtol=0, atol=1e-9)


@given(stacked_blocks(), VECTORS)
def test_an_exposed_traction_too(model, traction):
    _, forces = forces_of(model, {"on": "lower/top", "traction": traction, "exposed": True}, contacts=[CONTACT])
    area = outline(model, "lower/top").difference(outline(model, "upper/bottom")).area
    np.testing.assert_allclose(forces.sum(axis=0), np.array(traction) * area, rtol=0, atol=1e-11)


@given(stacked_blocks())
def test_exposed_and_covered_part_make_up_the_whole_face_function_by_function(model):
    """What an exposed pressure leaves out is what a uniform contact pressure puts on the face."""
    space, exposed = forces_of(model, {"on": "lower/top", "pressure": 1.0, "exposed": True}, contacts=[CONTACT])
    _, whole = forces_of(model, {"on": "lower/top", "pressure": 1.0})
    operator = assemble_mortar(space, CONTACT, find_cells(model, CONTACT)).gap_operator
    contact = (operator.T @ np.ones(operator.shape[0])).reshape(-1, 3)
    lower = space.body_numbers("lower")
    np.testing.assert_allclose((exposed + contact)[lower], whole[lower], rtol=0, atol=1e-12)


def test_nothing_is_left_of_an_exposed_load_where_rings_cover_each_other():
    """Segment cells cut it out whatever the contact integrates, along curved knot lines, too."""
    model = model_of(hollow_cylinder(name="low"), moved(hollow_cylinder(name="high"), (0, 0, 1)))
    contact = Contact(secondary="high/bottom", primary="low/top", integration="element")
    _, forces = forces_of(model, {"on": "low/top", "pressure": 1.0, "exposed": True}, contacts=[contact])
    np.testing.assert_allclose(forces, 0, rtol=0, atol=1e-12)


def test_every_partner_covers_its_part_of_a_face():
    model = model_of(block_patch("lower", size=(3, 1, 1)), block_patch("one", (0, 0, 1)), block_patch("two", (2, 0, 1)))
    contacts = [Contact(secondary=f"{name}/bottom", primary="lower/top") for name in ("one", "two")]
    space, forces = forces_of(model, {"on": "lower/top", "pressure": 1.0, "exposed": True}, contacts=contacts)
    force, moment = resultant(space, forces, (1.5, 0.5, 1))
    np.testing.assert_allclose(force, [0, 0, -1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(moment, 0, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("load", "body_force", "names"),
    [
        ({"on": "lower/tap", "pressure": 1.0}, [], ["solve.load[0]", '"lower/tap"', 'did you mean "lower/top"']),
        ({"on": "lower/left", "pressure": 1.0, "exposed": True}, [], ["solve.load[0]", '"lower/left"', "no contact"]),
        (
            {"on": "lower/top", "pressure": 1.0},
            [BodyForce(force=(0.0, 0.0, 1.0), bodies=("lowr",))],
            ["solve.body_force[0].bodies", '"lowr"', 'did you mean "lower"'],
        ),
    ],
)
def test_a_load_that_does_not_fit_the_model_is_named(load, body_force, names):
    model = model_of(block_patch("lower"), block_patch("upper", (0, 0, 1)))
    with pytest.raises(CaseError) as error:
        forces_of(model, load, body_force=body_force, contacts=[CONTACT])
    assert all(name in str(error.value) for name in names)


def test_a_pressure_on_several_glued_faces_is_that_on_the_whole():
    space, forces = forces_of(glued_model({"wall": wall("w", degree=2)}), {"on": "wall/top", "pressure": 2.0})
    force, moment = resultant(space, forces, (0.5, 0.5, 1))
    np.testing.assert_allclose(force, [0, 0, -2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(moment, 0, rtol=0, atol=1e-14)


def glued_pair():
    """A block of four patches on another; "corner" is one of the lower top faces."""
    lower, upper = wall("l", size=(2, 2, 1), degree=2), wall("u", (0.5, 0.25, 1), degree=1)
    model = glued_model({"lower": lower, "upper": upper})
    groups = {**model.groups, "corner": (Face("l000", 2, 1),)}
    return Model(model.patches, model.bodies, groups, model.glued)


def test_an_exposed_load_on_one_of_the_faces_in_contact_leaves_out_what_is_covered_of_it():
    load = {"on": "corner", "pressure": 1.0, "exposed": True}
    _, forces = forces_of(glued_pair(), load, contacts=[CONTACT])
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, -(1 - 0.5 * 0.75)], rtol=0, atol=1e-13)


@pytest.mark.parametrize("integration", ["segment", "element"])
def test_what_several_faces_cover_counts_once_even_with_either_side_secondary_in_turn(integration):
    contact = CONTACT.model_copy(update={"integration": integration})
    back = contact.model_copy(update={"secondary": "lower/top", "primary": "upper/bottom"})
    load = {"on": "lower/top", "pressure": 1.0, "exposed": True}
    for contacts in ([contact], [back], [contact, back]):
        _, forces = forces_of(glued_pair(), load, contacts=contacts)
        np.testing.assert_allclose(forces.sum(axis=0), [0, 0, -(4 - 1)], rtol=0, atol=1e-13)


def test_cells_that_several_exposed_loads_need_are_cut_once(monkeypatch):
    calls = []
    monkeypatch.setattr(load_module, "find_cells", lambda *given: calls.append(given) or find_cells(*given))
    contact = CONTACT.model_copy(update={"integration": "element"})
    exposed = [{"on": face, "pressure": 1.0, "exposed": True} for face in ("lower/top", "upper/bottom")]
    forces_of(glued_pair(), *exposed, contacts=[contact])
    assert len(calls) == 1
