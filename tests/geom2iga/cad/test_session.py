import signal
from threading import Thread

import gmsh
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import geom2iga
from geom2iga import build
from geom2iga.bspline import open_knots
from geom2iga.build import build_from_gmsh
from geom2iga.cad import session
from geom2iga.case import GeometryCase
from geom2iga.errors import CaseError, GeometryError
from geom2iga.model import SIDES
from geom2iga.patch import Patch, evaluate
from geom2iga.tables import checked
from tests.cases import UNIT
from tests.oracles import assert_same_map, assert_same_model
from tests.strategies import SEEDS, graded_breaks, open_knot_vectors

SIZES = st.tuples(*[st.floats(1e-3, 1e3)] * 3)
PLACES = st.tuples(*[st.floats(-100, 100)] * 3)


@pytest.fixture
def gmsh_session():
    """A gmsh that the user of the library has opened."""
    start_gmsh()
    yield gmsh
    gmsh.finalize()


def start_gmsh():
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)


def case_of(**body):
    return {"geometry": {"block": [{"name": "cube", **body}]}}


def corners(patch):
    """Corners (2, 2, 2, 3) of a patch."""
    return patch.control_points[np.ix_([0, -1], [0, -1], [0, -1])]


def volume(patch):
    """Volume by Gauss quadrature, exact for a map of the patch's degrees."""
    points, weights = [], []
    for at, degree in zip(patch.breaks, patch.degrees, strict=True):
        nodes, shares = np.polynomial.legendre.leggauss(2 * degree)
        half = np.diff(at)[:, None] / 2
        points.append((at[:-1, None] + half * (1 + nodes)).ravel())
        weights.append((half * shares).ravel())
    xi = np.stack(np.meshgrid(*points, indexing="ij"), axis=-1).reshape(-1, 3)
    jacobians = np.linalg.det(evaluate(patch, xi, 1)[1])
    assert jacobians.min() > 0
    return np.einsum("i,j,k->ijk", *weights).ravel() @ jacobians


def turned_block(size, origin, rotate):
    """Corners (2, 2, 2, 3) that a block should have."""
    upright = np.array(origin) + UNIT * np.array(size)
    turn = Rotation.from_rotvec(np.array(rotate["axis"]) / np.linalg.norm(rotate["axis"]) * np.radians(rotate["angle"]))
    about = np.array(rotate.get("about", np.array(origin) + np.array(size) / 2))
    return about + turn.apply((upright - about).reshape(-1, 3)).reshape(2, 2, 2, 3)


@st.composite
def turns(draw):
    """Rotations of a block, about its centre or any other point."""
    axis = np.random.default_rng(draw(SEEDS)).normal(size=3)
    special = st.sampled_from([[0.0, 0.0, 1.0], [0.0, -2.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])
    turn = {"axis": draw(special | st.just(axis.tolist()))}
    turn["angle"] = draw(st.sampled_from([0.0, 45.0, 90.0, 180.0, -120.0, 765.0]) | st.floats(-360, 360))
    return turn | draw(st.just({}) | st.builds(dict, about=PLACES))


@given(SIZES, PLACES)
def test_a_block_has_exactly_the_corners_asked_for(size, origin):
    patch = build(case_of(size=size, origin=origin)).patches["cube"]
    expected = np.array(origin) + UNIT * np.array(size)
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * abs(expected).max())


