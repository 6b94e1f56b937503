"""The tables that describe bodies: mesh, names of faces, primitives, CAD files, files of other programs."""

import re
from math import inf, nan

import pytest

from geom2iga.body_case import Faces, Grading, Round
from geom2iga.build import build
from geom2iga.case import GeometryCase
from geom2iga.errors import CaseError
from geom2iga.tables import checked

FOREIGN = re.compile(r"pydantic|dict|instance|tuple|Input|validation|[Vv]alue error|_type|NoneType|model")
SQUARE = [[1, 0], [2, 0], [2, 1], [1, 1]]
WHOLE = {  # one good table of each kind
    "block": {"name": "body", "size": [1, 2, 3]},
    "cylinder": {"name": "body", "radius": 1.0, "height": 2.0},
    "pipe": {"name": "body", "inner": 1.0, "outer": 2.0, "height": 1.0},
    "sphere": {"name": "body", "radius": 1.0},
    "hemisphere": {"name": "body", "radius": 1.0},
    "domed_block": {"name": "body", "size": [1, 1, 1], "radius": 1.0},
    "extrusion": {"name": "body", "points": SQUARE, "vector": [0, 0, 1]},
    "revolution": {"name": "body", "points": SQUARE},
    "cad": {"file": "body.step"},
    "import": {"name": "body", "file": "body.xml"},
}
KINDS = list(WHOLE)


def case_of(kind, **changes):
    """A case of one body, with changed keys; those that are None are left out."""
    return {"geometry": {kind: [{k: v for k, v in (WHOLE[kind] | changes).items() if v is not None}]}}


def table_of(kind, **changes):
    """The checked table of one body."""
    ((_, table),) = checked(case_of(kind, **changes), GeometryCase).geometry.tables
    return table


def assert_refused(case, *expected):
    """The message names these things in this sequence, speaks of nothing that the case file does not know."""
    with pytest.raises(CaseError) as error:
        checked(case, GeometryCase)
    text = str(error.value)
    assert error.value.exit_code == 2
    assert not FOREIGN.search(text), text
    assert "\n" not in text
    rest = text
    for each in expected:
        assert each in rest, text
        rest = rest.partition(each)[2]


def face(**keys):
    """Keys of a body that give a name to faces."""
    return {"faces": [{"name": "base"} | keys]}


def of_cad(**keys):
    """Keys of a CAD model of one body in `bodies`."""
    return {"bodies": [{"name": "part"} | keys]}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"degree": 0}, (".degree", "at least 1", "0")),
        ({"spans": [1, 2, 0]}, (".spans[2] = 0", "greater than or equal to 1")),
        ({"span_size": 0}, (".span_size = 0", "greater than 0")),
        ({"span_size": -0.5}, (".span_size = -0.5", "greater than 0")),
        ({"span_size": nan}, (".span_size = nan", "finite")),
        ({"span_size": inf}, (".span_size = inf", "finite")),
        ({"span_size": "1"}, (".span_size = '1'", "number")),
        ({"span_size": True}, (".span_size = True", "number")),
        ({"span_size": [1, 1, 1]}, (".span_size = [1, 1, 1]", "number")),
        ({"span_size": 1.0, "spans": 2}, ("give only one of spans and span_size",)),
        ({"grading": {"toward": "bottom", "ratio": 0.5}}, (".grading[0].ratio = 0.5", "greater than or equal to 1")),
        ({"grading": {"toward": "bottom", "ratio": nan}}, (".grading[0].ratio = nan", "finite")),
        ({"grading": {"toward": "bottom", "ratio": "2"}}, (".grading[0].ratio = '2'", "number")),
        ({"grading": {"toward": "bottom"}}, (".grading[0].ratio is missing",)),
        ({"grading": {"ratio": 2}}, (".grading[0].toward is missing",)),
        ({"grading": {"toward": 3, "ratio": 2}}, (".grading[0].toward = 3", "string")),
        ({"grading": [{"toward": "a", "ratio": 2}, {"toward": "b"}]}, (".grading[1].ratio is missing",)),
        ({"grading": 3}, (".grading = 3", "list")),
        (face(), (".faces[0]", '"base"', "x, y, z, normal, sphere, cylinder, group, tags, near")),
        (face(body="body"), (".faces[0]", '"base"', "selects nothing")),
        ({"faces": [{"x": 0.0}]}, (".faces[0].name is missing",)),
        ({"faces": 3}, (".faces = 3", "list")),
        (face(name="a/b", x=0), (".faces[0].name", "letters", "a/b")),
        (face(x="0"), (".faces[0].x = '0'", "number")),
        (face(y=nan), (".faces[0].y = nan", "finite")),
        (face(z=True), (".faces[0].z = True", "number")),
        (face(normal=[0, 1]), (".faces[0].normal[2] is missing",)),
        (face(normal=2), (".faces[0].normal = 2", "list")),
        (face(sphere=-1), (".faces[0].sphere.radius = -1", "greater than 0")),
        (face(sphere={"centre": [0, 0, 0]}), (".faces[0].sphere.radius is missing",)),
        (face(sphere="big"), (".faces[0].sphere = 'big'", "table")),
        (face(cylinder=0), (".faces[0].cylinder.radius = 0", "greater than 0")),
        (face(cylinder={"radius": 1, "centre": [0, 0]}), (".faces[0].cylinder.centre[2] is missing",)),
        (face(group=3), (".faces[0].group = 3", "string")),
        (face(tags=3), (".faces[0].tags = 3", "list")),
        (face(tags=[1, 1.5]), (".faces[0].tags[1] = 1.5", "integer")),
        (face(near=[0, 0, inf]), (".faces[0].near[2] = inf", "finite")),
        (face(near=1), (".faces[0].near = 1", "list")),
        (face(body=3, x=0), (".faces[0].body", "letters", "3")),
    ],
)
def test_a_wrong_mesh_or_name_of_faces_is_reported_alike_for_every_kind_of_body(kind, changes, expected):
    first, *rest = expected
    assert_refused(case_of(kind, **changes), f"geometry.{kind}[0]", first, *rest)


