import json
from contextlib import contextmanager
from functools import cache

import gmsh
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga import build, build_from_gmsh
from geom2iga.assembly import assembled, face_groups, joined
from geom2iga.cad.conversion import Built
from geom2iga.case import GeometryCase
from geom2iga.errors import CaseError
from geom2iga.patch import evaluate
from geom2iga.tables import checked
from tests.strategies import SEEDS

GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
WHOLE = {
    "block": {"name": "body", "size": [1, 2, 3]},
    "cylinder": {"name": "body", "radius": 1.0, "height": 2.0},
    "pipe": {"name": "body", "inner": 1.0, "outer": 2.0, "height": 1.0},
    "sphere": {"name": "body", "radius": 1.0},
    "hemisphere": {"name": "body", "radius": 1.0, "height": 0.5},
    "domed_block": {"name": "body", "size": [1.0, 1.0, 1.0], "radius": 2.0},
    "revolution": {"name": "body", "points": [[1, 0], [3, 0], [2, 1], [1, 1]]},
}
MOVED = {"origin": [3.0, -2.0, 5.0], "rotate": {"axis": [1.0, 0.0, 0.0], "angle": 90.0}}  # z becomes -y


def model_of(kind, *selectors, **changes):
    """A model of one body, with the groups "found", "found1" and so on."""
    names = ["found", *(f"found{number}" for number in range(1, len(selectors)))]
    faces = [{"name": name} | keys for name, keys in zip(names, selectors, strict=True)]
    case = {"geometry": {kind: [WHOLE[kind] | changes | {"faces": faces}]}}
    if kind == "block":
        return build(case)
    ((where, table),) = checked(case, GeometryCase).geometry.tables
    body = joined_body(kind, json.dumps(changes))
    return assembled([body], [body.patches], [face_groups(table, where, [body], {})])


@cache
def joined_body(kind, changes):
    """A primitive without names of faces, built and certified once."""
    ((_, table),) = checked({"geometry": {kind: [WHOLE[kind] | json.loads(changes)]}}, GeometryCase).geometry.tables
    part = table.part()
    return joined(Built("body", part, table, {patch.name: ("given", None) for patch in part.patches}, {}))


def assert_found(kind, selector, *names, **changes):
    """A selector means the same faces as names of the primitive."""
    model = model_of(kind, selector, **changes)
    expected = {face for name in names for face in model.groups[f"body/{name}"]}
    assert set(model.groups["found"]) == expected
    assert len(model.groups["found"]) == len(expected)


def refused(kind, selector, **changes):
    """The message on a selector that finds nothing."""
    with pytest.raises(CaseError) as error:
        model_of(kind, selector, **changes)
    assert error.value.exit_code == 2
    return str(error.value)


def points(model, group):
    """Samples (q, 3) of all faces of a group."""
    return np.concatenate([evaluate(model.surface(face), GRID)[0] for face in model.groups[group]])


