"""Random inputs for the laws."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geom2iga.bspline import Array, open_knots
from geom2iga.model import Model
from geom2iga.patch import Patch
from solve.system import System
from tests.cases import bent_patch, block_patch, contact_system, model_of, moved, turned

SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def rotations(draw: Any) -> Rotation:
    """Turns about any axis by any angle."""
    return Rotation.random(random_state=draw(SEEDS))


@st.composite
def bent_patches(draw: Any, highest: int = 3, rational: bool = True) -> Patch:
    """Volumes with bent faces, of any degrees up to the highest, turned in space; rational or polynomial."""
    degrees = draw(st.tuples(*[st.integers(1, highest)] * 3))
    spans = draw(st.tuples(*[st.integers(1, 2)] * 3))
    return bent_patch(draw(SEEDS), degrees, spans, rational=rational)


@st.composite
def graded_breaks(draw: Any, most: int = 4) -> Array:
    """Breaks from 0 to 1 with up to `most` spans of uneven size."""
    shares = np.array(draw(st.lists(st.floats(0.2, 1.0), min_size=1, max_size=most)))
    return np.concatenate([[0.0], np.cumsum(shares)]) / shares.sum()


@st.composite
def graded_surfaces(draw: Any, highest: int = 4) -> Patch:
    """Flat patches of two directions over the unit square, whose parameter is the position only for degree 1."""
    degrees = draw(st.tuples(st.integers(1, highest), st.integers(1, highest)))
    knots = tuple(open_knots(draw(graded_breaks()), degree) for degree in degrees)
    axes = [np.linspace(0, 1, len(k) - p - 1) for k, p in zip(knots, degrees, strict=True)]
    points = np.stack([*np.meshgrid(*axes, indexing="ij"), np.zeros([len(a) for a in axes])], axis=-1)
    return Patch("surface", degrees, knots, points)


@st.composite
def convex_polygons(draw: Any) -> Array:
    """Corners (n, 2) of convex polygons, counter-clockwise: points of an ellipse that is turned and moved."""
    shares = np.array(draw(st.lists(st.floats(0.1, 1.0), min_size=3, max_size=8)))
    angles = 2 * np.pi * np.cumsum(shares) / shares.sum()
    random = np.random.default_rng(draw(SEEDS))
    turn = Rotation.from_rotvec([0, 0, random.uniform(0, np.pi)]).as_matrix()[:2, :2]
    return (np.stack([np.cos(angles), np.sin(angles)], axis=1) * random.uniform(0.3, 3, 2)) @ turn + random.normal(
        size=2
    )


@st.composite
def contact_systems(draw: Any, floating: bool = False) -> System:
    """Small contact problems; floating ones have rigid motions that contact alone resists."""
    free = draw(st.integers(1, 6))
    rigid = draw(st.integers(1, min(3, free))) if floating else 0
    return contact_system(draw(SEEDS), free, draw(st.integers(3, 9)), rigid)


@st.composite
def stacked_blocks(draw: Any, height: float = 0.0, overhang: bool = True, turn: Rotation | None = None) -> Model:
    """A block "upper" at any angle on a block "lower", their faces parallel and `height` apart.

    Edges and knot lines that coincide or cross at right angles are as likely as any others. Without overhang the
    upper block stands whole on the lower one.
    """
    degrees = draw(st.tuples(st.integers(1, 3), st.integers(1, 3)))
    spans = draw(st.tuples(*[st.integers(1, 4)] * 4))
    shares = st.sampled_from([0.0, 0.25, 0.5, 1.0]) | st.floats(0, 1)
    size = 0.5 + np.array(draw(st.tuples(shares, shares))) * (0.4 if not overhang else 1.5)
    centre = 2 * np.array(draw(st.tuples(shares, shares)))
    if not overhang:
        centre = 0.75 + centre / 4
    angle = draw(st.sampled_from([0.0, 45.0, 90.0, 180.0]) | st.floats(-180, 180))
    lower = block_patch("lower", size=(2, 2, 1), degree=degrees[0], spans=(*spans[:2], 1))
    upright = block_patch("upper", (*-size / 2, 0), (*size, 1), degrees[1], (*spans[2:], 1))
    upper = moved(turned(upright, Rotation.from_rotvec([0, 0, angle], degrees=True)), (*centre, 1 + height))
    return model_of(turned(lower, turn), turned(upper, turn))


@st.composite
def open_knot_vectors(draw: Any, highest: int = 5, most: int = 4) -> tuple[Array, int]:
    """Open knot vectors over any interval, their inner knots repeated at will, with their degree."""
    degree = draw(st.integers(1, highest))
    start, length = draw(st.sampled_from([(0.0, 1.0), (0.0, 4.0), (-1.5, 0.7)]))
    at = start + length * draw(graded_breaks(most))
    inner = draw(st.lists(st.integers(1, degree), min_size=len(at) - 2, max_size=len(at) - 2))
    return np.repeat(at, [degree + 1, *inner, degree + 1]), degree


@st.composite
def patches(draw: Any, directions: tuple[int, ...] = (1, 2, 3), highest: int = 5, rational: bool = True) -> Patch:
    """Curves, surfaces and volumes of any degrees and knots, with scattered control points and positive weights."""
    count = draw(st.sampled_from(directions))
    each = [draw(open_knot_vectors(highest, 5 - count)) for _ in range(count)]
    shape = tuple(len(knots) - degree - 1 for knots, degree in each)
    random = np.random.default_rng(draw(SEEDS))
    points, weights = random.normal(size=(*shape, 3)), random.uniform(0.3, 3.0, shape)
    degrees, knots = tuple(degree for _, degree in each), tuple(knots for knots, _ in each)
    return Patch("random", degrees, knots, points, weights if rational else None)
