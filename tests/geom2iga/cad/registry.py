"""What is known of a CAD model of the tests, and how it travels to the converter."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gmsh


@dataclass(frozen=True)
class CadModel:
    """A model and what is known of it.

    Parameters
    ----------
    make :
        Builds the shapes in the current gmsh model, given `gmsh.model.occ`.
    patches :
        Number of volumes; 0 if the model cannot be converted.
    volume :
        Of all together [length³], or None where only OpenCASCADE knows.
    bodies :
        1: faces in the same place are to be glued. More: each volume is a body, and nothing is glued.
    glued :
        Number of faces that two volumes share.
    message :
        What the error says (a regular expression), under `exact = true` where there are patches; None if all is exact.
    suffix :
        Of the file by which it travels; empty if it is handed over in the open gmsh model.
    write :
        Writes that file, given its path, where `make` and gmsh do not.
    """

    name: str
    make: Callable[[Any], object]
    patches: int
    volume: float | None
    bodies: int = 1
    glued: int = 0
    message: str | None = None
    suffix: str = ""
    write: Callable[[Path], object] | None = None


class Registry(dict[str, CadModel]):
    """Models by name."""

    def enter(self, name: str, make: Callable[[Any], object], patches: int, volume: float | None, **known: Any) -> None:
        """Enter a model under a name of its own."""
        assert name not in self, f"two models are called {name}"
        self[name] = CadModel(name, make, patches, volume, **known)

    def entry(self, patches: int, volume: float | None, **known: Any) -> Callable:
        """Enter a function under its own name."""

        def decorate(make: Callable[[Any], object]) -> Callable[[Any], object]:
            self.enter(make.__name__, make, patches, volume, **known)
            return make

        return decorate

    def by_file(self, name: str, suffix: str) -> None:
        """Enter a model once more, to travel by a file."""
        way = f"{name}_by_{suffix.lstrip('.')}"
        assert way not in self, f"two models are called {way}"
        self[way] = replace(self[name], name=way, suffix=suffix)


def make_here(model: CadModel) -> None:
    """Build a model in the current gmsh model."""
    model.make(gmsh.model.occ)
    gmsh.model.occ.synchronize()


def written(model: CadModel, folder: Path) -> Path:
    """Write the file by which a model travels; the current gmsh model stays as it is."""
    path = folder / f"{model.name}{model.suffix}"
    if model.write is not None:
        model.write(path)
        return path
    before = gmsh.model.getCurrent()
    gmsh.model.add("to be written")
    make_here(model)
    gmsh.write(str(path))
    gmsh.model.remove()
    gmsh.model.setCurrent(before)
    return path


def open_here(model: CadModel, folder: Path) -> None:
    """Bring a model into the current gmsh model the way it travels; what one body's volumes share is shared."""
    if not model.suffix:
        make_here(model)
        return
    gmsh.merge(str(written(model, folder)))
    if model.bodies == 1:
        gmsh.model.occ.removeAllDuplicates()
        gmsh.model.occ.synchronize()
