from math import pi

import gmsh
import numpy as np
import pytest

from geom2iga import build, build_from_gmsh
from geom2iga.errors import CaseError, GeometryError
from geom2iga.exchange.gismo import write_gismo
from geom2iga.model import SIDES, Model
from geom2iga.patch import evaluate
from tests.cases import block_patch, model_of
from tests.geom2iga.exchange.scrambled import RING, scrambled_model
from tests.geom2iga.test_selectors import open_gmsh
from tests.oracles import assert_same_map, assert_same_model

PROFILE = [[1, 0], [2, 0], [2, 1], [1, 1]]
BODIES = {  # patches, degrees that the shape needs, names of faces, volume
    "block": ({"size": [1, 2, 3]}, 1, (1, 1, 1), SIDES, 6),
    "cylinder": ({"radius": 1.0, "height": 2.0}, 5, (2, 2, 1), ("side", "bottom", "top"), 2 * pi),
    "pipe": ({"inner": 1.0, "outer": 2.0, "height": 1.0}, 4, (1, 2, 1), ("inner", "outer", "bottom", "top"), 3 * pi),
    "sphere": ({"radius": 1.0}, 7, None, ("outside",), 4 * pi / 3),
    "hemisphere": ({"radius": 1.0, "height": 0.5}, 11, None, ("outside", "flat", "side"), 2 * pi / 3 + pi / 2),
    "domed_block": (
        {"size": [2.0, 2.0, 3.0], "radius": 5.0, "bottom": "paraboloid"},
        1,
        (2, 2, 1),
        SIDES,
        12 - 4 * 2 / 3 / 10,
    ),
    "extrusion": ({"points": PROFILE, "vector": [1, 0, 2]}, 1, (1, 1, 1), SIDES, 2),
    "revolution": ({"points": PROFILE, "angle": 90.0}, 1, (1, 2, 1), None, 0.75 * pi),
}
KINDS = list(BODIES)
QUICK = [pytest.param(kind, marks=[pytest.mark.slow] * (BODIES[kind][1] > 4)) for kind in KINDS]


def model_with(kind, **keys):
    """A model of one body."""
    return build({"geometry": {kind: [BODIES[kind][0] | {"name": "body"} | keys]}})


def total_volume(model):
    """Volume of all patches [length³]."""
    return sum(certificate.volume for certificate in model.certificates.values())


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_body_is_built_whole(kind):
    _, count, degrees, names, expected = BODIES[kind]
    model = model_with(kind)
    assert list(model.bodies) == ["body"]
    assert len(model.patches) == count
    assert total_volume(model) == pytest.approx(expected, rel=1e-11)
    if names is not None:
        assert set(model.groups) == {f"body/{name}" for name in names}
    if degrees is not None:
        each = {patch.degrees for patch in model.patches.values()}
        assert tuple(np.max(list(each), axis=0)) == degrees


@pytest.mark.parametrize("kind", QUICK)
def test_every_kind_of_body_takes_degree_and_spans(kind):
    coarse, fine = model_with(kind), model_with(kind, degree=3, spans=[2, 3, 2])
    assert list(fine.patches) == list(coarse.patches)
    assert set(fine.groups) == set(coarse.groups)
    for name, patch in fine.patches.items():
        assert min(patch.degrees) >= 3
        assert all(len(at) > 2 for at in patch.breaks)
        assert_same_map(patch, coarse.patches[name], 1e-12)
    if len(fine.patches) == 1:
        assert [len(at) - 1 for at in next(iter(fine.patches.values())).breaks] == [2, 3, 2]


@pytest.mark.parametrize("kind", QUICK)
def test_every_kind_of_body_is_built_where_it_is_placed(kind):
    """Turned by 180 degrees about a line through the origin of space, twice, it is where it was."""
    turn = {"axis": [1, 2, 3], "angle": 180.0, "about": [0, 0, 0]}
    there = model_with(kind, origin=[4.0, 5.0, 6.0], rotate=turn)
    here = model_with(kind)
    axis = np.array([1, 2, 3]) / 14**0.5
    xi = np.random.default_rng(0).random((20, 3))
    for name in ("body",) if len(here.patches) == 1 else list(here.patches)[:3]:
        points = evaluate(here.patches[name], xi)[0] + [4, 5, 6]
        expected = 2 * np.outer(points @ axis, axis) - points
        np.testing.assert_allclose(evaluate(there.patches[name], xi)[0], expected, rtol=0, atol=1e-12)


