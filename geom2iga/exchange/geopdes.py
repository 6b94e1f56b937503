"""GeoPDEs: the text file of multipatch NURBS geometries, version 2.1."""

from collections.abc import Iterator
from pathlib import Path

from geom2iga.exchange.common import one_line, outer_faces, rows, side_number
from geom2iga.files import replacing
from geom2iga.model import Glued, Model
from geom2iga.patch import Patch


def write_geopdes(path: str | Path, model: Model) -> None:
    """Write a model for `mp_geo_load` of GeoPDEs.            geo_specs_mp_v21.txt of GeoPDEs 3

    Bodies become subdomains; groups become boundaries, numbered in the sequence of the model, every outer face in one.
    """
    with replacing(Path(path)) as temporary:
        temporary.write_text("\n".join(_lines(model)) + "\n", encoding="utf-8")


def _lines(model: Model) -> Iterator[str]:
    """Yield the file, some lines at a time."""
    numbers = {name: number for number, name in enumerate(model.patches, 1)}
    yield "# nurbs geometry v.2.1\n# written by geom2iga"
    yield f"3 3 {len(numbers)} {len(model.glued)} {len(model.bodies)}"
    for name, patch in model.patches.items():
        yield f"# {one_line(name)}\nPATCH {numbers[name]}"
        yield from _patch_lines(patch)
    for number, pair in enumerate(model.glued, 1):
        yield f"INTERFACE {number}"
        yield from (f"{numbers[face.patch]} {side_number(face)}" for face in (pair.first, pair.second))
        yield _match(pair)
    for number, (name, patches) in enumerate(model.bodies.items(), 1):
        yield f"SUBDOMAIN {number} ({one_line(name)})"
        yield " ".join(str(numbers[patch]) for patch in patches)
    for number, (name, faces) in enumerate(outer_faces(model).items(), 1):
        yield f"BOUNDARY {number} ({name})\n{len(faces)}"
        yield from (f"{numbers[face.patch]} {side_number(face)}" for face in faces)


def _patch_lines(patch: Patch) -> Iterator[str]:
    """Yield degrees, numbers of control points, knots, w x, w y, w z and w; the first direction runs fastest."""
    yield " ".join(map(str, patch.degrees))
    yield " ".join(map(str, patch.shape))
    yield from (rows(knots).strip() for knots in patch.knots)
    yield rows(patch.homogeneous.reshape(-1, 4, order="F").T).strip()


def _match(pair: Glued) -> str:
    """Say how two faces lie on each other: their directions in sequence or swapped (-1), alike or reversed (-1).

    GeoPDEs swaps, then reverses the second face as `oriented` does.                    mp_interface.m of GeoPDEs 3
    """
    return " ".join("-1" if pair.orientation & bit else "1" for bit in (1, 2, 4))
