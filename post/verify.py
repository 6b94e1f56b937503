"""The [[verify]] entries: computed against known answers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from geom2iga.tables import Source, checked
from post.case import ON_CONTACTS, PostCase, Verify
from post.fields import BodySamples, sample_contact, sample_face, sample_patch
from solve.case import Contact
from solve.material import VOIGT
from solve.result import Result


@dataclass(frozen=True)
class Check:
    """One entry with what was found."""

    quantity: str
    on: str | None
    expected: float | list[float]
    found: float | list[float]  # where it differs most
    difference: float
    tolerance: float
    passed: bool
    source: str


def verify(result: Result, source: Source) -> tuple[Check, ...]:
    """Compare a result with the known answers of a case, at all sample points.

    Parameters
    ----------
    result : Result
        Converged.
    source : path, dict, Case or PostCase

    Raises
    ------
    CaseError
        An entry that names something the model does not have.
    """
    case = checked(source, PostCase)
    result.check_converged()
    check_names(result.model, [contact.definition for contact in result.pairs], case.verify)
    checks = []
    for entry in case.verify:
        parts = list(_values(result, entry, case.post.samples))
        values = np.concatenate([part.reshape(len(part), -1) for part in parts])
        difference = np.abs(values - np.array(entry.value)).max(axis=1)
        worst = int(np.argmax(np.where(np.isnan(difference), np.inf, difference)))
        found = values[worst].tolist() if isinstance(entry.value, tuple) else float(values[worst, 0])
        expected = list(entry.value) if isinstance(entry.value, tuple) else entry.value
        passed = bool(difference[worst] <= entry.tolerance)
        largest = float(difference[worst])
        checks.append(Check(entry.quantity, entry.on, expected, found, largest, entry.tolerance, passed, entry.source))
    return tuple(checks)


def check_names(model: Model, contacts: Sequence[Contact], entries: Sequence[Verify]) -> None:
    """Raise CaseError for an entry that names a body, face or contact that does not exist."""
    secondary = [contact.secondary for contact in contacts]
    for number, entry in enumerate(entries):
        of_contact = entry.quantity in ON_CONTACTS
        known = secondary if of_contact else [*model.bodies, *model.groups]
        if of_contact and not contacts:
            raise CaseError(f"verify[{number}]: {entry.quantity} needs a contact, the case has none")
        if entry.on is not None and entry.on not in known:
            what = "contact with the secondary face" if of_contact else "body or face"
            raise CaseError(f'verify[{number}]: there is no {what} "{entry.on}"; {suggestion(entry.on, known)}')


def _values(result: Result, entry: Verify, samples: int) -> Iterator[Array]:
    """Yield arrays (q,) or (q, k) of a quantity, one per patch, face or contact."""
    if entry.quantity in ON_CONTACTS:
        yield from _contact_values(result, entry, samples)
        return
    for part in _samples(result, entry.on, samples):
        if entry.quantity.startswith("stress_"):
            names = ["".join("xyz"[i] for i in pair) for pair in VOIGT]
            yield part.stress[:, names.index(entry.quantity.removeprefix("stress_"))]
        elif entry.quantity in ("ux", "uy", "uz"):
            yield part.displacement[:, "xyz".index(entry.quantity[1])]
        else:
            yield getattr(part, entry.quantity)


def _samples(result: Result, on: str | None, samples: int) -> Iterator[BodySamples]:
    """Sample a body, a face, or everything."""
    model = result.model
    for face in model.groups.get(on or "", ()):
        yield sample_face(result, face, samples)
    for body in model.bodies if on is None else [on] if on in model.bodies else []:
        for name in model.bodies[body]:
            yield sample_patch(result, name, samples)


def _contact_values(result: Result, entry: Verify, samples: int) -> Iterator[Array]:
    """Yield a quantity of each contact; fields only where the primary side lies opposite."""
    whole = {"penetration": "penetration", "contact_area": "area", "contact_force": "force", "contact_moment": "moment"}
    for contact in (c for c in result.pairs if entry.on in (None, c.definition.secondary)):
        if entry.quantity in whole:
            yield np.atleast_1d(getattr(contact, whole[entry.quantity]))[None]
            continue
        parts = sample_contact(result, contact, samples)
        if entry.quantity == "pressure_max":
            yield np.array([max(part.pressure.max() for part in parts)])
        else:
            yield from (getattr(part, entry.quantity)[~np.isnan(part.gap)] for part in parts)