def test_the_degree_of_the_case_is_for_bodies_that_give_none():
    bodies = {"block": [{"name": "a", "size": [1, 1, 1], "degree": 3}], "pipe": [BODIES["pipe"][0] | {"name": "b"}]}
    model = build({"geometry": {"degree": [2, 2, 5]} | bodies})
    assert model.patches["a"].degrees == (3, 3, 3)
    assert {patch.degrees for name, patch in model.patches.items() if name != "a"} == {(2, 2, 5)}


def test_bodies_of_all_kinds_stand_in_one_model_in_the_sequence_of_their_kinds():
    tables = {kind: [BODIES[kind][0] | {"name": kind}] for kind in ("revolution", "pipe", "block")}
    model = build({"geometry": tables})
    assert list(model.bodies) == ["block", "pipe", "revolution"]
    assert set(model.certificates) == set(model.patches)


def test_bodies_that_touch_are_not_glued():
    blocks = [{"name": f"block{n}", "size": [1, 1, 1], "origin": [0, 0, n]} for n in range(2)]
    assert build({"geometry": {"block": blocks}}).glued == ()


EVERYTHING = {
    "geometry": {
        "degree": 2,
        "block": [{"name": "block", "size": [1, 2, 3], "span_size": 0.6, "grading": {"toward": "top", "ratio": 3}}],
        "cylinder": [{"name": "rod", "radius": 1.0, "height": 2.0, "angle": 200.0, "spans": 2}],
        "domed_block": [
            {"name": "punch", "size": [1, 1, 1], "radius": 2.0, "faces": [{"name": "round", "sphere": 2.0}]}
        ],
    }
}


def test_the_same_case_gives_the_same_model_to_the_last_bit():
    one, other = build(EVERYTHING), build(EVERYTHING)
    assert_same_model(other, one)
    assert dict(other.certificates) == dict(one.certificates)


@pytest.mark.parametrize(
    ("kind", "changes", "error"),
    [
        ("block", {"grading": {"toward": "tpo", "ratio": 2}}, CaseError),
        ("pipe", {"grading": [{"toward": "inner", "ratio": 2}, {"toward": "inner", "ratio": 3}]}, CaseError),
        ("import", {"file": "nowhere.xml"}, CaseError),
        ("cad", {"file": "nowhere.step"}, CaseError),
    ],
)
def test_what_is_wrong_with_a_body_is_said_with_its_name(kind, changes, error):
    table = BODIES[kind][0] if kind in BODIES else {}
    with pytest.raises(error, match='body "body": '):
        build({"geometry": {kind: [table | {"name": "body"} | changes]}})


# --- volumes from other isogeometric programs


def imported(path, **keys):
    """The model of a G+Smo file."""
    return build({"geometry": {"import": [{"name": "body", "file": str(path)} | keys]}})


def glued_of(model):
    """Pairs of glued faces, whichever comes first."""
    return {frozenset((pair.first, pair.second)) for pair in model.glued}


def assert_same_body(found, expected):
    """Two models have the same maps, glued faces and groups."""
    assert dict(found.bodies) == dict(expected.bodies)
    for name, patch in expected.patches.items():
        assert found.patches[name].degrees == patch.degrees
        assert_same_map(found.patches[name], patch)
    assert glued_of(found) == glued_of(expected)
    assert {name: set(faces) for name, faces in found.groups.items()} == {
        name: set(faces) for name, faces in expected.groups.items()
    }


@pytest.mark.parametrize("kind", ["pipe", pytest.param("sphere", marks=pytest.mark.slow), "cylinder", "extrusion"])
def test_a_body_comes_back_from_a_gismo_file(tmp_path, kind):
    model = model_with(kind, degree=2, spans=2)
    write_gismo(tmp_path / "body.xml", model)
    found = imported(tmp_path / "body.xml")
    assert_same_body(found, model)
    assert [p.shape for p in found.patches.values()] == [p.shape for p in model.patches.values()]


