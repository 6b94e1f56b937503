"""Makes punch.step: half a ball with a shank, cut into 11 blocks, the lowest of which is small as contact is."""

from math import pi
from pathlib import Path

import gmsh
import numpy as np

FOLDER = Path(__file__).parent
RADIUS, SHANK = 10.0, 6.0
HALF, DEPTH = 0.6, 5.0  # of the core, a cuboid below the centre of the ball
BEYOND = 2.0  # radii: how far out the planes go that cut the ball


def block(quad: np.ndarray) -> tuple[int, int]:
    """Make the block between a side (4, 3) of the core and the ball, between planes through the centre."""
    occ = gmsh.model.occ
    middle = quad.mean(axis=0)
    ends = quad, BEYOND * RADIUS * quad / np.linalg.norm(quad, axis=1)[:, None]
    rings = [[occ.addPoint(*corner) for corner in corners] for corners in ends]
    lows, highs = ([occ.addLine(ring[k], ring[(k + 1) % 4]) for k in range(4)] for ring in rings)
    rays = [occ.addLine(low, high) for low, high in zip(*rings, strict=True)]
    sides = [[lows[k], rays[(k + 1) % 4], highs[k], rays[k]] for k in range(4)]
    faces = [occ.addPlaneSurface([occ.addCurveLoop(lines)]) for lines in (lows, highs, *sides)]
    outside = [(3, occ.addVolume([occ.addSurfaceLoop(faces)]))]
    ball = (3, occ.addSphere(0, 0, 0, RADIUS))  # its poles on z, its seam over the positive x axis
    if abs(middle[0]) + abs(middle[1]) < HALF:
        occ.rotate([ball], 0, 0, 0, 0, 1, 0, -pi / 2)  # away from the lowest point
    else:
        occ.rotate([ball], 0, 0, 0, 0, 0, 1, np.arctan2(middle[1], middle[0]) + pi)
    return occ.intersect(outside, [ball])[0][0]


def main() -> None:
    """Cut the punch and write it."""
    occ = gmsh.model.occ
    a, d = HALF, DEPTH
    core = (3, occ.addBox(-a, -a, -d, 2 * a, 2 * a, d))
    around = np.array([(a, -a), (a, a), (-a, a), (-a, -a)])
    quads = [np.column_stack([around, np.full(4, -d)])]
    for k in range(4):
        (x, y), (u, v) = around[k], around[(k + 1) % 4]
        quads.append(np.array([(x, y, -d), (u, v, -d), (u, v, 0), (x, y, 0)]))
    occ.fragment([core], [block(quad) for quad in quads])
    occ.synchronize()
    tops = gmsh.model.getEntitiesInBoundingBox(-2 * RADIUS, -2 * RADIUS, -1e-3, 2 * RADIUS, 2 * RADIUS, 1e-3, 2)
    occ.extrude(tops, 0, 0, SHANK)
    occ.translate(occ.getEntities(3), 0, 0, RADIUS)  # the lowest point to z = 0
    occ.synchronize()
    gmsh.write(str(FOLDER / "punch.step"))
    print(f"punch.step: {len(gmsh.model.getEntities(3))} volumes")


gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
main()
gmsh.finalize()