@pytest.mark.parametrize(
    ("kind", "changes", "expected"),
    [
        ("cylinder", {"radius": None}, ("cylinder[0].radius is missing",)),
        ("cylinder", {"height": 0}, ("cylinder[0].height = 0", "greater than 0")),
        ("cylinder", {"angle": 0}, ("cylinder[0].angle = 0", "greater than 0")),
        ("cylinder", {"angle": 361}, ("cylinder[0].angle = 361", "360")),
        ("cylinder", {"angle": 1e-5}, ("cylinder[0]", "1e-05", "round it")),
        ("pipe", {"inner": 2, "outer": 1}, ("pipe[0]", "inner radius 2", "less", "1")),
        ("pipe", {"inner": 0}, ("pipe[0].inner = 0", "greater than 0")),
        ("pipe", {"angle": -90}, ("pipe[0].angle = -90", "greater than 0")),
        ("sphere", {"radius": -1}, ("sphere[0].radius = -1", "greater than 0")),
        ("sphere", {"radius": nan}, ("sphere[0].radius = nan", "finite")),
        ("sphere", {"name": None}, ("sphere[0].name is missing",)),
        ("sphere", {"origin": [0, 0]}, ("sphere[0].origin[2] is missing",)),
        ("sphere", {"rotate": {"angle": "3"}}, ("sphere[0].rotate.angle = '3'", "number")),
        ("sphere", {"rotate": {"axis": [0, 0, 0], "angle": 3}}, ("sphere[0].rotate", "no direction")),
        ("hemisphere", {"height": -1}, ("hemisphere[0].height = -1", "greater than or equal to 0")),
        ("hemisphere", {"flat": "left"}, ("hemisphere[0].flat = 'left'", '"up" or "down"')),
        ("domed_block", {"radius": 0.1}, ("domed_block[0]", "0.1", "larger radius")),
        ("domed_block", {"size": [1, 1, 0.01]}, ("domed_block[0]", "0.01", "0.29")),
        ("domed_block", {"size": [1, 1]}, ("domed_block[0].size[2] is missing",)),
        ("domed_block", {"bottom": "cone"}, ("domed_block[0].bottom = 'cone'", '"sphere", "cylinder"')),
        ("extrusion", {"vector": [0, 0, -1]}, ("extrusion[0]", "positive", "-1")),
        ("extrusion", {"points": SQUARE[:3]}, ("extrusion[0].points[3] is missing",)),
        ("extrusion", {"points": SQUARE[::-1]}, ("extrusion[0]", "clockwise")),
        ("extrusion", {"points": [[1, 0, 0], *SQUARE[1:]]}, ("extrusion[0].points[0] = [1, 0, 0]", "2")),
        ("extrusion", {"through": {"top": [1, 2]}}, ("extrusion[0]", '"top"', "front, right, back, left")),
        ("extrusion", {"through": {"front": [1.5, 0.0]}}, ("extrusion[0]", '"front"', "1.5", "leave")),
        ("extrusion", {"through": {"front": [1.5]}}, ("extrusion[0].through.front[1] is missing",)),
        ("revolution", {"points": [[0, 0], *SQUARE[1:]]}, ("revolution[0]", "axis", "0")),
        ("revolution", {"angle": 400}, ("revolution[0].angle = 400", "360")),
        ("revolution", {"through": {"front": [1, 2]}}, ("revolution[0]", '"front"', "bottom, outer, top, inner")),
        ("cad", {"file": None}, ("cad[0].file is missing",)),
        ("cad", {"file": 3}, ("cad[0].file = 3", "string")),
        ("cad", {"name": "a/b"}, ("cad[0].name", "letters", "a/b")),
        ("cad", {"name": "a"} | of_cad(), ("cad[0]", "only one of name and bodies")),
        ("cad", {"bodies": 3}, ("cad[0].bodies = 3", "list")),
        ("cad", {"bodies": [{}]}, ("cad[0].bodies[0].name is missing",)),
        ("cad", of_cad(tags=[1.5]), ("cad[0].bodies[0].tags[0] = 1.5", "integer")),
        ("cad", of_cad(near=[0, 0]), ("cad[0].bodies[0].near[2] is missing",)),
        ("cad", of_cad(label=3), ("cad[0].bodies[0].label = 3", "string")),
        ("cad", of_cad(group=3), ("cad[0].bodies[0].group = 3", "string")),
        ("cad", of_cad(degree=0), ("cad[0].bodies[0].degree", "at least 1", "0")),
        ("cad", of_cad(spans=2, span_size=1.0), ("cad[0].bodies[0]", "spans and span_size")),
        ("cad", of_cad(grading={"toward": "a", "ratio": 0.1}), ("cad[0].bodies[0].grading[0].ratio = 0.1",)),
        ("cad", {"route": "fit"}, ("cad[0].route = 'fit'", '"exact" or "mesh"')),
        ("cad", {"exact": "often"}, ("cad[0].exact = 'often'",)),
        ("cad", {"accuracy": 0}, ("cad[0].accuracy = 0", "greater than 0")),
        ("cad", {"accuracy": "fine"}, ("cad[0].accuracy = 'fine'", "number")),
        ("cad", {"max_degree": 0}, ("cad[0].max_degree = 0", "1")),
        ("cad", {"max_degree": 2.5}, ("cad[0].max_degree = 2.5", "integer")),
        ("cad", {"fit_spans": 1}, ("cad[0].fit_spans = 1", "2")),
        ("cad", {"fit_spans": 65}, ("cad[0].fit_spans = 65", "64")),
        ("cad", {"fit_spans": True}, ("cad[0].fit_spans = True", "integer")),
        ("cad", {"unit": "mm"}, ("cad[0].unit = 'mm'", '"MM", "CM", "M"')),
        ("cad", {"trusted": "perhaps"}, ("cad[0].trusted = 'perhaps'",)),
        ("import", {"file": None}, ("import[0].file is missing",)),
        ("import", {"file": 3}, ("import[0].file = 3", "string")),
        ("import", {"name": None}, ("import[0].name is missing",)),
        ("import", {"patches": [0]}, ("import[0].patches[0] = 0", "greater than or equal to 1")),
        ("import", {"patches": [1, 2.0]}, ("import[0].patches[1] = 2.0", "integer")),
        ("import", {"patches": 1}, ("import[0].patches = 1", "list")),
    ],
)
def test_a_wrong_value_of_one_kind_of_body_is_reported_with_its_full_key(kind, changes, expected):
    assert_refused(case_of(kind, **changes), "geometry.", *expected)


