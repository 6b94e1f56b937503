import base64
from xml.etree import ElementTree

import numpy as np
import pytest
import splinepy
from hypothesis import given

from geom2iga.errors import CaseError, GeometryError
from geom2iga.exchange.gismo import read_gismo, write_gismo
from geom2iga.glue import find_glued, normalised
from geom2iga.patch import Face, evaluate, reversed_along
from tests.cases import UNIT, bent_patch, block_patch, hollow_cylinder, model_of
from tests.geom2iga.exchange.scrambled import CORNER, CUBE, count_control_points, ring, run_apart, scrambled_model
from tests.oracles import assert_same_patch
from tests.strategies import patches

MODELS = {
    "corner": scrambled_model(0, CORNER),
    **{f"cube, turned {seed}": scrambled_model(seed, CUBE, rational=seed % 2 == 0) for seed in range(1, 5)},
    "ring": ring(0, 180),
    "quarter": model_of(hollow_cylinder()),
    "bent": model_of(bent_patch(3, (3, 1, 2))),
}
XI = np.random.default_rng(0).random((20, 3))
SCRIPT = """
import json, sys
import numpy as np, pygismo
xi, *paths = map(json.loads, sys.argv[1:])
def look(path):
    model = pygismo.core.gsMultiPatch()
    pygismo.io.gsReadFile(path, model)
    mapper = pygismo.assembler.createMapper(pygismo.core.gsMultiBasis(model), model, 1, True, True)
    patches = [model.patch(number) for number in range(model.nPatches())]
    saved = pygismo.io.gsFileData()
    saved.add(model)
    saved.save(path + ".again.xml")
    return {
        "again": path + ".again.xml",
        "places": [patch.eval(np.transpose(xi)).T.tolist() for patch in patches],
        "interfaces": len(model.interfaces()),
        "boundaries": len(model.boundaries()),
        "dofs": mapper.freeSize(),
        "numbers": [[mapper.index(k, p, 0) for k in range(len(patch.coefs()))] for p, patch in enumerate(patches)],
    }
print(json.dumps([look(path) for path in paths]))
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gismo")
    paths = {name: folder / f"{number}.xml" for number, name in enumerate(MODELS)}
    for name, model in MODELS.items():
        write_gismo(paths[name], model)
    return paths


@pytest.fixture(scope="module")
def seen(files):
    """What G+Smo makes of each model."""
    pytest.importorskip("pygismo")
    answers = run_apart(SCRIPT, XI.tolist(), *(f'"{path}"' for path in files.values()))
    return dict(zip(files, answers, strict=True))


def assert_places(found, model):
    for places, patch in zip(found, model.patches.values(), strict=True):
        np.testing.assert_allclose(places, evaluate(patch, XI)[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_gismo_places_every_point_where_we_do(name, seen):
    assert_places(seen[name]["places"], MODELS[name])


@pytest.mark.parametrize("name", MODELS)
def test_gismo_shares_the_control_points_that_are_glued_and_no_others(name, seen):
    model = MODELS[name]
    assert seen[name]["interfaces"] == len(model.glued)
    assert seen[name]["boundaries"] == 6 * len(model.patches) - 2 * len(model.glued)
    points = np.concatenate([p.control_points.reshape(-1, 3, order="F") for p in model.patches.values()])
    numbers = np.concatenate(seen[name]["numbers"])
    _, first, back = np.unique(numbers, return_index=True, return_inverse=True)
    np.testing.assert_allclose(points, points[first][back], rtol=0, atol=1e-12)
    assert seen[name]["dofs"] == len(first) == (count_control_points(model) if model.glued else len(points))


@pytest.mark.parametrize("name", MODELS)
def test_splinepy_sees_the_same_patches_interfaces_and_boundaries(name, files):
    model = MODELS[name]
    found = splinepy.io.gismo.load(files[name], load_options=False)
    assert_places([patch.evaluate(XI) for patch in found.patches], model)
    neighbours = np.array(found.interfaces)
    names = list(model.patches)
    assert np.count_nonzero(neighbours >= 0) == 2 * len(model.glued)
    for pair in model.glued:
        side, other = (6 * names.index(f.patch) + 2 * f.axis + f.side for f in (pair.first, pair.second))
        assert neighbours.flat[side] == other
        assert neighbours.flat[other] == side


@pytest.mark.parametrize("name", [name for name, model in MODELS.items() if model.glued])
def test_gismo_writes_the_interfaces_as_we_do(name, files, seen):
    texts = [ElementTree.parse(path).findtext("MultiPatch/interfaces") for path in (files[name], seen[name]["again"])]
    ours, theirs = (sorted(np.array(text.split(), dtype=int).reshape(-1, 10).tolist()) for text in texts)
    assert ours == theirs


@pytest.mark.parametrize("name", ["corner", "cube, turned 1", "bent"])
def test_what_is_written_comes_back_bit_for_bit(name, files):
    part = read_gismo(files[name], "body")
    for found, expected in zip(part.patches, MODELS[name].patches.values(), strict=True):
        for value in ("control_points", "weights"):
            assert np.array_equal(getattr(found, value), getattr(expected, value))
        assert all(map(np.array_equal, found.knots, normalised(expected).knots))


def test_names_of_boundaries_come_back_as_those_of_faces(files):
    part = read_gismo(files["corner"], "body")
    assert [patch.name for patch in part.patches] == ["body/1", "body/2", "body/3", "body/4"]
    assert part.faces["low"] == MODELS["corner"].faces("body/low")
    assert part.faces["other/top"] == (Face("body/4", 2, 1),)
    assert set(part.faces) == {"low", "other/top"}


def test_patches_that_were_glued_are_found_glued_again(files):
    part = read_gismo(files["cube, turned 1"], "body")
    assert len(find_glued(part.patches[:-1])) == len(MODELS["cube, turned 1"].glued)


@given(patch=patches(directions=(3,), highest=3))
def test_any_patch_survives_the_round_trip(patch, tmp_path_factory):
    path = tmp_path_factory.mktemp("round") / "geometry.xml"
    write_gismo(path, model_of(patch))
    (found,) = read_gismo(path, "random").patches
    mirrored = normalised(reversed_along(normalised(patch), 0))
    expected = normalised(patch) if np.array_equal(found.control_points, patch.control_points) else mirrored
    assert_same_patch(found, expected)


@pytest.mark.parametrize("axis", range(3))
def test_a_left_handed_patch_becomes_right_handed_and_keeps_the_names_of_its_faces(axis, tmp_path):
    model = model_of(reversed_along(block_patch("block", size=(1, 2, 3)), axis))
    write_gismo(tmp_path / "block.xml", model)
    part = read_gismo(tmp_path / "block.xml", "block")
    (patch,) = part.patches
    assert np.linalg.det(evaluate(patch, XI, 1)[1]).min() > 0
    again = model_of(patch)
    for name, (face,) in part.faces.items():
        found = evaluate(again.surface(face), [[0.5, 0.5]])[0]
        expected = evaluate(model.surface(model.faces(f"block/{name}")[0]), [[0.5, 0.5]])[0]
        np.testing.assert_allclose(found, expected, atol=1e-14)


def test_a_file_written_by_splinepy_is_read_text_or_binary(tmp_path):
    patch = bent_patch(5, (2, 3, 1))
    flat = patch.control_points.reshape(-1, 3, order="F"), patch.weights.reshape(-1, order="F")
    spline = splinepy.NURBS(patch.degrees, [k.tolist() for k in patch.knots], *flat)
    for binary in (False, True):
        path = str(tmp_path / f"{binary}.xml")
        splinepy.io.gismo.export(path, multipatch=splinepy.Multipatch([spline]), as_base64=binary)
        (found,) = read_gismo(path, patch.name).patches
        assert_same_patch(found, patch)


CUBE_FILE = """<!-- a comment first, as in some files of G+Smo -->
<?xml version="1.0" encoding="UTF-8"?>
<xml>
 <Geometry type="TensorBSpline3" id="7">
  <Basis type="TensorBSplineBasis3">
   <Basis type="BSplineBasis" index="0"><KnotVector degree="1">0 0 2 2</KnotVector></Basis>
   <Basis type="BSplineBasis" index="1"><KnotVector degree="1">0 0 1 1</KnotVector></Basis>
   <Basis type="BSplineBasis" index="2"><KnotVector degree="1">0 0 1 1</KnotVector></Basis>
  </Basis>
  <coefs geoDim="3">0 0 0  1 0 0  0 1 0  1 1 0
                    0 0 1  1 0 1  0 1 1  1 1 1</coefs>
 </Geometry>
