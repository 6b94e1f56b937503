"""Our own files changed on purpose and sealed again: what a faulty program would write, not what damage makes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from geom2iga.seal import LINE, SIZE, seal


@contextmanager
def altered(path: Path) -> Iterator[h5py.File]:
    """Change what a sealed HDF5 file holds."""
    with h5py.File(path, "a") as file:
        yield file
    reseal(path)


def reseal(path: Path, later: int = 0, form: str | None = None) -> None:
    """Make the first block of a file fit its content again; as a version so much later, or as another form."""
    content = path.read_bytes()
    line = LINE.match(content)
    assert line
    block = seal(form or line[1].decode(), int(line[2]) + later, content[SIZE:])
    path.write_bytes(block + content[SIZE:])
