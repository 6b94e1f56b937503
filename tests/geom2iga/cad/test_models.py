import gmsh
import pytest

from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.registry import open_here


@pytest.fixture(scope="module", params=MODELS.values(), ids=MODELS.keys())
def model(request, gmsh_session, tmp_path_factory):
    """Each model in turn, open in gmsh."""
    gmsh.model.add(request.param.name)
    open_here(request.param, tmp_path_factory.mktemp("cad"))
    yield request.param
    gmsh.model.remove()


def edges_around(face):
    """The edges of a face, one list per loop; a seam stands twice."""
    return [list(map(abs, loop)) for loop in gmsh.model.occ.getCurveLoops(face)[1]]


def below(dimension, tag):
    """Tags of what bounds an entity, each once."""
    return {tag for _, tag in gmsh.model.getBoundary([(dimension, tag)], combined=False, oriented=False)}


def test_every_volume_has_the_edges_and_corners_of_a_cube(model):
    volumes = gmsh.model.getEntities(3)
    assert len(volumes) == model.patches
    for _, volume in volumes:
        faces = below(3, volume)
        loops = {face: edges_around(face) for face in faces}
        assert len(faces) == 6
        assert [face for face in faces if len(loops[face]) != 1] == []
        assert [face for face in faces if len(loops[face][0]) != 4 or len(set(loops[face][0])) != 4] == []
        edges = {edge for face in faces for edge in loops[face][0]}
        assert len(edges) == 12
        assert len(set.union(*(below(1, edge) for edge in edges))) == 8


def test_the_volumes_share_the_faces_that_are_said_to_be_shared(model):
    neighbours = [len(gmsh.model.getAdjacencies(2, face)[0]) for _, face in gmsh.model.getEntities(2)]
    assert neighbours.count(2) == model.glued
    assert neighbours.count(1) == 6 * model.patches - 2 * model.glued


def test_the_volume_is_the_one_that_is_stated(model):
    found = sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3))
    assert found > 0
    if model.volume is not None:
        assert found == pytest.approx(model.volume, rel=1e-3)  # OpenCASCADE is off by up to 3e-4 on rational surfaces
