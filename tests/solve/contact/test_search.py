import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from solve.contact.search import find_span_pairs
from tests.strategies import SEEDS, rotations


@given(SEEDS, st.integers(1, 12), st.integers(1, 12), rotations())
def test_the_pairs_are_those_whose_outlines_meet_each_once_and_in_sequence(seed, secondary, primary, turn):
    random = np.random.default_rng(seed)
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) @ turn.as_matrix()[:2, :2]
    outlines = [square + 2 * random.normal(size=(count, 1, 2)) for count in (secondary, primary)]
    shapes = [[shapely.Polygon(corners) for corners in side] for side in outlines]
    expected = [(i, j) for i, s in enumerate(shapes[0]) for j, m in enumerate(shapes[1]) if s.intersects(m)]
    assert list(zip(*find_span_pairs(*outlines), strict=True)) == expected
