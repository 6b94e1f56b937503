"""VTU files of sampled fields, for ParaView.

Arrays stand one after the other behind the header, as they are in memory (format "appended", encoding "raw"), so that
they can be filled slab by slab, and nothing is spent on text or compression.
"""

import sys
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from geom2iga.files import replacing
from geom2iga.model import Model
from geom2iga.progress import progress
from post.fields import BodySamples, ContactSamples, Samples
from post.grid import count_points

Found = TypeVar("Found")
Put = Callable[[str, int, NDArray[Any]], None]

BODY_FIELDS = {"displacement": 3, "stress": 6, "von_mises": 1, "principal_stress": 3, "hydrostatic_pressure": 1}
CONTACT_FIELDS = {"pressure": 1, "gap": 1, "normal": 3, "displacement": 3}
KINDS = {8: 12, 4: 9, 1: 1}  # VTK's number of a cell of so many corners
NAMES = {"f": "Float", "i": "Int", "u": "UInt"}  # of numpy's kinds of numbers
LENGTH = np.dtype(np.uint64)  # of an array in bytes, stands before it


class Column(NamedTuple):
    """An array of a file: `width` numbers for each point or cell."""

    section: str  # "Points", "Cells", "PointData" or "CellData"
    name: str
    kind: np.dtype
    width: int
    rows: int

    @property
    def row(self) -> int:
        """Length of a row [bytes]."""
        return self.kind.itemsize * self.width

    @property
    def size(self) -> int:
        """Length with what stands before it [bytes]."""
        return LENGTH.itemsize + self.row * self.rows


@progress("bodies.vtu")
def write_bodies(path: Path, samples: Samples, look: Callable[[str, BodySamples], Found]) -> list[Found]:
    """Write the undeformed bodies: the fields as point data, stress as xx yy zz xy yz xz; cell data body.

    The number of a body is its place in the case file, from 0.

    Parameters
    ----------
    look :
        Called with the name of a patch and samples of a slab of it, for all slabs of all patches.

    Returns
    -------
    list
        What it returned.
    """
    model, found = samples.result.model, []
    numbers = model.body_numbers

    def parts() -> Iterator[tuple[str, int, BodySamples]]:
        for name, part in samples.slabs(model.bodies):
            found.append(look(name, part))
            yield name, numbers[name], part

    with opened(path, body_columns(model, samples.count)) as put:
        put("samples", 0, np.array([samples.count]))
        fill(put, BODY_FIELDS, parts(), "body")
    return found


def body_columns(model: Model, samples: int) -> tuple[Column, ...]:
    """Lay out the file of the bodies."""
    counts = [count_points(patch, samples) for patch in model.patches.values()]
    return lay_out(sum(p for p, _ in counts), sum(c for _, c in counts), 8, BODY_FIELDS, "body")


def write_contact(path: Path, samples: Samples) -> None:
    """Write the undeformed secondary faces: point data pressure, gap, normal, displacement; cell data face."""
    parts = samples.secondary
    points, cells = sum(len(part.points) for part in parts), sum(len(part.cells) for part in parts)
    with opened(path, lay_out(points, cells, 4, CONTACT_FIELDS, "face")) as put:
        put("samples", 0, np.array([samples.count]))
        fill(put, CONTACT_FIELDS, ((number, number, part) for number, part in enumerate(parts)), "face")


def lay_out(points: int, cells: int, corners: int, fields: Mapping[str, int], number: str) -> tuple[Column, ...]:
    """Lay out a file.

    Only the first array has not a multiple of four bytes, and the last: meshio rewrites offsets into multiples of four
    while it reads, and takes those that are such already for rewritten ones.
    """
    real, small = np.dtype(np.float64), np.dtype(np.uint8)
    whole = np.dtype(np.int32 if max(points, cells * corners) <= np.iinfo(np.int32).max else np.int64)
    return (
        Column("FieldData", "samples", small, 1, 1),
        Column("Points", "Points", real, 3, points),
        Column("Cells", "connectivity", whole, corners, cells),
        Column("Cells", "offsets", whole, 1, cells),
        *(Column("PointData", name, real, width, points) for name, width in fields.items()),
        Column("CellData", number, np.dtype(np.int32), 1, cells),
        Column("Cells", "types", small, 1, cells),
    )


def fill(
    put: Put,
    fields: Mapping[str, int],
    parts: Iterable[tuple[Hashable, int, BodySamples | ContactSamples]],
    number: str,
) -> None:
    """Put parts below each other; those of one key, in a row, share the numbering of their points."""
    point = cell = base = 0
    last: Hashable = None
    for key, value, part in parts:
        base, last = base if key == last else point, key
        count, corners = part.cells.shape
        put("Points", point, part.points)
        for name in fields:
            put(name, point, getattr(part, name))
        put("connectivity", cell, part.cells + base)
        put("offsets", cell, np.arange(cell + 1, cell + count + 1) * corners)
        put("types", cell, np.full(count, KINDS[corners]))
        put(number, cell, np.full(count, value))
        point, cell = point + len(part.points), cell + count


@contextmanager
def opened(path: Path, columns: Sequence[Column]) -> Iterator[Put]:
    """Yield what puts rows of an array, from a number on, into a file that is whole at the end."""
    header = _header(columns).encode()
    ends = len(header) + np.cumsum([column.size for column in columns])
    starts = {column.name: int(end) - column.row * column.rows for column, end in zip(columns, ends, strict=True)}
    by_name = {column.name: column for column in columns}
    with replacing(path) as temporary, open(temporary, "wb") as file:

        def put(name: str, row: int, values: NDArray[Any]) -> None:
            column = by_name[name]
            file.seek(starts[name] + row * column.row)
            file.write(np.ascontiguousarray(values, column.kind).data)

        file.write(header)
        for column in columns:
            file.seek(starts[column.name] - LENGTH.itemsize)
            file.write(LENGTH.type(column.row * column.rows).tobytes())
        yield put
        file.seek(int(ends[-1]))
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def _header(columns: Sequence[Column]) -> str:
    """The part of a file before its arrays."""
    order, length = f"{sys.byteorder.capitalize()}Endian", f"UInt{8 * LENGTH.itemsize}"
    rows = {column.name: column.rows for column in columns}
    sections: dict[str, list[str]] = {}
    offset = 0
    for column in columns:
        kind = f"{NAMES[column.kind.kind]}{8 * column.kind.itemsize}"
        width = f' NumberOfComponents="{column.width}"' if column.width > 1 and column.section != "Cells" else ""
        count = f' NumberOfTuples="{column.rows}"' if column.section == "FieldData" else ""
        array = f'<DataArray type="{kind}" Name="{column.name}"{width}{count} format="appended" offset="{offset}"/>'
        sections.setdefault(column.section, []).append(array)
        offset += column.size
    field, *piece = ("\n".join([f"<{name}>", *arrays, f"</{name}>"]) for name, arrays in sections.items())
    return "\n".join(
        [
            f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="{length}">',
            "<UnstructuredGrid>",
            field,
            f'<Piece NumberOfPoints="{rows["Points"]}" NumberOfCells="{rows["types"]}">',
            *piece,
            "</Piece>",
            "</UnstructuredGrid>",
            '<AppendedData encoding="raw">',
            "_",
        ]
    )
