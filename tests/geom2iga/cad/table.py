"""The table of what converts, and how exactly: all CAD models of the tests.

python -m tests.geom2iga.cad.table                                prints it
python -m tests.geom2iga.cad.table tests/geom2iga/cad/README.md   puts it between the marks in a file
"""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import numpy as np

from geom2iga import build
from geom2iga.build import build_from_gmsh
from geom2iga.errors import GeometryError
from geom2iga.model import Model
from tests.geom2iga.cad.models import MODELS
from tests.geom2iga.cad.registry import CadModel, make_here, written

MARKS = ("<!-- table -->", "<!-- end of table -->")
HEADER = (
    "model", "by", "patches", "degrees", "off the CAD faces", "smallest det J", "volume", "volume off", "milliseconds"
)  # fmt: skip


def converted(known: CadModel, folder: Path) -> tuple[Model, str, float]:
    """Convert a model the way it travels; return what was said against exactness, and the time taken."""
    keys = {"name": "body", "max_degree": 12} if known.bodies == 1 else {"max_degree": 12}
    if known.bodies > 1:
        keys["bodies"] = [{"name": f"body-{tag}", "tags": [tag]} for tag in range(1, known.bodies + 1)]
    path = written(known, folder) if known.suffix else None
    if path is None:
        make_here(known)

    def make(exact: bool) -> Model:
        if path is not None:
            return build({"geometry": {"cad": [{"file": str(path), "exact": exact, **keys}]}})
        return build_from_gmsh(exact=exact, **keys)

    began = time.perf_counter()
    try:
        return make(True), "", time.perf_counter() - began
    except GeometryError:
        began = time.perf_counter()
        return make(False), " (fitted)", time.perf_counter() - began


def row(known: CadModel, folder: Path) -> list[str]:
    """One row of the table."""
    gmsh.model.add(known.name)
    model, remark, seconds = converted(known, folder)
    gmsh.model.remove()
    certificates = model.certificates.values()
    points = np.concatenate([patch.control_points.reshape(-1, 3) for patch in model.patches.values()])
    off = max(each.distance for each in certificates) / np.ptp(points, axis=0).max()
    bounds = [each.jacobian.relative_bound for each in certificates]
    volume = sum(each.volume for each in certificates)
    degrees = sorted({degree for patch in model.patches.values() for degree in patch.degrees})
    return [
        known.name.replace("_", " "),
        known.suffix.lstrip(".") or "gmsh",
        str(len(model.patches)),
        " ".join(map(str, degrees)),
        f"{off:.0e}{remark}",
        "not proven" if None in bounds else f">= {min(bounds):.2g}",
        f"{volume:.12g}",
        "" if known.volume is None else f"{abs(volume / known.volume - 1):.0e}",
        f"{1000 * seconds:.0f}",
    ]


def main() -> None:
    """Print the table, or put it into the file named on the command line."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    with TemporaryDirectory() as folder:
        rows = [row(known, Path(folder)) for known in MODELS.values()]
    gmsh.finalize()
    text = "\n".join("| " + " | ".join(cells) + " |" for cells in [HEADER, ["---"] * len(HEADER), *rows])
    if len(sys.argv) == 1:
        print(text)
    for name in sys.argv[1:]:
        before, rest = Path(name).read_text(encoding="utf-8").split(MARKS[0])
        after = rest.split(MARKS[1])[1]
        Path(name).write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
