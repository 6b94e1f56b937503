from itertools import product

import numpy as np
import pytest
from hypothesis import given

from geom2iga import bspline
from geom2iga.patch import basis
from solve.pattern import box_columns, find_band, find_pattern
from solve.space import number_control_points
from tests.oracles import volume_quadrature
from tests.solve.joined import MODELS
from tests.strategies import open_knot_vectors, patches


@given(open_knot_vectors())
def test_a_band_is_all_pairs_of_functions_that_share_a_span(vector):
    knots, degree = vector
    middles = (bspline.breaks(knots)[1:] + bspline.breaks(knots)[:-1]) / 2
    first, _ = bspline.basis(knots, degree, middles)
    count = len(knots) - degree - 1
    shared = np.zeros((count, count), dtype=bool)
    for start in first:
        shared[start : start + degree + 1, start : start + degree + 1] = True
    band = find_band(knots, degree)
    np.testing.assert_array_equal(np.argwhere(shared), np.stack(band.pairs(0, count), axis=1))
    spans = [np.flatnonzero((first <= a) & (a <= first + degree)) for a in range(count)]
    np.testing.assert_array_equal(band.spans.T, [(found[0], found[-1]) for found in spans])


@given(patches(directions=(3,), highest=3))
def test_columns_of_a_patch_are_the_functions_that_share_a_span_in_increasing_sequence(patch):
    middles = [(at[1:] + at[:-1]) / 2 for at in patch.breaks]
    functions = basis(patch, np.array(list(product(*middles)))).indices
    shared = np.zeros((patch.weights.size,) * 2, dtype=bool)
    for span in functions:
        shared[np.ix_(span, span)] = True
    counts, columns = box_columns(patch)
    rows = np.repeat(np.arange(len(counts)), counts)
    np.testing.assert_array_equal(np.argwhere(shared), np.stack([rows, columns], axis=1))


@pytest.mark.parametrize("model", MODELS)
def test_the_pattern_is_that_of_all_spans_together_with_columns_in_line(model):
    space = number_control_points(MODELS[model]())
    shared = np.zeros((space.size, space.size), dtype=bool)
    for name, patch in space.model.patches.items():
        for part in volume_quadrature(patch):
            numbers = space.numbers[name][part.indices]
            shared[numbers[:, :, None], numbers[:, None]] = True
    pattern = find_pattern(space)
    expected = np.argwhere(np.kron(shared, np.ones((3, 3), dtype=bool)))
    rows = np.repeat(np.arange(space.dofs), np.diff(pattern.indptr))
    np.testing.assert_array_equal(np.stack([rows, pattern.indices], axis=1), expected)


def test_only_rows_at_glued_faces_are_merged():
    space = number_control_points(MODELS["two bodies"]())
    pattern = find_pattern(space)
    assert all(len(merger.points) == 0 for merger in pattern.mergers.values())
    assert pattern.allocated().size == pattern.indices.size
