"""How long 100 hexahedral volumes that are open in gmsh take to become glued patches with certificates.

OMP_NUM_THREADS=1 python tests/benchmarks/hundred_volumes.py

Does not measure the making of the volumes in gmsh, nor of files.
"""

import statistics
import time
from itertools import product
from math import pi

import gmsh

from geom2iga import build_from_gmsh

REPEATS = 3


def boxes() -> None:
    """5 x 5 x 4 cubes."""
    occ = gmsh.model.occ
    volumes = [(3, occ.addBox(*place, 1, 1, 1)) for place in product(range(5), range(5), range(4))]
    occ.fragment(volumes[:1], volumes[1:])


def pipes() -> None:
    """5 rings of 20 sectors."""
    occ = gmsh.model.occ
    for height, number in product(range(5), range(20)):
        profile = [(2, occ.addRectangle(1, 0, height, 1, 1))]
        occ.rotate(profile, 1, 0, height, 1, 0, 0, pi / 2)
        occ.rotate(profile, 0, 0, 0, 0, 0, 1, number * pi / 10)
        occ.revolve(profile, 0, 0, 0, 0, 0, 1, pi / 10)
    volumes = occ.getEntities(3)
    occ.fragment(volumes[:1], volumes[1:])
    occ.removeAllDuplicates()


def main() -> None:
    """Print the median of some conversions of either model."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    for make in (boxes, pipes):
        gmsh.clear()
        make()
        gmsh.model.occ.synchronize()
        seconds = []
        for _ in range(REPEATS):
            began = time.perf_counter()
            model = build_from_gmsh(name="body", degree=2, spans=2)
            seconds.append(time.perf_counter() - began)
        print(
            f"{make.__name__}: {len(model.patches)} patches, {len(model.glued)} glued faces, "
            f"{statistics.median(seconds):.1f} s"
        )
    gmsh.finalize()


if __name__ == "__main__":
    main()
