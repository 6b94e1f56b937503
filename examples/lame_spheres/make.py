"""Makes shells.step: a 24th of two hollow spheres in each other, between four planes through their centre."""

from itertools import pairwise
from math import pi
from pathlib import Path

import gmsh

FOLDER = Path(__file__).parent
RADII = 20.0, 30.0, 40.0


def sector(reach: float) -> int:
    """Make the pyramid 0 <= x <= z, 0 <= y <= z up to a height."""
    occ = gmsh.model.occ
    corners = [(0, 0), (reach, 0), (reach, reach), (0, reach)]
    apex = occ.addPoint(0, 0, 0)
    points = [occ.addPoint(x, y, reach) for x, y in corners]
    rising = [occ.addLine(apex, point) for point in points]
    rim = [occ.addLine(points[k], points[(k + 1) % 4]) for k in range(4)]
    loops = [occ.addCurveLoop([rising[k], rim[k], rising[(k + 1) % 4]]) for k in range(4)]
    faces = [occ.addPlaneSurface([loop]) for loop in (*loops, occ.addCurveLoop(rim))]
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))


def shell(inner: float, outer: float) -> None:
    """Cut a hollow sphere by the pyramid; the spheres are turned so that their poles and seams lie outside."""
    occ = gmsh.model.occ
    balls = [(3, occ.addSphere(0, 0, 0, radius)) for radius in (outer, inner)]
    occ.rotate(balls, 0, 0, 0, 0, 1, 0, pi / 2)
    hollow, _ = occ.cut(balls[:1], balls[1:])
    occ.intersect(hollow, [(3, sector(2 * outer))])


gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
for pair in pairwise(RADII):
    shell(*pair)
gmsh.model.occ.synchronize()
gmsh.write(str(FOLDER / "shells.step"))
print(f"shells.step: {len(gmsh.model.getEntities(3))} volumes, {len(gmsh.model.getEntities(2))} faces")
gmsh.finalize()