def test_patches_whose_directions_run_every_which_way_come_back_from_a_gismo_file(tmp_path):
    whole = scrambled_model(7, RING, rational=False)
    names = whole.bodies["body"]
    patches = {name: whole.patches[name] for name in names}
    model = Model(patches, {"body": names}, {"body/low": whole.groups["body/low"]}, whole.glued)
    write_gismo(tmp_path / "body.xml", model)
    assert_same_body(imported(tmp_path / "body.xml"), model)


def test_an_imported_body_takes_a_mesh_and_names_of_faces(tmp_path):
    write_gismo(tmp_path / "body.xml", model_with("pipe"))
    grading = {"toward": "inner", "ratio": 4}
    model = imported(tmp_path / "body.xml", degree=3, spans=4, grading=grading, faces=[{"name": "hole", "cylinder": 1}])
    assert set(model.groups["hole"]) == set(model.groups["body/inner"])
    for patch in model.patches.values():
        assert patch.degrees == (3, 3, 3)
        widths = np.diff(patch.breaks[0])
        assert widths[-1] / widths[0] == pytest.approx(4, rel=1e-9)


def test_a_single_patch_without_names_has_sides_as_a_block_has(tmp_path):
    write_gismo(tmp_path / "body.xml", Model({"a": block_patch("a")}, {"a": ("a",)}, {}))
    assert set(imported(tmp_path / "body.xml").groups) == {f"body/{side}" for side in SIDES}


def test_some_of_the_volumes_of_a_file_can_be_a_body(tmp_path):
    blocks = [block_patch(f"block{n}", origin=(2 * n, 0, 0)) for n in range(3)]
    write_gismo(tmp_path / "body.xml", model_of(*blocks))
    with pytest.raises(GeometryError, match=r'body "body": .*falls apart into 3 pieces.*patches'):
        imported(tmp_path / "body.xml")
    model = imported(tmp_path / "body.xml", patches=[2])
    (patch,) = model.patches.values()
    assert patch.control_points[..., 0].min() == 2
    with pytest.raises(CaseError, match=r'body "body": patches = \[1, 4\].*holds 3.*no 4'):
        imported(tmp_path / "body.xml", patches=[1, 4])


def test_files_are_looked_for_beside_the_case_file(tmp_path, monkeypatch):
    (tmp_path / "case").mkdir()
    write_gismo(tmp_path / "case" / "body.xml", model_with("extrusion"))
    path = tmp_path / "case" / "case.toml"
    path.write_text('[[geometry.import]]\nname = "body"\nfile = "body.xml"\n')
    monkeypatch.chdir(tmp_path)
    assert list(build(path).patches) == ["body"]
    monkeypatch.chdir(tmp_path / "case")
    assert list(build({"geometry": {"import": [{"name": "body", "file": "body.xml"}]}}).patches) == ["body"]


def test_patches_whose_weights_differ_by_a_factor_fit_together(tmp_path):
    lower, upper = block_patch("lower", degree=2), block_patch("upper", origin=(0, 0, 1), degree=2)
    weights = np.ones((3, 3, 3))
    weights[:, :, 1:] = 0.7
    patches = {"lower": lower, "upper": type(upper)("upper", (2, 2, 2), upper.knots, upper.control_points, 3 * weights)}
    write_gismo(tmp_path / "body.xml", Model(patches, {"both": ("lower", "upper")}, {}))
    assert len(imported(tmp_path / "body.xml").glued) == 1


# --- the model that is open in gmsh


