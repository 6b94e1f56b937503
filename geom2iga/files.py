"""geometry.h5: a model written and read back exactly."""

import io
import logging
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
from geom2iga.seal import ANEW, SIZE, check_no_folder, check_ours, seal, unsealed
from geom2iga.signals import uninterrupted
from geom2iga.temporary import temporary_path

log = logging.getLogger("geom2iga")

FORMAT, VERSION = "geom2iga geometry", 3


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that takes its name at the end, if no error came in between."""
    check_no_folder(path)
    temporary = temporary_path(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(temporary), temporary):
            error.filename = str(path)  # so that users read of no file that they never see
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def created(path: Path, form: str, version: int, stamp: str) -> Iterator[h5py.File]:
    """Fill one of our HDF5 files in memory, seal it, then write it: HDF5 itself dies of a full disk."""
    content = io.BytesIO()
    with uninterrupted(), h5py.File(content, "w", userblock_size=SIZE) as file:
        file.attrs.update({"format": form, "version": version, "stamp": stamp})
        yield file
    with content.getbuffer() as buffer:
        buffer[:SIZE] = seal(form, version, buffer[SIZE:])
        with replacing(path) as temporary:
            temporary.write_bytes(buffer)


@contextmanager
def opened(path: Path, form: str, version: int, stamp: str | None = None, remedy: str = ANEW) -> Iterator[h5py.File]:
    """Open one of our HDF5 files for reading, once it is known to be whole: HDF5 itself may die of a damaged one.

    Parameters
    ----------
    stamp : str
        What it must have been made from; None takes any.
    remedy : str
        What to do where it is not what it must be.

    Raises
    ------
    CaseError
        The file is missing, unreadable, of another format, version or stamp, damaged or incomplete.
    """
    with unsealed(path, form, version, remedy) as content, uninterrupted():
        try:
            with h5py.File(content) as file:
                if stamp not in (None, file.attrs["stamp"]):
                    raise CaseError(f"{path}: made from another case, or from this one before it changed; {remedy}")
                yield file
        except (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
            raise CaseError(f"{path}: damaged ({' '.join(str(error).split())}); {remedy}") from None


def check_stamp(path: Path, form: str, version: int, stamp: str, remedy: str) -> None:
    """Raise CaseError where a file is not whole or not made from what it should be."""
    with opened(path, form, version, stamp, remedy):
        pass


def read_stamp(path: Path, form: str, version: int) -> str | None:
    """Return what a file says it was made from; None where there is no such file, or one that cannot be believed.

    Raises
    ------
    CaseError
        A folder or somebody else's file has its name, so that none can be made anew.
    """
    check_ours(path)
    if not os.path.lexists(path):
        return None
    try:
        with opened(path, form, version, remedy="it is not used") as file:
            return str(file.attrs["stamp"])
    except CaseError as error:
        log.warning("%s", error)
        return None


def write_model(path: str | Path, model: Model, stamp: str = "") -> None:
    """Write a model to geometry.h5; the file appears under its name only when it is whole."""
    with created(Path(path), FORMAT, VERSION, stamp) as file:
        put_model(file, model)


def read_model(path: str | Path, stamp: str | None = None, remedy: str = ANEW) -> Model:
    """Read geometry.h5; raise CaseError where it is missing, damaged or, given a stamp, made from something else."""
    with opened(Path(path), FORMAT, VERSION, stamp, remedy) as file:
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
