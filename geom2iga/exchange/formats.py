"""The formats in which a model can be handed to other programs."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from geom2iga.exchange.geopdes import write_geopdes
from geom2iga.exchange.gismo import write_gismo
from geom2iga.exchange.mfem import write_mfem
from geom2iga.model import Model


class Export(NamedTuple):
    """A format: how its file is called in the output folder, and who writes it."""

    file: str
    write: Callable[[Path, Model], None]


EXPORTS = {
    "gismo": Export("geometry.xml", write_gismo),
    "mfem": Export("geometry.mesh", write_mfem),
    "geopdes": Export("geometry.txt", write_geopdes),
}
