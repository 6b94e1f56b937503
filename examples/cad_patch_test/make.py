"""Makes lower.step and upper.step: two boxes, cut obliquely into four and into two blocks."""

from pathlib import Path

import gmsh

FOLDER = Path(__file__).parent


def cut(name: str, box: tuple[float, ...], cuts: list[list[tuple[float, float]]]) -> None:
    """Write a box as STEP, fragmented along vertical planes through pairs of points (x, y)."""
    occ = gmsh.model.occ
    gmsh.model.add(name)
    volume = occ.addBox(*box)
    planes = []
    for (x0, y0), (x1, y1) in cuts:
        line = occ.addLine(occ.addPoint(x0, y0, box[2]), occ.addPoint(x1, y1, box[2]))
        planes += [entity for entity in occ.extrude([(1, line)], 0, 0, box[5]) if entity[0] == 2]
    occ.fragment([(3, volume)], planes)
    occ.synchronize()
    volumes = gmsh.model.getEntities(3)
    occ.remove([entity for entity in gmsh.model.getEntities(2) if not gmsh.model.getAdjacencies(*entity)[0].size])
    occ.synchronize()
    gmsh.write(str(FOLDER / f"{name}.step"))
    print(f"{name}.step: {len(volumes)} volumes")


gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
cut("lower", (0, 0, 0, 2, 2, 1), [[(0.9, 0), (1.2, 2)], [(0, 1.1), (2, 0.8)]])
cut("upper", (0.5, 0.5, 1, 1, 1, 1), [[(0.9, 0.5), (1.2, 1.5)]])
gmsh.finalize()
