import numpy as np
import pytest

import geom2iga
from geom2iga.patch import evaluate


@pytest.fixture(scope="module")
def ring():
    pipe = {"name": "ring", "inner": 1.0, "outer": 2.0, "height": 1.0, "angle": 90.0, "spans": [2, 3, 1]}
    return geom2iga.build({"geometry": {"degree": 2, "pipe": [pipe]}})


def test_facets_meet_the_curved_patch_where_its_knot_lines_cross_and_lie_inside_elsewhere(ring):
    (curved,), (flat,) = ring.patches.values(), geom2iga.faceted(ring).patches.values()
    assert flat.degrees == (1, 1, 1)
    crossings = np.stack(np.meshgrid(*curved.breaks, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(evaluate(flat, crossings)[0], evaluate(curved, crossings)[0], rtol=0, atol=1e-14)
    between = evaluate(flat, [[1.0, 1 / 6, 0.5]])[0][0]
    assert np.hypot(*between[:2]) < 2 - 1e-3


def test_facets_keep_bodies_and_groups_and_no_certificates(ring):
    flat = geom2iga.faceted(ring)
    assert (flat.bodies, flat.groups, flat.glued) == (ring.bodies, ring.groups, ring.glued)
    assert not flat.certificates


def test_glued_facets_still_fit():
    ball = geom2iga.build({"geometry": {"degree": 2, "sphere": [{"name": "ball", "radius": 1.0, "spans": 2}]}})
    assert len(geom2iga.faceted(ball).glued) == len(ball.glued)
