import numpy as np
import pytest

from geom2iga.exchange.geopdes import write_geopdes
from geom2iga.patch import Patch, evaluate
from tests.cases import bent_patch, hollow_cylinder, model_of
from tests.geom2iga.exchange.scrambled import CORNER, CUBE, count_control_points, ring, scrambled_model

MODELS = {
    "corner": scrambled_model(0, CORNER),
    **{f"cube, turned {seed}": scrambled_model(seed, CUBE) for seed in range(1, 5)},
    "ring": ring(0, 180),
    "quarter": model_of(hollow_cylinder()),
    "bent": model_of(bent_patch(3, (3, 1, 2))),
}


def read_geopdes(path):
    """Read a file line by line, as mp_geo_read_nurbs.m does."""
    lines = iter(line for line in path.read_text().splitlines() if not line.startswith("#"))

    def numbers(kind=int):
        return [kind(word) for word in next(lines).split()]

    directions, dimension, patch_count, interface_count, subdomain_count = numbers()
    assert (directions, dimension) == (3, 3)
    patches = []
    for number in range(1, patch_count + 1):
        assert next(lines) == f"PATCH {number}"
        degrees, counts = numbers(), numbers()
        knots = [numbers(float) for _ in range(3)]
        coefficients = [np.reshape(numbers(float), counts, order="F") for _ in range(4)]
        points = np.stack(coefficients[:3], axis=-1) / coefficients[3][..., None]
        patches.append(Patch(f"patch {number}", degrees, knots, points, coefficients[3]))
    interfaces = [(next(lines), numbers(), numbers(), numbers()) for _ in range(interface_count)]
    subdomains = [(next(lines), numbers()) for _ in range(subdomain_count)]
    boundaries = []
    for name in lines:
        (count,) = numbers()
        boundaries.append((name, [tuple(numbers()) for _ in range(count)]))
    return patches, interfaces, subdomains, boundaries


def side_of(grid, side):
    """Entries of a grid at one of the sides 1 to 6, its directions in increasing sequence."""
    return np.take(grid, -((side - 1) % 2), axis=(side - 1) // 2)


def matched(grid, flag, first, second):
    """Run through the second side as the first one runs; the steps of mp_interface.m in their sequence."""
    grid = grid.swapaxes(0, 1) if flag == -1 else grid
    grid = grid[::-1] if first == -1 else grid
    return grid[:, ::-1] if second == -1 else grid


@pytest.fixture
def written(request, tmp_path):
    path = tmp_path / "geometry.txt"
    write_geopdes(path, MODELS[request.param])
    return MODELS[request.param], *read_geopdes(path)


@pytest.mark.parametrize("written", MODELS, indirect=True)
def test_the_patches_in_the_file_map_as_ours_do(written):
    model, patches, *_ = written
    for found, expected in zip(patches, model.patches.values(), strict=True):
        xi = np.random.default_rng(0).random((20, 3))
        assert found.degrees == expected.degrees
        np.testing.assert_allclose(evaluate(found, xi)[0], evaluate(expected, xi)[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("written", MODELS, indirect=True)
def test_control_points_that_the_interfaces_match_are_the_same_and_no_others(written):
    model, patches, interfaces, *_ = written
    assert len(interfaces) == len(model.glued)
    starts = np.cumsum([0, *(patch.weights.size for patch in patches)])
    numbers = [
        start + np.arange(patch.weights.size).reshape(patch.shape)
        for start, patch in zip(starts[:-1], patches, strict=True)
    ]
    owner = np.arange(starts[-1])
    for _, first, second, match in interfaces:
        points = [side_of(patches[patch - 1].homogeneous, side) for patch, side in (first, second)]
        np.testing.assert_allclose(points[0], matched(points[1], *match), rtol=0, atol=1e-12)
        pairs = side_of(numbers[first[0] - 1], first[1]), matched(side_of(numbers[second[0] - 1], second[1]), *match)
        for one, other in zip(*(each.ravel() for each in pairs), strict=True):
            owner[owner == owner[other]] = owner[one]
    assert len(np.unique(owner)) == (count_control_points(model) if model.glued else starts[-1])


@pytest.mark.parametrize("written", ["corner"], indirect=True)
def test_bodies_become_subdomains_and_groups_boundaries(written):
    model, _, interfaces, subdomains, boundaries = written
    assert subdomains == [("SUBDOMAIN 1 (body)", [1, 2, 3]), ("SUBDOMAIN 2 (other)", [4])]
    assert [name for name, _ in boundaries] == [
        "BOUNDARY 1 (body/low)",
        "BOUNDARY 2 (other/top)",
        "BOUNDARY 3 (no group)",
    ]
    assert boundaries[1][1] == [(4, 6)]
    every = [tuple(side) for _, *sides, _ in interfaces for side in sides] + [
        s for _, sides in boundaries for s in sides
    ]
    assert sorted(every) == [(patch, side) for patch in range(1, len(model.patches) + 1) for side in range(1, 7)]