@pytest.mark.parametrize(
    ("kind", "changes", "wrong", "table", "right"),
    [
        ("block", {"span_sise": 1.0}, "span_sise", "block[0]", "span_size"),
        ("block", {"grading": {"towards": "a", "ratio": 2}}, "towards", "block[0].grading[0]", "toward"),
        ("block", face(nomal=[0, 0, 1]), "nomal", "block[0].faces[0]", "normal"),
        ("block", face(sphere={"radius": 1, "center": [0, 0, 0]}), "center", "block[0].faces[0].sphere", "centre"),
        ("sphere", {"radios": 1}, "radios", "sphere[0]", "radius"),
        ("sphere", {"rotate": {"angle": 1, "abot": [0, 0, 0]}}, "abot", "sphere[0].rotate", "about"),
        ("cad", {"rout": "mesh"}, "rout", "cad[0]", "route"),
        ("cad", of_cad(tag=[1]), "tag", "cad[0].bodies[0]", "tags"),
    ],
)
def test_an_unknown_key_gets_the_nearest_known_one(kind, changes, wrong, table, right):
    assert_refused(case_of(kind, **changes), f'"{wrong}" in [geometry.{table}]', f'did you mean "{right}"')


@pytest.mark.parametrize(
    ("geometry", "right"),
    [
        ({"imports": []}, "import"),
        ({"import": [{"name": "a", "file": "a.xml", "fil": "b.xml"}]}, "file"),
        ({"import": [{"name": "a", "file": "a.xml", "faces": [{"name": "b", "nomal": [0, 0, 1]}]}]}, "normal"),
    ],
)
def test_an_unknown_key_of_an_imported_body_gets_the_nearest_known_one(geometry, right):
    assert_refused({"geometry": geometry}, f'did you mean "{right}"')


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("block", "domed_block")])
@pytest.mark.parametrize(("key", "value"), [("knots", [[0, 0, 1, 1]] * 3), ("breaks", [[0, 1]] * 3)])
def test_only_blocks_take_knots_and_breaks(kind, key, value):
    assert_refused(case_of(kind, **{key: value}), f'"{key}" in [geometry.{kind}[0]]')


