"""The command geom2iga: case file to geometry.h5."""

import hashlib
import time
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Any

from geom2iga.build import build
from geom2iga.case import GeometryCase
from geom2iga.files import FORMAT, VERSION, read_model, read_stamp, write_model
from geom2iga.model import Model
from geom2iga.stage import Stage, discard, fingerprint, log, run_command
from geom2iga.tables import Case, checked

FILE = "geometry.h5"


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the [geometry] table and the CAD files that it names."""
    geometry = checked(case, GeometryCase).geometry
    files = [case.folder / body.file for body in geometry.cad]
    contents = [hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None for file in files]
    return fingerprint(geometry.model_dump(), contents)


def run(case: Case, folder: Path, stamp: str) -> None:
    """Build the model and write geometry.h5."""
    began = time.perf_counter()
    model = build(case)
    write_model(folder / FILE, model, stamp)
    discard(folder)
    log.info("geom2iga: %s, %.2f s", describe(model), time.perf_counter() - began)


def describe(model: Model) -> str:
    """One line on what a model holds."""
    parts = [f"{body} {_mesh(model, body)}" for body in model.bodies]
    return f"{len(parts)} bodies: {', '.join(parts)}"


def _mesh(model: Model, body: str) -> str:
    patch = model.patches[model.bodies[body][0]]
    spans = " x ".join(str(len(at) - 1) for at in patch.breaks)
    degrees = str(patch.degrees[0]) if len(set(patch.degrees)) == 1 else str(patch.degrees)
    return f"(degree {degrees}, {spans} spans)"


def summary(folder: Path) -> Mapping[str, Any]:
    """What geometry.h5 holds."""
    model = read_model(folder / FILE)
    return {
        "status": "done",
        "patches": {
            name: {
                "degrees": patch.degrees,
                "spans": [len(at) - 1 for at in patch.breaks],
                "control_points": prod(patch.shape),
            }
            for name, patch in model.patches.items()
        },
        "bodies": {name: list(patches) for name, patches in model.bodies.items()},
        "faces": list(model.groups),
    }


STAGE = Stage(
    "geom2iga",
    GeometryCase,
    stamp,
    lambda folder: read_stamp(folder / FILE, FORMAT, VERSION),
    lambda case: describe(build(case)),
    run,
    summary,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Turn the geometry of a case file into trivariate NURBS patches.", [STAGE], arguments)


if __name__ == "__main__":
    raise SystemExit(main())