def snapshot():
    """All that can be told of the models that are open in gmsh."""
    entities = gmsh.model.getEntities()
    options = ("Geometry.OCCTargetUnit", "Geometry.Tolerance", "Mesh.ElementOrder", "General.Terminal")
    values = []
    for option in options:
        get = gmsh.option.getString if option.endswith("Unit") else gmsh.option.getNumber
        values.append(get(option))
    return {
        "models": gmsh.model.list(),
        "current": gmsh.model.getCurrent(),
        "file": gmsh.model.getFileName(),
        "entities": entities,
        "names": [gmsh.model.getEntityName(*entity) for entity in entities],
        "boxes": [gmsh.model.getBoundingBox(*entity) for entity in entities],
        "groups": [(group, gmsh.model.getPhysicalName(*group)) for group in gmsh.model.getPhysicalGroups()],
        "members": [list(gmsh.model.getEntitiesForPhysicalGroup(*group)) for group in gmsh.model.getPhysicalGroups()],
        "nodes": len(gmsh.model.mesh.getNodes()[0]),
        "options": values,
    }


def two_boxes(occ):
    """Two boxes that share a face, with names and physical groups, in a model with a name of its own."""
    gmsh.model.add("mine")
    occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(1, 0, 0, 1, 1, 1))])
    occ.synchronize()
    gmsh.model.setEntityName(3, 1, 'first <&"> box')
    gmsh.model.setEntityName(2, 1, "a face")
    gmsh.model.addPhysicalGroup(3, [1], name="left")
    gmsh.model.addPhysicalGroup(3, [2], name="right")
    gmsh.model.addPhysicalGroup(2, [1], name="wall")


@pytest.mark.parametrize("keys", [{"name": "both"}, {}, {"name": "both", "degree": 3, "spans": 2}])
def test_the_model_that_is_open_in_gmsh_stays_as_it_is(keys):
    with open_gmsh() as occ:
        two_boxes(occ)
        before = snapshot()
        model = build_from_gmsh(**keys)
        assert snapshot() == before
        again = build_from_gmsh(**keys)
    assert_same_model(again, model)
    assert list(model.bodies) == ([keys["name"]] if keys else ["left", "right"])
    assert total_volume(model) == pytest.approx(2, rel=1e-12)
    assert len(model.glued) == len(keys.get("name", "")[:1])  # bodies are never glued to each other


@pytest.mark.parametrize("keys", [{"name": "a", "faces": [{"name": "b", "z": 7.0}]}, {"name": "a", "spans": 0}, {}])
def test_the_model_that_is_open_in_gmsh_stays_as_it_is_when_it_cannot_be_converted(keys):
    with open_gmsh() as occ:
        occ.addSphere(0, 0, 0, 1)
        occ.synchronize()
        gmsh.model.setEntityName(3, 1, "ball")
        before = snapshot()
        with pytest.raises((CaseError, GeometryError)):
            build_from_gmsh(**keys)
        assert snapshot() == before


def test_building_from_files_leaves_the_model_that_is_open_in_gmsh_as_it_is(tmp_path):
    with open_gmsh() as occ:
        two_boxes(occ)
        gmsh.write(str(tmp_path / "boxes.step"))
        before = snapshot()
        model = build({"geometry": {"cad": [{"name": "boxes", "file": str(tmp_path / "boxes.step"), "unit": "M"}]}})
        assert snapshot() == before
    assert len(model.patches) == 2


def test_the_keys_for_gmsh_are_checked_as_those_of_a_case():
    with pytest.raises(CaseError, match=r'"nmae".*did you mean "name"'):
        build_from_gmsh(nmae="body")
    with pytest.raises(CaseError, match='"file"'):
        build_from_gmsh(name="body", file="body.step")


def test_without_an_open_model_there_is_nothing_to_build_from():
    assert not gmsh.isInitialized()
    with pytest.raises((CaseError, GeometryError)):
        build_from_gmsh(name="body")


def box_in_a_group(name):
    """The model of a box whose body is named by a physical group."""
    with open_gmsh() as occ:
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], 7, name=name)
        return build_from_gmsh()


@pytest.mark.parametrize(("name", "body"), [("punch", "punch"), ("Stößel", "Stößel"), ("", "7")])
def test_physical_groups_name_the_bodies_where_nothing_else_does(name, body):
    assert list(box_in_a_group(name).bodies) == [body]


@pytest.mark.parametrize("name", ["my part", "a/1"])
def test_a_physical_group_whose_name_cannot_be_that_of_a_body_is_refused(name):
    with pytest.raises(CaseError, match=f'"{name}".*bodies'):
        box_in_a_group(name)