@given(SIZES, PLACES, turns())
def test_a_turned_block_has_its_corners_and_keeps_its_sides(size, origin, rotate):
    model = build(case_of(size=size, origin=origin, rotate=rotate))
    expected = turned_block(size, origin, rotate)
    reach = max(abs(expected).max(), max(size), *np.abs(origin), *np.abs(rotate.get("about", [0])))
    np.testing.assert_allclose(corners(model.patches["cube"]), expected, rtol=0, atol=1e-14 * reach)
    for number, side in enumerate(SIDES):
        (face,) = model.faces(f"cube/{side}")
        border = model.surface(face).control_points.reshape(-1, 3)
        there = np.take(expected, number % 2, axis=number // 2).reshape(-1, 3)
        np.testing.assert_allclose(border, there, rtol=0, atol=1e-14 * reach)


@given(SIZES, turns(), st.tuples(*[st.integers(1, 3)] * 3))
def test_a_block_is_right_handed_and_has_its_volume(size, rotate, degree):
    patch = build(case_of(size=size, rotate=rotate, degree=degree, spans=[1, 2, 1])).patches["cube"]
    assert volume(patch) == pytest.approx(np.prod(size), rel=1e-10)


@given(st.tuples(*[open_knot_vectors(highest=3)] * 3), turns())
def test_a_block_has_the_knots_asked_for_and_its_map_is_affine(splines, rotate):
    knots, degree = zip(*splines, strict=True)
    size = (2.0, 1.0, 3.0)
    model = build(case_of(size=size, degree=degree, knots=[k.tolist() for k in knots], rotate=rotate))
    patch = model.patches["cube"]
    assert patch.degrees == degree
    for found, asked in zip(patch.knots, knots, strict=True):
        np.testing.assert_array_equal(found, asked)
    ends = tuple(np.repeat(k[[0, -1]], 2) for k in knots)
    straight = Patch("cube", (1, 1, 1), ends, turned_block(size, (0, 0, 0), rotate))
    assert_same_map(patch, straight, tolerance=1e-12)
    np.testing.assert_allclose(patch.weights, 1, rtol=1e-12)


@given(st.tuples(*[graded_breaks()] * 3), st.tuples(*[st.integers(1, 3)] * 3))
def test_a_block_has_the_breaks_asked_for(at, degree):
    at = [[0.0, *direction[1:-1].tolist(), 1.0] for direction in at]
    patch = build(case_of(size=[1, 1, 1], degree=degree, breaks=at)).patches["cube"]
    for knots, direction, p in zip(patch.knots, at, degree, strict=True):
        np.testing.assert_array_equal(knots, open_knots(direction, p))


def test_every_block_has_its_own_degree_and_spans():
    blocks = [
        {"name": "one", "size": [1, 1, 1], "spans": [3, 1, 2]},
        {"name": "two", "size": [1, 1, 1], "degree": [1, 3, 2]},
    ]
    model = build({"geometry": {"degree": 2, "block": blocks}})
    assert model.patches["one"].degrees == (2, 2, 2)
    assert model.patches["one"].shape == (5, 3, 4)
    assert model.patches["two"].degrees == (1, 3, 2)
    assert model.patches["two"].shape == (2, 4, 3)
    assert dict(model.bodies) == {"one": ("one",), "two": ("two",)}
    assert list(model.groups) == [f"{name}/{side}" for name in ("one", "two") for side in SIDES]


def test_a_small_block_far_away_is_built_too():
    """Rounding moves its corners by more than a fraction of its size."""
    rotate = {"axis": [1, 2, 3], "angle": 33.0}
    patch = build(case_of(size=[1, 1, 1], origin=[1e7, 1e7, 1e7], rotate=rotate)).patches["cube"]
    np.testing.assert_allclose(corners(patch), turned_block((1, 1, 1), (1e7,) * 3, rotate), rtol=1e-14)


def test_a_case_may_come_as_path_dict_case_or_checked_case(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text('[[geometry.block]]\nname = "cube"\nsize = [1, 2, 3]\n')
    expected = build(case_of(size=[1, 2, 3]))
    for source in (path, str(path), geom2iga.read_case(path), checked(path, GeometryCase)):
        assert_same_model(build(source), expected)


def test_the_wrong_thing_for_a_case_is_refused():
    with pytest.raises(CaseError, match="size"):
        build(case_of())


def test_gmsh_is_closed_after_a_build():
    build(case_of(size=[1, 1, 1]))
    assert not gmsh.isInitialized()


def state_of_gmsh():
    """What a user would miss."""
    return (
        sorted(gmsh.model.list()),
        gmsh.model.getCurrent(),
        gmsh.model.getEntities(),
        [gmsh.model.getBoundingBox(*entity) for entity in gmsh.model.getEntities(3)],
        gmsh.option.getString("Geometry.OCCTargetUnit"),
        gmsh.option.getNumber("General.Terminal"),
    )


@pytest.mark.parametrize("current", ["first", "second", "geom2iga"])
def test_a_running_gmsh_keeps_its_models_and_options(gmsh_session, current):
    for size, name in enumerate(("first", "second", "geom2iga"), 1):
        gmsh.model.add(name)
        gmsh.model.occ.addBox(0, 0, 0, size, size, size)
        gmsh.model.occ.synchronize()
    gmsh.model.setCurrent(current)
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    before = state_of_gmsh()
    build(case_of(size=[1, 1, 1]))
    assert state_of_gmsh() == before
    with pytest.raises(GeometryError, match="nearer to the zero point"):
        build(case_of(size=[1, 1, 1], origin=[1e12, 0, 0]))
    assert state_of_gmsh() == before


def test_a_model_can_be_built_in_a_thread_and_ctrl_c_stays_with_python():
    before = signal.getsignal(signal.SIGINT)
    models = []
    thread = Thread(target=lambda: models.append(build(case_of(size=[1, 1, 1]))))
    thread.start()
    thread.join()
    assert len(models) == 1
    build(case_of(size=[1, 1, 1]))
    assert signal.getsignal(signal.SIGINT) is before


def test_building_twice_gives_the_same_bit_for_bit():
    case = case_of(size=[1, 2, 3], degree=2, spans=[2, 3, 1], rotate={"axis": [1, 2, 3], "angle": 45.0})
    assert_same_model(build(case), build(case))


def test_the_model_that_is_open_in_gmsh_stays_as_it_is(gmsh_session):
    gmsh.model.add("users")
    gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
    gmsh.model.occ.synchronize()
    gmsh.model.setEntityName(3, 1, 'a <b> & "c"')
    gmsh.model.setEntityName(2, 4, "2:6")
    gmsh.model.addPhysicalGroup(2, [5], name="base")
    before = (*state_of_gmsh(), names_of_entities(), gmsh.model.getPhysicalGroups())
    model = build_from_gmsh(name="body")
    assert (*state_of_gmsh(), names_of_entities(), gmsh.model.getPhysicalGroups()) == before
    assert model.faces("base") == model.faces("body/bottom")


def names_of_entities():
    """Names that the user gave."""
    return {entity: gmsh.model.getEntityName(*entity) for entity in gmsh.model.getEntities()}


def test_the_boundary_knows_every_entity_by_dimension_and_tag_alone(gmsh_session):
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.addBox(1, 0, 0, 1, 1, 1, tag=7)
    gmsh.model.occ.fragment([(3, 1)], [(3, 7)])
    gmsh.model.occ.synchronize()
    gmsh.model.setEntityName(3, 1, "]]> <solid>")
    text = session.boundary()
    assert all(f'name="{dimension}:{tag}"' in text for dimension, tag in gmsh.model.getEntities())
    assert "<solid>" not in text
    assert gmsh.model.getEntityName(3, 1) == "]]> <solid>"


def test_an_empty_model_is_told_so(gmsh_session):
    gmsh.model.add("empty")
    with pytest.raises(GeometryError, match=r"no volume.*make solids"):
        build_from_gmsh(name="body")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"nme": "body"}, r'"nme".*did you mean "name"'),
        ({"name": "body", "file": "box.step"}, '"file"'),
        ({}, "give the bodies names"),
    ],
)
def test_wrong_keys_for_the_open_model_are_reported(gmsh_session, keys, message):
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    with pytest.raises(CaseError, match=message):
        build_from_gmsh(**keys)