@contextmanager
def open_gmsh():
    """An empty model of gmsh."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh.model.occ
    finally:
        gmsh.finalize()


@pytest.mark.parametrize(
    ("key", "value", "name"),
    [("x", 0, "left"), ("x", 1.0, "right"), ("y", 0, "front"), ("y", 2, "back"), ("z", 0, "bottom"), ("z", 3, "top")],
)
def test_a_plane_face_is_found_by_where_its_plane_crosses_an_axis(key, value, name):
    assert_found("block", {key: value}, name)


@pytest.mark.parametrize(
    ("kind", "selector", "names"),
    [
        ("cylinder", {"z": 2.0}, ["top"]),
        ("cylinder", {"z": 0.0}, ["bottom"]),
        ("pipe", {"z": 1.0}, ["top"]),
        ("hemisphere", {"z": 0.5}, ["flat"]),
        ("domed_block", {"z": 1.0}, ["top"]),
        ("domed_block", {"x": -0.5}, ["left"]),
    ],
)
def test_all_patches_of_a_plane_face_are_found(kind, selector, names):
    assert_found(kind, selector, *names)


def test_a_plane_may_lie_a_millionth_of_the_size_off_and_no_more():
    assert_found("block", {"z": 3 + 2e-6}, "top")
    assert "no face is like that" in refused("block", {"z": 3 + 4e-6})


@pytest.mark.parametrize(
    ("kind", "normal", "names"),
    [
        ("block", [0, 0, 1], ["top"]),
        ("block", [0, 0, -7.5], ["bottom"]),
        ("block", [-1e-3, 0, 0], ["left"]),
        ("pipe", [0, 0, -1], ["bottom"]),
        ("cylinder", [0, 0, 1], ["top"]),
        ("hemisphere", [0, 0, 1], ["flat"]),
        ("domed_block", [0, 1, 0], ["back"]),
    ],
)
def test_a_plane_face_is_found_by_its_outward_normal_of_any_length(kind, normal, names):
    assert_found(kind, {"normal": normal}, *names)


@given(SEEDS)
@settings(max_examples=8)
def test_the_normals_of_a_turned_block_turn_with_it(seed):
    turn = Rotation.random(random_state=seed)
    vector = turn.as_rotvec(degrees=True)
    rotate = {"axis": vector.tolist(), "angle": float(np.linalg.norm(vector))}
    changes = {"rotate": rotate, "origin": [1.0, 2.0, 3.0]}
    assert_found("block", {"normal": turn.apply([0, 1, 0]).tolist()}, "back", **changes)
    assert_found("domed_block", {"normal": turn.apply([0, 0, 1]).tolist()}, "top", **changes)


def test_a_curved_face_has_no_normal():
    assert "no face is like that" in refused("domed_block", {"normal": [0, 0, -1]})


@pytest.mark.parametrize(
    ("kind", "name", "radius", "changes"),
    [
        ("sphere", "outside", 1.0, {}),
        ("sphere", "outside", 1e-3, {"radius": 1e-3}),
        ("sphere", "outside", 1e4, {"radius": 1e4}),
        ("sphere", "outside", 1.0, MOVED),
        ("hemisphere", "outside", 1.0, {}),
        ("hemisphere", "outside", 1.0, MOVED | {"flat": "down"}),
        ("domed_block", "bottom", 2.0, {}),
        ("domed_block", "bottom", 40.0, {"radius": 40.0}),
    ],
)
def test_faces_on_a_sphere_are_found_by_its_radius(kind, name, radius, changes):
    assert_found(kind, {"sphere": radius}, name, **changes)


def test_faces_on_a_sphere_are_found_by_radius_and_centre():
    origin = [3.0, -2.0, 5.0]
    assert_found("sphere", {"sphere": {"radius": 1, "centre": origin}}, "outside", origin=origin)
    assert_found("domed_block", {"sphere": {"radius": 2, "centre": [0, 0, 2]}}, "bottom")
    for wrong in ({"radius": 1, "centre": [3.0, -2.0, 5.01]}, {"radius": 1.01, "centre": origin}):
        assert "no face is like that" in refused("sphere", {"sphere": wrong}, origin=origin)


@pytest.mark.parametrize(
    ("kind", "radius", "names", "changes"),
    [
        ("cylinder", 1.0, ["side"], {}),
        ("cylinder", 1.0, ["side"], MOVED),
        ("cylinder", 1.0, ["side"], {"angle": 30.0}),
        ("pipe", 1.0, ["inner"], {}),
        ("pipe", 2.0, ["outer"], {}),
        ("pipe", 2.0, ["outer"], MOVED | {"angle": 200.0}),
        ("hemisphere", 1.0, ["side"], {}),
        ("domed_block", 2.0, ["bottom"], {"bottom": "cylinder"}),
        ("revolution", 1.0, ["inner"], {}),  # its outer face is a cone
    ],
)
def test_faces_on_a_cylinder_are_found_by_its_radius(kind, radius, names, changes):
    assert_found(kind, {"cylinder": radius}, *names, **changes)


@pytest.mark.parametrize("along", [-4.0, 0.0, 11.0])
def test_the_centre_of_a_cylinder_is_any_point_of_its_axis(along):
    assert_found("pipe", {"cylinder": {"radius": 2, "centre": [0, 0, along]}}, "outer")
    assert_found("pipe", {"cylinder": {"radius": 2, "centre": [3, along, 5]}}, "outer", **MOVED)


def test_a_cylinder_about_another_axis_is_another_one():
    for centre in ([0.01, 0, 0], [0, 3, 0]):
        assert "no face is like that" in refused("pipe", {"cylinder": {"radius": 2, "centre": centre}})


@pytest.mark.parametrize(
    ("kind", "selector"),
    [
        ("block", {"sphere": 1.0}),
        ("block", {"cylinder": 1.0}),
        ("cylinder", {"sphere": 1.0}),
        ("sphere", {"cylinder": 1.0}),
        ("revolution", {"cylinder": 2.5}),  # a cone of this mean radius
        ("pipe", {"cylinder": 1.5}),
        ("sphere", {"sphere": 2.0}),
    ],
)
def test_a_face_of_another_shape_or_radius_is_not_meant(kind, selector):
    text = refused(kind, selector)
    assert f'geometry.{kind}[0].faces[0] "found": no face is like that; there are: body' in text


@pytest.mark.parametrize(
    ("near", "name"),
    [([0.5, 1, 9], "top"), ([0.5, 1, 2.9], "top"), ([-0.1, 1, 1.5], "left"), ([0.9, 0.2, 0.3], "right")],
)
def test_the_nearest_face_is_the_one_whose_nearest_point_is(near, name):
    assert_found("block", {"near": near}, name)


def test_the_nearest_face_is_not_the_one_whose_middle_is_nearest():
    """Near the end of a long side, the middle of the small end face is much closer."""
    assert_found("block", {"near": [9.0, 0.5, 1.1]}, "top", size=[10, 1, 1])


@given(st.floats(0, 2 * np.pi))
@settings(max_examples=8)
def test_one_of_the_faces_around_is_found_by_a_point_beside_it(angle):
    beside = np.array([1.2 * np.cos(angle), 1.2 * np.sin(angle), 1])
    model = model_of("cylinder", {"cylinder": 1, "near": beside.tolist()})
    (face,) = model.groups["found"]
    assert face in model.groups["body/side"]
    fine = np.stack([np.linspace(0, 1, 400), np.full(400, 0.5)], axis=1)
    feet = np.concatenate([evaluate(model.surface(face), xi)[0] for xi in (fine, fine[:, ::-1])])
    assert np.linalg.norm(feet - beside, axis=1).min() < 0.2 + 1e-3


def test_where_several_keys_are_given_all_of_them_hold():
    model = model_of(
        "pipe",
        {"z": 1.0, "near": [1.5, 0.1, 1.0]},
        {"cylinder": 1.0, "near": [1.5, 1.5, 0.5]},
        {"z": 0.0, "normal": [0, 0, -1]},
    )
    (top,), (inner,) = model.groups["found"], model.groups["found1"]
    assert top in model.groups["body/top"]
    assert inner in model.groups["body/inner"]  # though the outer one is nearer
    assert points(model, "found")[:, :2].min() > -1e-12  # of the first quarter
    assert points(model, "found1")[:, :2].min() > -1e-12
    assert set(model.groups["found2"]) == set(model.groups["body/bottom"])
    assert "no face is like that" in refused("pipe", {"z": 0.0, "normal": [0, 0, 1]})
    assert "no face is like that" in refused("block", {"x": 0, "y": 0})


def test_where_nothing_is_found_the_faces_that_there_are_are_listed():
    text = refused("block", {"z": 7.0})
    assert 'geometry.block[0].faces[0] "found": no face is like that' in text
    for normal, middle in (("(0, 0, 1)", "(0.5, 1, 3)"), ("(-1, 0, 0)", "(0, 1, 1.5)")):
        assert f"with normal {normal} about {middle}" in text
    assert text.count(" about ") == 6
    text = refused("cylinder", {"z": 7.0})  # of 14 faces
    assert text.count(" about ") == 12
    assert text.endswith(" ...")
    assert "curved" in refused("sphere", {"z": 7.0})


def test_faces_of_a_block_are_found_by_their_numbers_in_gmsh():
    model = model_of("block", {"tags": [5]}, {"tags": [1, 6, 99]})
    assert len(model.groups["found"]) == 1
    assert len(model.groups["found1"]) == 2
    assert "no face is like that" in refused("block", {"tags": [7]})
    assert "no face is like that" in refused("sphere", {"tags": [1]})  # it was not made by gmsh


def test_a_block_has_no_physical_groups():
    assert 'there is no physical group "lid"; Known: none' in refused("block", {"group": "lid"})


def test_faces_are_found_by_physical_group():
    with open_gmsh() as occ:
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.synchronize()
        (top,) = (tag for _, tag in gmsh.model.getEntitiesInBoundingBox(-1, -1, 0.9, 2, 2, 1.1, 2))
        others = [tag for _, tag in gmsh.model.getEntities(2) if tag != top]
        gmsh.model.addPhysicalGroup(2, [top], name="top of the box")
        gmsh.model.addPhysicalGroup(2, others, name="others")
        faces = [
            {"name": "lid", "group": "top of the box"},
            {"name": "rest", "group": "others"},
            {"name": "left", "group": "others", "x": 0.0},
            {"name": "number", "tags": [top]},
        ]
        model = build_from_gmsh(name="box", faces=faces)
        with pytest.raises(
            CaseError, match=r'keys\.faces\[0\] "lid": there is no physical group "othrs"; did you mean "others"'
        ):
            build_from_gmsh(name="box", faces=[{"name": "lid", "group": "othrs"}])
    assert model.groups["lid"] == model.groups["top of the box"] == model.groups["number"] == model.groups["box/top"]
    assert set(model.groups["rest"]) == set(model.groups["others"])
    assert len(model.groups["rest"]) == 5
    assert model.groups["left"] == model.groups["box/left"]


def test_only_the_bodies_of_its_table_can_be_named():
    with pytest.raises(CaseError, match=r'geometry\.block\[0\]\.faces\[0\] "found".*no body "bdoy".*only body'):
        model_of("block", {"x": 0, "body": "bdoy"})
    assert_found("block", {"x": 0, "body": "body"}, "left")


def test_a_selector_may_mean_the_faces_of_one_body_of_several():
    with open_gmsh() as occ:
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.addBox(2, 0, 0, 1, 1, 1)
        occ.synchronize()
        bodies = [{"name": "one", "tags": [1]}, {"name": "two", "tags": [2]}]
        faces = [{"name": "tops", "z": 1.0}, {"name": "top", "z": 1.0, "body": "two"}]
        model = build_from_gmsh(bodies=bodies, faces=faces)
    assert set(model.groups["tops"]) == {*model.groups["one/top"], *model.groups["two/top"]}
    assert model.groups["top"] == model.groups["two/top"]


def test_faces_inside_a_body_are_never_meant():
    model = model_of("cylinder", {"near": [0.0, 0.0, 1.0]})  # the middle of the core, whose sides are the nearest
    inside = {face for pair in model.glued for face in (pair.first, pair.second)}
    assert not inside & set(model.groups["found"])