</xml>
"""


@pytest.mark.parametrize("by_coordinate", [False, True])
def test_a_bare_geometry_becomes_a_patch_called_like_the_body(by_coordinate, tmp_path):
    text = CUBE_FILE
    if by_coordinate:
        ordered = UNIT.reshape(-1, 3, order="F").T.ravel()
        start, end = text.index("<coefs"), text.index("</coefs>")
        coefficients = '<coefs geoDim="3" order="coordinates">' + " ".join(map(str, ordered))
        text = text[:start] + coefficients + text[end:]
    (tmp_path / "cube.xml").write_text(text)
    part = read_gismo(tmp_path / "cube.xml", "cube")
    assert_same_patch(part.patches[0], block_patch("cube"))
    assert part.faces == {}


NURBS = CUBE_FILE.replace("TensorBSpline3", "TensorNurbs3").replace(
    '<Basis type="TensorBSplineBasis3">', '<Basis type="TensorNurbsBasis3"><Basis type="TensorBSplineBasis3">'
)


def nurbs(weights):
    return NURBS.replace("  </Basis>\n", f"  </Basis><weights>{weights}</weights></Basis>\n")


def surfaces(text):
    geometry = '<Geometry type="TensorBSpline2"/><Geometry type="TensorNurbs2"/><Geometry type="BSpline"/>'
    return f"<xml>{geometry}</xml>"


def boundary(text):
    mark = '<MultiPatch parDim="3"><boundary name="a">{}</boundary></MultiPatch></xml>'
    return CUBE_FILE.replace("</xml>", mark.format(text))


BINARY = base64.b64encode(np.zeros(7)).decode()
WRONG = {
    "text": ("solid cube", "is no G+Smo file: syntax error"),
    "entities": ('<!DOCTYPE lolz [<!ENTITY a "b">]><xml>&a;</xml>', "declares a document type, lolz"),
    "empty": ("<xml/>", "holds no geometry, no volume"),
    "surfaces": (surfaces(""), "holds 2 surfaces, 1 curve, no volume"),
    "hierarchical": (CUBE_FILE.replace('"TensorBSpline3"', '"THBSpline3"'), "geometry 7: a THBSpline3 cannot be read"),
    "transform": (CUBE_FILE.replace("<coefs", "<transform/><coefs"), "its transform cannot be read"),
    "no basis": (
        CUBE_FILE.replace('<Basis type="T', '<Other type="T').replace("  </Basis>\n ", "  </Other>"),
        "no <Basis>",
    ),
    "two directions": (
        CUBE_FILE.replace('<Basis type="BSplineBasis" index="2">', "<Basis>", 1).replace(
            '<KnotVector degree="1">0 0 2 2</KnotVector>', ""
        ),
        "3 knot vectors, found 2",
    ),
    "too few": (CUBE_FILE.replace("1 1 1<", "1 1<"), "2 x 2 x 2 control points take 24 numbers, found 23"),
    "a word": (CUBE_FILE.replace("0 0 0  ", "0 0 zero  "), "could not convert string to float: 'zero'"),
    "not finite": (CUBE_FILE.replace("0 0 0  ", "0 0 nan  "), "control points must be finite"),
    "in a plane": (CUBE_FILE.replace('geoDim="3"', 'geoDim="2"'), "lies in 3 dimensions, found 2"),
    "no degree": (CUBE_FILE.replace('degree="1"', 'degree="one"'), 'needs its degree, a number, found "one"'),
    "periodic": (CUBE_FILE.replace("0 0 2 2", "-1 0 2 3"), "the knot vector is not open"),
    "torn": (CUBE_FILE.replace("0 0 2 2", "0 0 1 1 2 2"), "knot 1 stands more than 1 times"),
    "no knots": (CUBE_FILE.replace("0 0 2 2", ""), "needs at least 4 knots, found 0"),
    "no weights": (NURBS.replace("  </Basis>\n", "  </Basis></Basis>\n"), "<Basis> has no <weights>"),
    "weights": (nurbs("1 1 1 1 1 1 1 0"), "weights must be positive, found 0"),
    "fewer weights": (nurbs("1 1"), "control points take 8 numbers, found 2"),
    "short": (CUBE_FILE.replace("<coefs", '<coefs format="B64Int16"'), 'the format "b64int16" cannot be read'),
    "binary": (
        CUBE_FILE.replace("<coefs", '<coefs format="B64Float64"').replace("0 0 0  1", BINARY),
        "the numbers of its <coefs> are no b64float64",
    ),
    "another id": (boundary("8 1"), "boundary: there is no volume with the id 8"),
    "side 9": (boundary("7 9"), 'boundary: patch "cube" has no face'),
    "half a side": (boundary("7 1 7"), "boundary: 3 numbers are no pairs"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_in_a_file_is_said_in_one_sentence(name, tmp_path):
    text, expected = WRONG[name]
    (tmp_path / "cube.xml").write_text(text)
    with pytest.raises(GeometryError) as caught:
        read_gismo(tmp_path / "cube.xml", "cube")
    message = str(caught.value)
    assert expected in message
    assert message.startswith(f'"{tmp_path / "cube.xml"}"')
    assert "\n" not in message


def test_a_missing_file_is_an_error_of_the_case(tmp_path):
    with pytest.raises(CaseError, match=r'no\.xml": no such file'):
        read_gismo(tmp_path / "no.xml", "cube")


def test_names_cannot_break_the_file(tmp_path):
    model = model_of(block_patch('a<b>&"c"'))
    write_gismo(tmp_path / "block.xml", model)
    root = ElementTree.parse(tmp_path / "block.xml").getroot()
    assert root.find("Geometry").get("label") == 'a<b>&"c"'
    assert set(read_gismo(tmp_path / "block.xml", 'a<b>&"c"').faces) == {name.split("/")[-1] for name in model.groups}
