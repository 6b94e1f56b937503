"""The files that lie beside a mutant of a case: a CAD file, a volume of G+Smo, and some that are neither."""

import os
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

import gmsh

from geom2iga.exchange.gismo import write_gismo
from tests.cases import block_patch, model_of
from tests.robustness.streams import written_to

FILES = ("boxes.step", "boxes.brep", "cap.xml", "loop.step", "empty.step", "folder.step", "queue.xml", "script.geo")


@cache
def _contents() -> dict[str, bytes]:
    """Make the files that hold something, once."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
            gmsh.model.occ.addBox(1.2, 0, 0, 1, 1, 1)
            gmsh.model.occ.synchronize()
            with TemporaryFile() as said, written_to(said.fileno()):
                for ending in ("step", "brep"):
                    gmsh.write(str(folder / f"boxes.{ending}"))
        finally:
            gmsh.finalize()
        cap = block_patch("cap", origin=(1.4, 0.2, 1.0), size=(0.6, 0.6, 0.6), degree=2)
        write_gismo(folder / "cap.xml", model_of(cap))
        (folder / "script.geo").write_text(
            'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n', encoding="utf-8"
        )
        return {path.name: path.read_bytes() for path in folder.iterdir()}


def lay_out(folder: Path) -> None:
    """Write all of FILES into a folder."""
    for name, content in _contents().items():
        (folder / name).write_bytes(content)
    (folder / "loop.step").symlink_to("loop.step")
    (folder / "empty.step").write_bytes(b"")
    (folder / "folder.step").mkdir()
    os.mkfifo(folder / "queue.xml")
