"""geometry.h5: a model written and read back exactly."""

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from geom2iga.errors import CaseError
from geom2iga.model import Glued, Model
from geom2iga.patch import Face, Patch
from geom2iga.quality.certificate import Certificate
from geom2iga.quality.jacobian import Jacobian

FORMAT, VERSION = "geom2iga geometry", 2


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its name at the end, if no error came in between."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def created(path: Path, form: str, version: int, stamp: str) -> Iterator[h5py.File]:
    """Fill one of our HDF5 files in memory, then write it: HDF5 itself dies of a full disk."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file.attrs.update({"format": form, "version": version, "stamp": stamp})
        yield file
    with replacing(path) as temporary:
        temporary.write_bytes(content.getbuffer())


@contextmanager
def opened(path: Path, form: str, version: int) -> Iterator[h5py.File]:
    """Open one of our HDF5 files for reading.

    Raises
    ------
    CaseError
        The file is missing, unreadable, of another format or version, or incomplete.
    """
    try:
        with h5py.File(path) as file:
            found = (file.attrs.get("format"), file.attrs.get("version"))
            if found != (form, version):
                raise CaseError(f"{path}: expected {form} version {version}, found {found}; make it anew")
            yield file
    except FileNotFoundError:
        raise CaseError(f"{path}: no such file") from None
    except (AttributeError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
        raise CaseError(f"{path}: damaged ({error}); delete it and make it anew") from None


def read_stamp(path: Path, form: str, version: int) -> str | None:
    """Return what a file says it was made from; None where there is no such file or it cannot be read."""
    try:
        with opened(path, form, version) as file:
            return str(file.attrs["stamp"])
    except CaseError:
        return None


def write_model(path: str | Path, model: Model, stamp: str = "") -> None:
    """Write a model to geometry.h5; the file appears under its name only when it is whole."""
    with created(Path(path), FORMAT, VERSION, stamp) as file:
        put_model(file, model)


def read_model(path: str | Path) -> Model:
    """Read geometry.h5; raise CaseError where it is missing or damaged."""
    with opened(Path(path), FORMAT, VERSION) as file:
        return get_model(file)


def put_model(file: Any, model: Model) -> None:
    """Write a model into an open HDF5 group."""
    for place in ("patches", "bodies", "groups"):
        file.create_group(place)
    for number, (name, patch) in enumerate(model.patches.items()):
        group = _create(file, f"patches/{number}", name)
        group["degrees"] = patch.degrees
        for direction, knots in enumerate(patch.knots):
            group[f"knots_{direction}"] = knots
        group["control_points"] = patch.control_points
        group["weights"] = patch.weights
        if name in model.certificates:
            _put_certificate(group.create_group("certificate"), model.certificates[name])
    for number, (name, patches) in enumerate(model.bodies.items()):
        _create(file, f"bodies/{number}", name)["patches"] = _strings(patches)
    for number, (name, faces) in enumerate(model.groups.items()):
        group = _create(file, f"groups/{number}", name)
        _put_faces(group, faces)
    glued = file.create_group("glued")
    _put_faces(glued, [face for pair in model.glued for face in (pair.first, pair.second)])
    glued["orientation"] = np.array([pair.orientation for pair in model.glued], dtype=np.int64)


def get_model(file: Any) -> Model:
    """Read a model from an open HDF5 group."""
    patches, certificates = {}, {}
    for name, group in _named(file, "patches"):
        degrees = tuple(group["degrees"][()].tolist())
        knots = tuple(group[f"knots_{d}"][()] for d in range(len(degrees)))
        patches[name] = Patch(name, degrees, knots, group["control_points"][()], group["weights"][()])
        if "certificate" in group:
            certificates[name] = _get_certificate(group["certificate"])
    bodies = {name: tuple(group["patches"].asstr()[()]) for name, group in _named(file, "bodies")}
    groups = {name: tuple(_get_faces(group)) for name, group in _named(file, "groups")}
    faces = _get_faces(file["glued"])
    glued = map(Glued, faces[::2], faces[1::2], file["glued/orientation"][()].tolist())
    return Model(patches, bodies, groups, tuple(glued), certificates)


def _put_certificate(group: Any, certificate: Certificate) -> None:
    """Write a certificate as attributes; what is not known is left out."""
    for part, values in (("", vars(certificate)), ("jacobian_", vars(certificate.jacobian))):
        for key, value in values.items():
            if value is not None and key != "jacobian":
                group.attrs[part + key] = value


def _get_certificate(group: Any) -> Certificate:
    """Read a certificate."""
    values = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in group.attrs.items()}
    known: dict[str, Any] = {key: values.get(f"jacobian_{key}") for key in Jacobian.__dataclass_fields__}
    known |= {key: tuple(known[key]) for key in ("xi", "x")}
    rest: dict[str, Any] = {key: values.get(key) for key in Certificate.__dataclass_fields__ if key != "jacobian"}
    return Certificate(jacobian=Jacobian(**known), **rest)


def _put_faces(group: Any, faces: Sequence[Face]) -> None:
    """Write a list of faces into an HDF5 group."""
    group["patch"] = _strings([face.patch for face in faces])
    group["axis_side"] = np.array([(face.axis, face.side) for face in faces], dtype=np.int64).reshape(-1, 2)


def _get_faces(group: Any) -> list[Face]:
    """Read a list of faces from an HDF5 group."""
    sides = group["axis_side"][()].tolist()
    return [Face(patch, axis, side) for patch, (axis, side) in zip(group["patch"].asstr()[()], sides, strict=True)]


def _create(file: Any, place: str, name: str) -> Any:
    """Create a group that knows its name: any text can be a name, not any text can be a place."""
    group = file.create_group(place)
    group.attrs["name"] = name
    return group


def _named(file: Any, place: str) -> list[tuple[str, Any]]:
    """List the groups at a place with their names, in the sequence in which they were written."""
    groups = [file[f"{place}/{number}"] for number in range(len(file[place]))]
    return [(str(group.attrs["name"]), group) for group in groups]


def _strings(values: Sequence[str]) -> Any:
    """Make an array that h5py stores as text even where it is empty."""
    return np.array(values, dtype=h5py.string_dtype())
