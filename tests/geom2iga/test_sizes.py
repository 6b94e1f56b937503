from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga import build
from geom2iga.cad.case import CadModel
from geom2iga.cad.conversion import CadSource, Volume, convert
from geom2iga.errors import GeometryError
from geom2iga.exchange.gismo import write_gismo
from tests.cases import UNIT, block_patch, model_of

POWERS = (-40, pytest.param(40, marks=pytest.mark.slow))  # of two: 1e-12 and 1e12
TURN = {"axis": [1.0, 2.0, 3.0], "angle": 33.0}
SHAPES = {
    "block": {"size": [1.0, 2.0, 3.0]},
    "cylinder": {"radius": 1.0, "height": 2.0},
    "pipe": {"inner": 1.0, "outer": 1.5, "height": 2.0, "angle": 77.0},
    "sphere": {"radius": 1.0},
    "hemisphere": {"radius": 1.0, "height": 0.5},
    "domed_block": {"size": [1.0, 1.0, 1.0], "radius": 2.0},
    "extrusion": {
        "points": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        "through": {"front": [0.5, -0.1]},
        "vector": [0.0, 0.25, 1.0],
    },
    "revolution": {"points": [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]], "through": {"outer": [2.25, 0.5]}},
}


def scaled(value, factor):
    """Multiply all lengths, however deep they lie; angles stay."""
    if isinstance(value, dict):
        return {key: held if key == "angle" else scaled(held, factor) for key, held in value.items()}
    return [scaled(held, factor) for held in value] if isinstance(value, list) else value * factor


def built(kind, factor=1.0, **keys):
    """A model of one body, some times as large."""
    keys = {"origin": [0.5, -2.0, 1.0], **SHAPES[kind], **keys}
    turn = {} if "rotate" in keys else {"rotate": TURN}
    return build({"geometry": {kind: [{"name": "body", "degree": 2, **scaled(keys, factor), **turn}]}})


ordinary = cache(built)


@pytest.mark.parametrize("power", POWERS)
@pytest.mark.parametrize("kind", SHAPES)
def test_a_body_scaled_by_a_power_of_two_is_the_same_to_the_last_digit(kind, power):
    model, other = ordinary(kind), built(kind, 2.0**power)
    assert other.glued == model.glued
    for name, patch in model.patches.items():
        np.testing.assert_array_equal(other.patches[name].control_points, np.ldexp(patch.control_points, power))
        np.testing.assert_array_equal(other.patches[name].weights, patch.weights)
        assert other.certificates[name].jacobian.status == "proven"


@pytest.mark.parametrize("kind", SHAPES)
def test_a_body_a_million_sizes_away_keeps_its_shape(kind):
    here, there = ordinary(kind), built(kind, origin=[1e6, -1e6, 1e6])
    assert there.glued == here.glued
    for name, patch in here.patches.items():
        shift = there.patches[name].control_points - patch.control_points
        np.testing.assert_allclose(shift - shift[0, 0, 0], 0, atol=5e-10)
        assert there.certificates[name].volume == pytest.approx(here.certificates[name].volume, rel=1e-9)


@settings(max_examples=10)
@given(st.floats(-12, 12), st.tuples(*[st.floats(-4.5, 4.5)] * 3), st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_block_of_any_size_and_shape_has_exactly_its_corners(exponent, more, share):
    size = 10.0 ** (exponent + np.array(more))
    origin = 1e6 * np.array(share) * size
    case = {"geometry": {"block": [{"name": "body", "size": size.tolist(), "origin": origin.tolist()}]}}
    points = build(case).patches["body"].control_points
    for axis in range(3):
        reach = 2e-15 * max(abs(origin[axis]), size[axis])
        np.testing.assert_allclose(points[..., axis], (origin + UNIT * size)[..., axis], rtol=0, atol=reach)


@pytest.mark.parametrize("length", [1e-20, 1.0, 1e20])
def test_the_axis_of_a_rotation_may_be_of_any_length(length):
    axis = [0.6 * length, 0.0, 0.8 * length]
    points = built("block", rotate={"axis": axis, "angle": 33.0, "about": [0.0, 0.0, 0.0]}, origin=[0.0, 0.0, 0.0])
    turn = Rotation.from_rotvec(np.radians(33) * np.array([0.6, 0, 0.8])).as_matrix()
    corners = points.patches["body"].control_points[np.ix_([0, -1], [0, -1], [0, -1])]
    np.testing.assert_allclose(corners, UNIT * [1, 2, 3] @ turn.T, rtol=0, atol=1e-14)


def test_an_angle_may_be_of_any_size():
    whole = {"axis": [1.0, 0.0, 0.0], "angle": 360e12, "about": [0.0, 0.0, 0.0]}
    turned = built("block", rotate=whole, origin=[0.0, 0.0, 0.0]).patches["body"]
    np.testing.assert_allclose(turned.control_points[-1, -1, -1], [1, 2, 3], rtol=1e-15)


@pytest.mark.parametrize("factor", [1e-60, 1e60])
def test_a_patch_too_small_or_too_large_for_its_volume_to_be_a_number_is_refused(tmp_path, factor):
    write_gismo(tmp_path / "body.xml", model_of(block_patch(size=(factor,) * 3)))
    with pytest.raises(GeometryError, match=r'body "body": patch .* long, .*another unit of length'):
        build({"geometry": {"import": [{"name": "body", "file": str(tmp_path / "body.xml")}]}})


@pytest.mark.parametrize("kind", SHAPES)
def test_a_body_so_far_away_that_rounding_blurs_it_is_refused(kind):
    with pytest.raises(GeometryError, match=r'body "body": it is .* thick .* move the model nearer to the zero point'):
        built(kind, origin=[1e11, 0.0, 0.0])


def test_a_cad_model_smaller_than_the_tolerance_of_opencascade_is_told_of_its_unit():
    box = np.array([[-1e-7] * 3, [1e-9 + 1e-7] * 3])
    with pytest.raises(GeometryError, match=r"at most 2e-07 long.*1e-7 is one point.*smaller unit"):
        convert(CadSource("", {1: Volume("", box)}, {}, {}), CadModel(name="body"))