def test_a_domed_block_takes_breaks_and_is_as_smooth_as_its_degree_there():
    at = [0.0, 0.1, 0.3, 1.0]
    for bottom in ("paraboloid", "sphere"):
        case = case_of("domed_block", degree=3, breaks=[at, at, [0.0, 0.5, 1.0]], bottom=bottom)
        (patch,) = build(case).patches.values()
        inner = [knots[p + 1 : -p - 1].tolist() for knots, p in zip(patch.knots, patch.degrees, strict=True)]
        assert inner == [at[1:-1], at[1:-1], [0.5]]


@pytest.mark.parametrize("kind", ["block", "domed_block"])
@pytest.mark.parametrize("at", [[0.0], [0.1, 1.0], [0.0, 0.5, 0.5, 1.0]])
def test_breaks_that_do_not_increase_from_0_to_1_are_refused(kind, at):
    assert_refused(
        case_of(kind, breaks=[at, [0.0, 1.0], [0.0, 1.0]]), f"geometry.{kind}[0]", "must increase from 0 to 1"
    )


@pytest.mark.parametrize("key", ["breaks", "knots"])
def test_spans_that_are_next_to_nothing_are_refused(key):
    at = [0.0, 1e-143, 1.0] if key == "breaks" else [0.0, 0.0, 1e-143, 1.0, 1.0]
    unit = [0.0, 1.0] if key == "breaks" else [0.0, 0.0, 1.0, 1.0]
    where = f"geometry.block[0].{key}[0]" if key == "knots" else "breaks[0]"
    assert_refused(case_of("block", **{key: [at, unit, unit]}), where, "nearer than 1e-09 of the whole")


@pytest.mark.parametrize("ways", [("spans", "span_size"), ("span_size", "breaks"), ("spans", "span_size", "knots")])
def test_a_mesh_is_given_in_one_way_only(ways):
    values = {"spans": 2, "span_size": 0.5, "breaks": [[0, 1]] * 3, "knots": [[0, 0, 1, 1]] * 3}
    assert_refused(case_of("block", **{way: values[way] for way in ways}), "geometry.block[0]", " and ".join(ways))


@pytest.mark.parametrize("way", [{"breaks": [[0, 0.5, 1]] * 3}, {"knots": [[0, 0, 1, 1]] * 3}])
def test_a_grading_of_given_knots_is_refused(way):
    case = case_of("block", grading={"toward": "bottom", "ratio": 2}, **way)
    assert_refused(case, "geometry.block[0]", "grading")


