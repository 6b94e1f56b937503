import os
import re
import signal

import gmsh
import numpy as np
import pytest

from geom2iga import build
from geom2iga.bspline import open_knots
from geom2iga.build import build_from_gmsh
from geom2iga.cad import importing
from geom2iga.cad.case import Cad
from geom2iga.cad.importing import read_cad
from geom2iga.cad.isolated import isolated
from geom2iga.errors import CaseError, GeometryError
from geom2iga.model import SIDES
from tests.cases import UNIT


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


def cad_case(path, **keys):
    return {"geometry": {"cad": [{"file": str(path), **keys}]}}


def corners(patch):
    """Corners (2, 2, 2, 3) of a patch."""
    return patch.control_points[np.ix_([0, -1], [0, -1], [0, -1])]


def lower_ends(model):
    """Per body, the smallest x of its patches."""
    return {
        body: [model.patches[patch].control_points[..., 0].min() for patch in patches]
        for body, patches in model.bodies.items()
    }


def three_boxes(occ):
    """Volumes 1, 2, 3 from x = 0, 1 and 3; the first two meet."""
    for x in (0, 1, 3):
        occ.addBox(x, 0, 0, 1, 1, 1)


BOXES = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {1, 0, 0, 1, 1, 1}; Box(3) = {3, 0, 0, 1, 1, 1};
Physical Volume("pair") = {1, 2};
Physical Volume("single") = {3};
Physical Surface("base") = {5, 11, 17};
"""


# Files


@pytest.mark.parametrize("name", ["box.step", "box.stp", "BOX.STEP", "box.brep", "ein Würfel.brep"])
def test_a_box_keeps_its_size_through_a_cad_file(tmp_path, name):
    written_as = "box.brep" if name.endswith(".brep") else "box.step"  # gmsh knows fewer endings than users
    path = written(tmp_path / written_as, lambda occ: occ.addBox(-1, 0.5, 3, 2, 4, 0.25))
    path = path.rename(tmp_path / name)
    model = build(cad_case(path, name="punch", degree=2, spans=[2, 1, 3]))
    patch = model.patches["punch"]
    expected = np.array([-1, 0.5, 3]) + UNIT * [2, 4, 0.25]
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * 4)
    assert patch.degrees == (2, 2, 2)
    for knots, spans in zip(patch.knots, (2, 1, 3), strict=True):
        np.testing.assert_allclose(knots, open_knots(np.linspace(0, 1, spans + 1), 2))
    assert list(model.groups) == [f"punch/{side}" for side in SIDES]


def test_a_file_is_looked_for_beside_its_case(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    written(tmp_path / "parts" / "box.brep", lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
    path = tmp_path / "case.toml"
    path.write_text('[[geometry.cad]]\nname = "punch"\nfile = "parts/box.brep"\n')
    build(path)
    monkeypatch.chdir(tmp_path / "parts")
    build(cad_case("box.brep", name="punch"))


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("text.step", "hello\n", "save it anew"),
        ("empty.stp", "", "save it anew"),
        ("text.brep", "hello\n", "save it anew"),
        ("exit.geo", "Exit;\n", "the script ends gmsh: remove Exit"),
        ("text.xao", "hello\n", "save it anew"),
        ("box.msh", "", r"only .*\.step.*save it as one of them"),
        ("box", "", r"only .*\.step.*save it as one of them"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_advice(tmp_path, capfd, name, content, advice):
    (tmp_path / name).write_text(content)
    with pytest.raises(GeometryError, match=f'body "punch": "[^"]*{name}": .*{advice}') as error:
        build(cad_case(tmp_path / name, name="punch"))
    assert error.value.exit_code == 3
    assert not gmsh.isInitialized()
    assert capfd.readouterr().out == ""  # what OpenCASCADE says goes to standard error


def test_a_missing_file_is_a_wrong_case(tmp_path):
    for name in ("missing.step", "missing.geo"):
        with pytest.raises(CaseError, match=rf"{name}.*no such file"):
            build(cad_case(tmp_path / name, name="punch"))


def test_what_is_no_file_is_told_what_it_is(tmp_path):
    (tmp_path / "folder.step").mkdir()
    os.mkfifo(tmp_path / "pipe.geo")
    for name, found in (("folder.step", "a folder, no file"), ("pipe.geo", "a pipe or device, no file")):
        with pytest.raises(CaseError, match=rf'{name}": {found}'):
            build(cad_case(tmp_path / name, name="punch"))


def test_an_unnamed_table_is_called_by_its_key(tmp_path):
    with pytest.raises(CaseError, match=r"^geometry\.cad\[0\]: "):
        build(cad_case(tmp_path / "missing.step"))


@pytest.mark.parametrize(
    ("unit", "millimetres"),
    [
        ("MM", 1.0),
        ("M", 1e3),
        ("IN", 25.4),
        ("FT", 304.8),
        ("UM", 1e-3),
    ],
)
def test_a_step_file_is_turned_into_the_unit_asked_for(tmp_path, unit, millimetres):
    path = written(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 2, 4, 1))
    patch = build(cad_case(path, name="box", unit=unit)).patches["box"]
    expected = UNIT * [2, 4, 1] / millimetres
    np.testing.assert_allclose(corners(patch), expected, rtol=0, atol=1e-14 * expected.max())


def test_every_file_has_its_own_unit(tmp_path):
    """OpenCASCADE remembers the last unit as long as its process lives."""
    path = written(tmp_path / "box.step", lambda occ: occ.addBox(0, 0, 0, 2, 4, 1))
    tables = [{"name": name, "file": str(path), "unit": unit} for name, unit in (("m", "M"), ("mm", "MM"))]
    model = build({"geometry": {"cad": tables}})
    ratio = model.patches["mm"].control_points / 1e3
    np.testing.assert_allclose(model.patches["m"].control_points, ratio, rtol=0, atol=1e-16)


def test_an_iges_file_takes_no_unit_but_millimetres(tmp_path):
    (tmp_path / "box.igs").write_text("")
    with pytest.raises(GeometryError, match=r"IGES.*millimetres only.*STEP"):
        build(cad_case(tmp_path / "box.igs", name="box", unit="M"))


# Which volumes form which body


@pytest.mark.parametrize("suffix", [".geo", ".xao"])
def test_physical_groups_of_volumes_are_the_bodies_and_those_of_surfaces_name_faces(tmp_path, suffix):
    path = tmp_path / "boxes.geo"
    path.write_text(BOXES)
    if suffix == ".xao":
        start_gmsh()
        gmsh.merge(str(path))
        path = tmp_path / "boxes.xao"
        gmsh.write(str(path))
        gmsh.finalize()
    model = build(cad_case(path))
    assert lower_ends(model) == {"pair": [0, 1], "single": [3]}
    assert len(model.glued) == 1
    base = model.faces("base")
    assert [face.patch for face in base] == ["pair/1", "pair/2", "single"]
    for face in base:
        assert np.abs(model.surface(face).control_points[..., 2]).max() < 1e-15


def test_a_body_is_chosen_by_group_tags_or_the_point_that_it_holds(tmp_path):
    path = tmp_path / "boxes.geo"
    path.write_text(BOXES)
    bodies = [
        {"name": "a", "group": "single", "degree": 3},
        {"name": "b", "tags": [1]},
        {"name": "c", "group": "pair", "near": [1.5, 0.5, 0.5]},
    ]
    model = build(cad_case(path, bodies=bodies, degree=2, spans=2))
    assert lower_ends(model) == {"a": [3], "b": [0], "c": [1]}
    assert model.glued == ()
    assert [model.patches[name].degrees for name in "abc"] == [(3, 3, 3), (2, 2, 2), (2, 2, 2)]


@pytest.mark.parametrize(("x", "expected"), [(-5, 0), (1.9, 1), (2.4, 1), (2.6, 3), (9, 3)])
def test_near_takes_the_volume_whose_box_is_nearest(x, expected):
    start_gmsh()
    try:
        three_boxes(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        model = build_from_gmsh(bodies=[{"name": "body", "near": [x, 0.5, 0.5]}])
    finally:
        gmsh.finalize()
    assert lower_ends(model) == {"body": [expected]}


def test_solids_of_a_step_file_are_found_by_their_labels(tmp_path):
    path = written(tmp_path / "boxes.step", three_boxes)
    text = path.read_text()
    for number, label in enumerate(("lower", "lower", "upper"), 1):
        text = re.sub(rf"'Open CASCADE STEP translator [\d.]+ \d+\.{number}'", f"'{label}'", text)
    path.write_text(text)
    bodies = [{"name": "base", "label": "lower"}, {"name": "punch", "label": "upper"}]
    model = build(cad_case(path, bodies=bodies))
    assert lower_ends(model) == {"base": [0, 1], "punch": [3]}
    assert len(model.glued) == 1
    with pytest.raises(CaseError, match=r'body "base": no volume is like that; there are: 1 ".*lower", 2'):
        build(cad_case(path, bodies=[{"name": "base", "label": "lowr"}]))


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ([{"name": "a", "tags": [1, 2]}, {"name": "b", "tags": [2, 3]}], 'volume 2 is in two bodies, "a" and "b"'),
        ([{"name": "a", "group": "pare"}], r'body "a".*no physical group "pare".*did you mean "pair"'),
        ([{"name": "a", "tags": [7]}], r'body "a": no volume is like that; there are: 1, 2, 3'),
        ([{"name": "a", "tags": [3], "group": "pair"}], r'body "a": no volume is like that'),
    ],
)
def test_a_wrong_choice_of_volumes_is_a_wrong_case(tmp_path, bodies, message):
    path = tmp_path / "boxes.geo"
    path.write_text(BOXES)
    with pytest.raises(CaseError, match=message):
        build(cad_case(path, bodies=bodies))


def test_a_model_without_names_or_groups_is_told_how_to_name_its_bodies(tmp_path):
    path = written(tmp_path / "boxes.brep", three_boxes)
    with pytest.raises(CaseError, match=r"give the bodies names"):
        build(cad_case(path))


def test_a_body_that_falls_apart_is_refused(tmp_path):
    path = written(tmp_path / "boxes.brep", three_boxes)
    with pytest.raises(GeometryError, match=r"falls apart into 2 pieces.*body/1.*body/3"):
        build(cad_case(path, name="body"))


def test_faces_get_names_by_selectors(tmp_path):
    path = tmp_path / "boxes.geo"
    path.write_text(BOXES)
    faces = [
        {"name": "top", "z": 1.0},
        {"name": "end", "x": 4.0},
        {"name": "floor", "group": "base", "body": "pair"},
        {"name": "side", "normal": [0, -1, 0], "near": [3.5, 0, 0.5]},
    ]
    model = build(cad_case(path, faces=faces))
    assert [face.patch for face in model.faces("top")] == ["pair/1", "pair/2", "single"]
    assert model.faces("end") == model.faces("single/right")
    assert [face.patch for face in model.faces("floor")] == ["pair/1", "pair/2"]
    assert model.faces("side") == model.faces("single/front")


def test_a_crash_names_the_file(tmp_path, monkeypatch):
    path = written(tmp_path / "box.brep", lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
    monkeypatch.setattr(importing, "_load", signal.raise_signal)
    monkeypatch.setattr(
        importing, "isolated", lambda load, *_, seconds: isolated(load, signal.SIGSEGV, seconds=seconds)
    )
    with pytest.raises(GeometryError, match=r'box\.brep": gmsh crashed \(SIGSEGV\)'):
        read_cad(path, Cad(name="box", file=str(path)))


def test_names_of_physical_groups_that_are_no_xml_do_no_harm():
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1, 2], name='<"walls" & more')
        model = build_from_gmsh(name="box")
    finally:
        gmsh.finalize()
    assert len(model.groups['<"walls" & more']) == 2


def test_a_script_whose_last_line_does_not_end_is_refused(tmp_path):
    """gmsh leaves that line out without a word."""
    (tmp_path / "box.geo").write_text('SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};')
    with pytest.raises(GeometryError, match="add a newline"):
        build(cad_case(tmp_path / "box.geo", name="box"))
