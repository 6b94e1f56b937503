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


def written(path, make):
    """Make a shape with gmsh's OpenCASCADE and write it to a CAD file."""
    start_gmsh()
    try:
        make(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def case_of(**body):
    return {"geometry": {"block": [{"name": "cube", **body}]}}


def cad_case(path, **body):
    return {"geometry": {"cad": [{"name": "punch", "file": str(path), **body}]}}


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


def test_a_block_too_small_for_opencascade_is_reported():
    with pytest.raises(GeometryError, match=r'"cube".*1e-08.*1e-7.*unit'):
        build(case_of(size=[1, 1, 1e-8]))


def test_a_case_may_come_as_path_dict_case_or_checked_case(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text('[[geometry.block]]\nname = "cube"\nsize = [1, 2, 3]\n')
    expected = build(case_of(size=[1, 2, 3]))
    for source in (path, str(path), geom2iga.read_case(path), checked(path, GeometryCase)):
        assert_same_model(build(source), expected)


def test_the_wrong_thing_for_a_case_is_refused():
    with pytest.raises(CaseError, match="size"):
        build(case_of())


@pytest.mark.parametrize("name", ["box.step", "box.stp", "BOX.STEP", "box.brep", "ein Würfel.brep"])
def test_a_box_keeps_its_size_through_a_cad_file(tmp_path, name):
    written_as = "box.brep" if name.endswith(".brep") else "box.step"  # gmsh knows fewer endings than users
    path = written(tmp_path / written_as, lambda occ: occ.addBox(-1, 0.5, 3, 2, 4, 0.25))
    path = path.rename(tmp_path / name)
    model = build(cad_case(path, degree=2, spans=[2, 1, 3]))
    patch = model.patches["punch"]
    expected = np.array([-1, 0.5, 3]) + UNIT * [2, 4, 0.25]
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * 4)
    assert patch.degrees == (2, 2, 2)
    assert patch.shape == (4, 3, 5)
    assert list(model.groups) == [f"punch/{side}" for side in SIDES]


def test_a_file_is_looked_for_beside_its_case(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    written(tmp_path / "parts" / "box.brep", lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
    path = tmp_path / "case.toml"
    path.write_text('[[geometry.cad]]\nname = "punch"\nfile = "parts/box.brep"\n')
    build(path)
    monkeypatch.chdir(tmp_path / "parts")
    build(cad_case("box.brep"))


@given(st.floats(0.1, 4), st.floats(0.1, 2), st.floats(0.1, 3))
def test_a_wedge_with_a_narrow_top_becomes_a_patch(tmp_path_factory, long, narrow, height):
    """gmsh's wedge: x is `long` wide at y = 0 and `narrow` at y = height."""
    path = tmp_path_factory.getbasetemp() / "wedge.brep"
    written(path, lambda occ: occ.addWedge(0, 0, 0, long, height, 1, ltx=narrow))
    patch = build(cad_case(path, degree=2)).patches["punch"]
    expected = UNIT * [1, height, 1]
    expected[..., 0] *= np.array([long, narrow])[None, :, None]
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * 4)
    assert volume(patch) == pytest.approx((long + narrow) / 2 * height, rel=1e-12)


@given(SEEDS)
def test_any_convex_hexahedron_becomes_a_right_handed_patch(tmp_path_factory, seed):
    """A projective image of the unit cube: its faces stay plane, no two stay parallel."""
    random = np.random.default_rng(seed)
    linear, tilt = np.eye(3) + random.uniform(-0.2, 0.2, (3, 3)), random.uniform(-0.2, 0.2, 3)
    expected = UNIT @ linear.T / (1 + UNIT @ tilt)[..., None]
    path = tmp_path_factory.getbasetemp() / "hexahedron.brep"
    patch = build(cad_case(written(path, lambda occ: add_hexahedron(occ, expected)))).patches["punch"]
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * 4)
    assert volume(patch) > 0


def add_hexahedron(occ, points):
    """Build a volume with plane faces from eight corners (2, 2, 2, 3)."""
    tags = np.array([occ.addPoint(*point) for point in points.reshape(-1, 3)]).reshape(2, 2, 2)
    lines = {}
    for axis in range(3):
        for start, end in np.moveaxis(tags, axis, -1).reshape(-1, 2).tolist():
            lines[start, end] = lines[end, start] = occ.addLine(start, end)
    faces = []
    for axis in range(3):
        for side in range(2):
            (a, b), (d, c) = np.take(tags, side, axis=axis).tolist()
            loop = occ.addCurveLoop([lines[a, b], lines[b, c], lines[c, d], lines[d, a]])
            faces.append(occ.addPlaneSurface([loop]))
    occ.addVolume([occ.addSurfaceLoop(faces, sewing=True)])


def cylinder(occ):
    occ.addCylinder(0, 0, 0, 0, 0, 2, 1)


def sphere(occ):
    occ.addSphere(0, 0, 0, 1)


def torus(occ):
    occ.addTorus(0, 0, 0, 2, 0.5)


def sharp_wedge(occ):
    occ.addWedge(0, 0, 0, 2, 1, 1, ltx=0)


def box_with_a_hole(occ):
    occ.cut([(3, occ.addBox(0, 0, 0, 2, 2, 2))], [(3, occ.addCylinder(1, 1, -1, 0, 0, 4, 0.5))])


def box_with_a_fillet(occ):
    box = occ.addBox(0, 0, 0, 2, 2, 2)
    occ.synchronize()
    occ.fillet([box], [1], [0.3])


def quarter_ring(occ):
    occ.revolve([(2, occ.addRectangle(1, 0, 0, 1, 1))], 0, 0, 0, 0, 1, 0, np.pi / 2)


def extrude(occ, corners):
    points = [occ.addPoint(x, y, 0) for x, y in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0, 0, 1)


def five_sided_prism(occ):
    extrude(occ, [(0, 0), (1, 0), (1, 1), (0.5, 1.5), (0, 1)])


def arrowhead(occ):
    extrude(occ, [(0, 0), (2, -1), (0.5, 0), (2, 1)])


def two_boxes(occ):
    occ.addBox(0, 0, 0, 1, 1, 1)
    occ.addBox(2, 0, 0, 1, 1, 1)


def rectangle(occ):
    occ.addRectangle(0, 0, 0, 1, 1)


def pyramid_on_a_pentagon(occ):
    apex = occ.addPoint(0, 0, 1)
    base = [occ.addPoint(np.cos(t), np.sin(t), 0) for t in 2 * np.pi * np.arange(5) / 5]
    ring = [occ.addLine(a, b) for a, b in zip(base, base[1:] + base[:1], strict=True)]
    rising = [occ.addLine(point, apex) for point in base]
    loops = [ring, *([ring[i], rising[(i + 1) % 5], rising[i]] for i in range(5))]
    faces = [occ.addPlaneSurface([occ.addCurveLoop(loop)]) for loop in loops]
    occ.addVolume([occ.addSurfaceLoop(faces, sewing=True)])


@pytest.mark.parametrize("suffix", [".step", ".brep"])
@pytest.mark.parametrize(
    ("make", "entity", "found", "advice"),
    [
        (cylinder, "volume 1", "3 faces", "split"),
        (sphere, "volume 1", "1 face", "split"),
        (torus, "volume 1", "1 face", "split"),
        (sharp_wedge, "volume 1", "5 faces", "split"),
        (box_with_a_hole, "volume 1", "7 faces", "split"),
        (box_with_a_fillet, "volume 1", "7 faces", "split"),
        (five_sided_prism, "volume 1", "7 faces", "split"),
        (quarter_ring, "volume 1: face", "cylinder", "plane faces"),
        (pyramid_on_a_pentagon, "volume 1: face", "edges", "six plane faces"),
        (arrowhead, "volume 1", "re-entrant", "convex"),
        (two_boxes, "part", "2 volumes", "save each"),
        (rectangle, "part", "0 volumes", "save each"),
    ],
)
def test_a_shape_that_is_no_block_is_reported_with_its_entity_and_advice(tmp_path, make, entity, found, advice, suffix):
    path = written(tmp_path / f"part{suffix}", make)
    with pytest.raises(GeometryError) as error:
        build(cad_case(path))
    assert error.value.exit_code == 3
    text = str(error.value)
    assert text.startswith('body "punch"')
    assert all(part in text for part in (entity, found, advice)), text
    assert not gmsh.isInitialized()


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("text.step", "hello\n", "save it anew"),
        ("empty.stp", "", "save it anew"),
        ("text.brep", "hello\n", "save each"),
        ("box.geo", 'SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 1, 1, 1};\n', "STEP and BREP"),
        ("box.iges", "", "STEP and BREP"),
        ("box", "", "STEP and BREP"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_advice(tmp_path, name, content, advice):
    (tmp_path / name).write_text(content)
    with pytest.raises(GeometryError) as error:
        build(cad_case(tmp_path / name))
    assert error.value.exit_code == 3
    text = str(error.value)
    assert text.startswith('body "punch"')
    assert name in text
    assert advice in text
    assert not gmsh.isInitialized()


def test_a_missing_file_is_a_wrong_case(tmp_path):
    with pytest.raises(CaseError, match=r"missing\.step.*no such file"):
        build(cad_case(tmp_path / "missing.step"))


def test_what_opencascade_says_about_a_file_does_not_go_to_standard_output(tmp_path, capfd):
    (tmp_path / "text.step").write_text("hello\n")
    with pytest.raises(GeometryError):
        build(cad_case(tmp_path / "text.step"))
    assert capfd.readouterr().out == ""


def test_a_geo_file_is_not_run(tmp_path):
    (tmp_path / "box.geo").write_text(f'SystemCall "touch {tmp_path / "trace"}";\n')
    with pytest.raises(GeometryError):
        build(cad_case(tmp_path / "box.geo"))
    assert not (tmp_path / "trace").exists()


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
def test_a_running_gmsh_keeps_its_models_and_options(gmsh_session, tmp_path, current):
    for size, name in enumerate(("first", "second", "geom2iga"), 1):
        gmsh.model.add(name)
        gmsh.model.occ.addBox(0, 0, 0, size, size, size)
        gmsh.model.occ.synchronize()
    gmsh.model.setCurrent(current)
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    before = state_of_gmsh()
    build(case_of(size=[1, 1, 1]))
    assert state_of_gmsh() == before
    (tmp_path / "text.step").write_text("hello\n")
    with pytest.raises(GeometryError):
        build(cad_case(tmp_path / "text.step"))
    assert state_of_gmsh() == before


def test_an_import_in_metres_before_does_not_shrink_later_ones(tmp_path):
    """OpenCASCADE remembers the last unit as long as the process lives."""
    path = written(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 2, 2, 2))
    start_gmsh()
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    gmsh.model.occ.importShapes(str(path))
    gmsh.model.occ.synchronize()
    assert gmsh.model.getBoundingBox(-1, -1)[3] < 0.01
    gmsh.finalize()
    np.testing.assert_allclose(corners(build(cad_case(path)).patches["punch"]), 2 * UNIT, rtol=0, atol=1e-14)


def test_a_failed_import_does_not_spoil_the_next_one(tmp_path):
    good = written(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
    (tmp_path / "text.step").write_text("hello\n")
    with pytest.raises(GeometryError):
        build(cad_case(tmp_path / "text.step"))
    np.testing.assert_allclose(corners(build(cad_case(good)).patches["punch"]), UNIT, rtol=0, atol=1e-14)


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