@pytest.mark.parametrize("kind", KINDS)
def test_a_single_table_where_a_list_belongs_is_told_so(kind):
    assert_refused({"geometry": {kind: WHOLE[kind]}}, f"geometry.{kind} is one table", f"[[geometry.{kind}]]")


@pytest.mark.parametrize(("kind", "key"), [("block", "faces"), ("cad", "bodies")])
def test_a_single_table_within_a_table_is_told_what_toml_calls_the_list(kind, key):
    case = case_of(kind, **{key: {"name": "a", "near": [0, 0, 0]}})
    assert_refused(case, f"geometry.{kind}[0].{key} is one table", f"[[geometry.{kind}.{key}]]")


@pytest.mark.parametrize(
    ("kind", "changes", "expected"),
    [
        ("block", face(normal=[0, 0, 0]), ("faces[0]", "no direction")),
        ("block", face(tags=["1"]), ("faces[0].tags[0] = '1'", "integer")),
        ("block", face(tags=[True]), ("faces[0].tags[0] = True", "integer")),
        ("block", face(tags=[]), ("faces[0].tags",)),
        ("cad", of_cad(tags=["1"]), ("bodies[0].tags[0] = '1'", "integer")),
        ("cad", {"exact": "no"}, ("exact = 'no'", "true or false")),
        ("cad", {"trusted": "yes"}, ("trusted = 'yes'", "true or false")),
        ("cad", {"trusted": 1}, ("trusted = 1", "true or false")),
        ("extrusion", {"through": 3}, ("through = 3", "table")),
        ("block", {"faces": [{"name": "a", "x": 0}, {"name": "a", "x": 1}]}, ('"a"',)),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(kind, changes, expected):
    assert_refused(case_of(kind, **changes), f"geometry.{kind}[0]", *expected)


@pytest.mark.parametrize("kind", KINDS)
def test_what_every_body_may_say_of_its_mesh_has_its_documented_value_when_left_out(kind):
    table = table_of(kind)
    assert (table.degree, table.spans, table.span_size, table.grading, table.faces) == (None, None, None, (), ())


@pytest.mark.parametrize("kind", KINDS)
def test_a_grading_is_one_table_or_a_list(kind):
    one, other = {"toward": "bottom", "ratio": 2.0}, {"toward": "left", "ratio": 3}
    assert table_of(kind, grading=one).grading == (Grading(**one),)
    assert table_of(kind, grading=[one, other]).grading == (Grading(**one), Grading(**other))
    assert table_of(kind, grading=[]).grading == ()


def test_a_radius_stands_for_a_sphere_or_cylinder_about_any_centre():
    (faces,) = table_of("block", **face(sphere=2, cylinder={"radius": 3.0, "centre": [0, 1, 2]})).faces
    assert faces.sphere == Round(radius=2.0)
    assert faces.cylinder == Round(radius=3.0, centre=(0, 1, 2))


def test_a_selector_takes_every_key_at_once():
    keys = {"x": 0.0, "y": 1, "z": -2.5, "normal": [0, 0, 1], "sphere": 1.0, "cylinder": 2.0}
    keys |= {"group": "any text", "tags": [3, 4], "near": [0, 0, 0], "body": "body"}
    (faces,) = table_of("cad", **face(**keys)).faces
    assert isinstance(faces, Faces)
    assert (faces.x, faces.y, faces.z, faces.tags, faces.group) == (0, 1, -2.5, (3, 4), "any text")


def test_a_cad_table_has_its_documented_values():
    table = table_of("cad")
    assert (table.name, table.bodies, table.route, table.exact, table.accuracy) == (None, (), "exact", True, 1e-6)
    assert (table.max_degree, table.fit_spans, table.unit, table.trusted) == (8, 8, "MM", False)


def test_a_body_of_a_cad_model_has_a_mesh_of_its_own():
    (part,) = table_of("cad", spans=2, **of_cad(degree=[1, 2, 3], span_size=0.5, label="lid")).bodies
    assert (part.degree, part.spans, part.span_size, part.label) == ((1, 2, 3), None, 0.5, "lid")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("block", "cad", "import")])
def test_a_primitive_stands_on_the_origin_of_space_when_nothing_else_is_said(kind):
    table = table_of(kind)
    assert (table.origin, table.rotate) == ((0, 0, 0), None)
    assert table.part().faces
