from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from geom2iga.errors import CaseError
from geom2iga.model import SIDES, Glued, Model, oriented
from geom2iga.patch import Face, Patch, evaluate, refined, surface
from tests.cases import block_groups, block_patch, model_of
from tests.oracles import assert_same_patch


def test_the_six_sides_of_a_block_lie_where_their_names_say():
    patch = block_patch(size=(1, 2, 3))
    model = model_of(patch)
    lies_at = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 2), "bottom": (2, 0), "top": (2, 3)}
    assert set(lies_at) == set(SIDES)
    for side, (coordinate, value) in lies_at.items():
        (face,) = model.faces(f"block/{side}")
        points = evaluate(model.surface(face), [[0, 0], [1, 1], [0.3, 0.6]])[0]
        assert points[:, coordinate] == pytest.approx(value)


def test_a_surface_of_a_model_is_the_face_of_its_patch():
    model = model_of(block_patch("lower"), block_patch("upper", origin=(0, 0, 1)))
    face = Face("upper", 1, 0)
    assert_same_patch(model.surface(face), surface(model.patches["upper"], face))


def test_a_patch_knows_its_body():
    one, two, three = (block_patch(name) for name in ("one", "two", "three"))
    model = Model({p.name: p for p in (one, two, three)}, {"a": ("one", "three"), "b": ("two",)}, {})
    assert [model.body_of(name) for name in ("one", "two", "three")] == ["a", "b", "a"]


def test_a_misspelt_face_gets_the_nearest_name():
    model = model_of(block_patch("lower"))
    with pytest.raises(CaseError, match=r'"lower/tap".*did you mean "lower/top"'):
        model.faces("lower/tap")


def test_models_never_change():
    bodies = {"block": ("block",)}
    model = Model({"block": block_patch()}, bodies, block_groups("block"))
    bodies["other"] = ()
    assert list(model.bodies) == ["block"]
    with pytest.raises(FrozenInstanceError):
        model.bodies = {}
    for name in ("patches", "bodies", "groups"):
        with pytest.raises(TypeError):
            getattr(model, name)["new"] = ()


@pytest.mark.parametrize(
    ("fault", "changes"),
    [
        ("block", {"bodies": {}}),
        ("block", {"bodies": {"one": ("block",), "two": ("block",)}}),
        ("other", {"bodies": {"one": ("block", "other")}}),
        ('"block" is listed as "other"', {"patches": {"other": block_patch()}, "bodies": {"one": ("other",)}}),
        ("2 directions", {"patches": {"block": replace(surface(block_patch(), Face("block", 0, 0)), name="block")}}),
        ('"bottom".*"upper"', {"groups": {"bottom": (Face("upper", 2, 0),)}}),
    ],
)
def test_a_model_that_makes_no_sense_is_refused(fault, changes):
    whole = {"patches": {"block": block_patch()}, "bodies": {"one": ("block",)}, "groups": {}}
    Model(**whole)
    with pytest.raises(ValueError, match=fault):
        Model(**(whole | changes))


@pytest.mark.parametrize(("axis", "side"), [(3, 0), (-1, 0), (0, 2), (0, -1)])
def test_a_block_has_no_seventh_face(axis, side):
    with pytest.raises(ValueError, match="block"):
        Face("block", axis, side)


def test_a_model_says_what_it_holds():
    patches = [block_patch(name, spans=(2, 1, 1)) for name in ("lower", "up<per")]
    model = model_of(*patches)
    first, lower, upper = repr(model).splitlines()
    assert first == "Model(2 bodies, 2 patches, 24 control points)"
    assert lower.startswith(
        "  lower: degree 1, 2 x 1 x 1 spans, 12 control points in a box of 1 x 1 x 1; faces lower/left, "
    )
    assert upper.endswith("up<per/top")
    html = model._repr_html_()
    assert html.count("<tr>") == 3
    assert "up&lt;per/top" in html
    assert "up<per" not in html


def test_a_model_of_many_bodies_shows_the_first_and_counts_the_rest():
    model = model_of(*(block_patch(f"b{number}") for number in range(40)))
    *_, last = lines = repr(model).splitlines()
    assert len(lines) < 20
    assert last == f"  and {40 - len(lines) + 2} more"


def test_a_model_says_which_faces_are_glued():
    whole = Model(**two_blocks(), glued=(Glued(TOP, BOTTOM, 0),))
    assert "1 pair of glued faces" in repr(whole)
    assert "both: 2 patches" in repr(whole)


def test_a_curve_is_no_body():
    line = Patch("line", (1,), ([0, 0, 1, 1],), [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(ValueError, match='"line" has 1 directions'):
        Model({"line": line}, {"line": ("line",)}, {})


TOP, BOTTOM = Face("lower", 2, 1), Face("upper", 2, 0)


def two_blocks(bodies=None, shift=0.0, spans=(2, 3, 1), knots=(0.5,)):
    """Two blocks, one on the other."""
    upper = block_patch("upper", origin=(shift, 0, 1), spans=(1, *spans[1:]))
    inserted = [np.arange(1, spans[0]) / spans[0] if spans[0] != 2 else np.array(knots), [], []]
    upper = refined(upper, knots=inserted)
    patches = {p.name: p for p in (block_patch("lower", spans=(2, 3, 1)), upper)}
    return {"patches": patches, "bodies": bodies or {"both": ("lower", "upper")}, "groups": {}}


def test_faces_that_coincide_can_be_glued():
    assert Model(**two_blocks(), glued=(Glued(TOP, BOTTOM, 0),)).glued == (Glued(TOP, BOTTOM, 0),)


@pytest.mark.parametrize(
    ("fault", "blocks", "glued"),
    [
        ("lie 0.001 apart", two_blocks(shift=1e-3), Glued(TOP, BOTTOM, 0)),
        ("lie 1 apart", two_blocks(), Glued(TOP, BOTTOM, 2)),
        ("control points", two_blocks(), Glued(TOP, BOTTOM, 1)),
        ("control points", two_blocks(spans=(2, 4, 1)), Glued(TOP, BOTTOM, 0)),
        ("degrees or knots", two_blocks(knots=[0.25]), Glued(TOP, BOTTOM, 0)),
        ("two bodies", two_blocks({"a": ("lower",), "b": ("upper",)}), Glued(TOP, BOTTOM, 0)),
        ('unknown patch "other"', two_blocks(), Glued(TOP, Face("other", 2, 0), 0)),
    ],
)
def test_faces_that_do_not_coincide_cannot_be_glued(fault, blocks, glued):
    with pytest.raises(ValueError, match=fault):
        Model(**blocks, glued=(glued,))


def test_there_are_eight_orientations_and_each_is_another():
    grid = np.arange(6).reshape(2, 3)
    assert len({(oriented(grid, o).shape, oriented(grid, o).tobytes()) for o in range(8)}) == 8
    with pytest.raises(ValueError, match="8 orientations"):
        Glued(TOP, BOTTOM, 8)
