import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geom2iga.bspline import find_spans
from geom2iga.patch import evaluate
from solve.contact.charts import closest_in_spans, frame_at, image_of
from tests.cases import block_patch, model_of
from tests.oracles import assert_tangent
from tests.solve.contact.curved_faces import shell, shells, sides, waves
from tests.strategies import SEEDS

WAVES = sides(waves(3, ((3, 4), (4, 2)), 15.0, 3.0), "upper/bottom", "lower/top")


def spans_at(surface, xi):
    """Knot indices (q, 2) of the spans that hold points."""
    patch = surface.patch
    return np.stack([find_spans(k, p, at) for k, p, at in zip(patch.knots, patch.degrees, xi.T, strict=True)], axis=1)


def start(secondary, count):
    return np.full((count, 2), 0.5 * secondary.patch.breaks[0][-1])


@given(SEEDS)
def test_the_closest_point_leads_back_from_where_the_normal_leads(seed):
    secondary, primary = WAVES
    xi = np.random.default_rng(seed).random((20, 2))
    spans = spans_at(primary, xi)
    image = image_of(secondary, frame_at(primary, xi, spans), start(secondary, 20), primary.outward)
    assert image.seen.all()
    points = evaluate(secondary.patch, image.xi)[0]
    back, found = closest_in_spans(primary, points, xi + 0.02, spans)
    assert found.all()
    np.testing.assert_allclose(back, xi, rtol=0, atol=1e-12)


@pytest.mark.parametrize("pair", [WAVES, sides(shells((2, 3), 0.1), "inner/top", "outer/bottom")])
def test_slopes_and_turning_normals_are_derivatives(pair):
    secondary, primary = pair
    for xi in np.array([[0.3, 0.4], [0.55, 0.1], [0.7, 0.8]]):
        spans = spans_at(primary, xi[None])

        def frame(at, spans=spans):
            return frame_at(primary, at[None], spans)

        def image(at, frame=frame):
            return image_of(secondary, frame(at), start(secondary, 1), primary.outward)

        assert_tangent(lambda at, image=image: image(at).xi[0], image(xi).slope[0], xi)
        assert_tangent(lambda at, frame=frame: frame(at).normal[0], frame(xi).turning[0], xi)


@given(st.floats(-5, 5), st.floats(-5, 5))
def test_a_plane_goes_on_for_ever(x, y):
    lower, upper = block_patch("lower", (x, y, 0), (0.1, 0.1, 1)), block_patch("upper", (0, 0, 1.5), (2, 1, 1))
    secondary, primary = sides(model_of(lower, upper), "upper/bottom", "lower/top")
    frame = frame_at(primary, np.zeros((1, 2)), np.ones((1, 2), dtype=np.int64))
    image = image_of(secondary, frame, start(secondary, 1), primary.outward)
    assert image.seen.all()
    np.testing.assert_allclose(image.xi, [[x / 2, y]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(image.gap, 0.5, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("height", "seen"), [(0.5, True), (-0.5, False)])
def test_what_lies_beyond_the_focus_of_a_hollow_sphere_is_not_seen(height, seen):
    """Past the middle of a hollow sphere there are nearer points of it, on other normals."""
    dome, block = shell("dome", (1.5, 2.0), 1), block_patch("block", (-1, -1, height - 1), (2, 2, 1))
    secondary, primary = sides(model_of(dome, block), "block/top", "dome/bottom")
    frame = frame_at(primary, np.full((1, 2), 0.4), np.full((1, 2), 4))
    image = image_of(secondary, frame, start(secondary, 1), primary.outward)
    assert image.seen.tolist() == [seen]
    away = frame._replace(normal=-frame.normal, turning=-frame.turning)
    assert not image_of(secondary, away, start(secondary, 1), primary.outward).seen.any()
