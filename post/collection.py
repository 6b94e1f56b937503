"""Load steps in a row, for ParaView: a .pvd file names a data file for each of them."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from geom2iga.files import replacing
from solve.result import Result


def write_collection(path: Path, steps: Iterable[tuple[float, str]]) -> None:
    """Write a .pvd file.

    Parameters
    ----------
    steps : pairs
        Time, here the number of the load step, and the name of a data file, seen from the folder of `path`.
    """
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for time, name in steps:
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(time)), part="0", file=str(name))
    ElementTree.indent(root)
    with replacing(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def results_of_steps(result: Result) -> Iterator[Result]:
    """Yield the result as it was after each load step that converged, the whole one last."""
    for count in range(1, len(result.states) + 1):
        yield replace(result, states=result.states[:count])
