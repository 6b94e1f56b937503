"""The command geom2iga: case file to geometry.h5."""

import hashlib
import time
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Any

from geom2iga.build import build
from geom2iga.cad.script import inputs
from geom2iga.case import GeometryCase
from geom2iga.display import counted
from geom2iga.errors import CaseError
from geom2iga.exchange.formats import EXPORTS
from geom2iga.files import FORMAT, VERSION, read_model, read_stamp, write_model
from geom2iga.model import Model
from geom2iga.patch import Patch
from geom2iga.quality.certificate import summarised
from geom2iga.signals import uninterrupted
from geom2iga.stage import Stage, discard, fingerprint, log, run_command
from geom2iga.tables import Case, checked

FILE = "geometry.h5"
PICTURES = ("geometry.png", "faces.png", "control_net.png")


def stamp(case: Case, folder: Path) -> str:
    """Fingerprint the [geometry] table, the CAD files that it names and what scripts among them include."""
    geometry = checked(case, GeometryCase).geometry
    files = [path for file in geometry.files for path in inputs(case.folder / file)]
    contents = [hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None for file in files]
    return fingerprint(geometry.model_dump(), contents)


def run(case: Case, folder: Path, stamp: str) -> None:
    """Build the model and write geometry.h5; what shows another geometry is removed."""
    began = time.perf_counter()
    model = build(case)
    _check_unchanged(case, folder, stamp)
    discard(folder)
    if (folder / FILE).exists():  # else they are not of an earlier run
        for name in (*PICTURES, *(export.file for export in EXPORTS.values())):
            (folder / name).unlink(missing_ok=True)
    write_model(folder / FILE, model, stamp)
    for body in model.bodies:
        log.info("%s", describe(model, body))
    log.info("geom2iga: %s, %.2f s", count(model), time.perf_counter() - began)


def _check_unchanged(case: Case, folder: Path, before: str) -> None:
    """Raise CaseError where a CAD file changed: nobody knows which of both was read."""
    if stamp(case, folder) != before:
        raise CaseError("a CAD file was changed while it was read: run it again")


def count(model: Model) -> str:
    """One line on what a model holds."""
    points = sum(prod(patch.shape) for patch in model.patches.values())
    bodies, patches = counted(len(model.bodies), "body", "bodies"), counted(len(model.patches), "patch", "patches")
    return f"{bodies}, {patches}, {points} control points"


def describe(model: Model, body: str) -> str:
    """One line on a body: its mesh, and what is proven of its shape."""
    patches = [model.patches[name] for name in model.bodies[body]]
    known = [model.certificates[patch.name] for patch in patches if patch.name in model.certificates]
    return f"{body}: {_mesh(patches)}{'; ' if known else ''}{summarised(known) if known else ''}"


def _mesh(patches: Sequence[Patch]) -> str:
    """Number of patches, degrees and spans."""
    if len(patches) == 1:
        return patches[0].mesh
    degrees = " and ".join(map(str, sorted({degree for patch in patches for degree in patch.degrees})))
    spans = sum(prod(len(at) - 1 for at in patch.breaks) for patch in patches)
    return f"{len(patches)} patches, degree {degrees}, {spans} spans"


def plan(case: Case) -> str:
    """Say what would be built."""
    model = build(case)
    return "\n".join([count(model), *(describe(model, body) for body in model.bodies)])


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
                **(model.certificates[name].data if name in model.certificates else {}),
            }
            for name, patch in model.patches.items()
        },
        "bodies": {name: list(patches) for name, patches in model.bodies.items()},
        "glued": len(model.glued),
        "faces": list(model.groups),
    }


def flags(parser: ArgumentParser) -> None:
    """Add the flags for pictures of the geometry and for files of other programs."""
    parser.add_argument("--plot", action="store_true", help="draw patches, control net and named faces")
    parser.add_argument("--export", choices=EXPORTS, metavar="FORMAT", help=f"write {', '.join(EXPORTS)} files, too")


def extra(case: Case, folder: Path, options: Any) -> None:
    """Draw and export geometry.h5."""
    if not (options.plot or options.export):
        return
    model = read_model(folder / FILE)
    names = []
    if options.export:
        export = EXPORTS[options.export]
        export.write(folder / export.file, model)
        names.append(export.file)
    if options.plot:
        with uninterrupted():
            from geom2iga.picture.plot import draw_geometry  # takes a second to import

        names += draw_geometry(model, folder, checked(case, GeometryCase).units.length)
    log.info("geom2iga: %s", ", ".join(names))


STAGE = Stage(
    "geom2iga",
    GeometryCase,
    stamp,
    lambda folder: read_stamp(folder / FILE, FORMAT, VERSION),
    plan,
    run,
    summary,
    flags,
    extra,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command("Turn the geometry of a case file into trivariate NURBS patches.", [STAGE], arguments)


if __name__ == "__main__":
    raise SystemExit(main())
