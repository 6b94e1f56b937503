import gmsh
import numpy as np
import pytest

from geom2iga.build import build_from_gmsh
from geom2iga.cad.brep import read_brep
from tests.cases import UNIT

TURN, SHIFT = "0 -1 0 0\n1 0 0 0\n0 0 1 0\n", "1 0 0 5\n0 1 0 0\n0 0 1 0\n"
TEXT = f"""CASCADE Topology V1, (c) Matra-Datavision
Locations 3
1
{TURN}1
{SHIFT}2 2 1 1 1 0
Curve2ds 0
Curves 0
Polygon3D 0
PolygonOnTriangulations 0
Surfaces 0
Triangulations 0

TShapes 1
Ve
1e-07
1 0 0
0 0

0101101
*

+1 3
"""


def test_a_product_of_locations_puts_a_shape_where_opencascade_puts_it(tmp_path):
    """What stands first is applied first."""
    (tmp_path / "vertex.brep").write_text(TEXT)
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.importShapes(str(tmp_path / "vertex.brep"))
        gmsh.model.occ.synchronize()
        place = gmsh.model.getValue(0, 1, [])
    finally:
        gmsh.finalize()
    brep = read_brep(TEXT)
    found = brep.matrix(brep.root.location) @ [*brep.shapes[brep.root.shape].point, 1]
    np.testing.assert_allclose(found, place, atol=1e-15)
    np.testing.assert_allclose(found, [0, 6, 0], atol=1e-15)


@pytest.mark.parametrize("vectors", [((0, 1, 0), (0, 0, 1)), ((0, 1, 0.25), (0.5, 0, 1))])
def test_a_body_extruded_twice_is_read(vectors):
    """Its vertices lie at products of two shifts."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        line = occ.addLine(occ.addPoint(0, 0, 0), occ.addPoint(1, 0, 0))
        sheet = next(tag for dimension, tag in occ.extrude([(1, line)], *vectors[0]) if dimension == 2)
        occ.extrude([(2, sheet)], *vectors[1])
        occ.synchronize()
        points = build_from_gmsh(name="body").patches["body"].control_points
    finally:
        gmsh.finalize()
    expected = UNIT @ np.array([(1, 0, 0), *vectors])
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-14)
