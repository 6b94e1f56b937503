"""The [[verify]] entries: computed against known answers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geom2iga.bspline import Array
from geom2iga.errors import CaseError, suggestion
from geom2iga.model import Model
from geom2iga.tables import Source, checked
from post.case import ON_CONTACTS, PostCase, Verify
from post.fields import BodySamples, Samples
from post.grid import choose_samples
from post.quantities import QUANTITIES
from solve.case import Contact
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


class Worst(NamedTuple):
    """Where a quantity differs most from its exact value."""

    difference: float  # not a number where the quantity is none
    found: Array  # (k,)


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
        An entry that names something the model does not have, or quantities of a contact where no sides are opposite.
    """
    case = checked(source, PostCase)
    result.check_converged()
    model, entries = result.model, case.verify
    check_names(model, [contact.definition for contact in result.pairs], entries)
    samples = Samples(result, case.post.samples or choose_samples(model))
    bodies = [body for body in model.bodies if any(_concerns(entry, body) for entry in entries)]
    return compare(samples, entries, [look_at(model, entries, name, part) for name, part in samples.slabs(bodies)])


def look_at(model: Model, entries: Sequence[Verify], name: str, part: BodySamples) -> Mapping[int, Worst]:
    """Compare some samples of a patch with the entries that concern its body: what differs most, by number of entry."""
    body = model.body_of(name)
    concerned = [number for number, entry in enumerate(entries) if _concerns(entry, body)]
    return {number: _worst(entries[number], _quantity(part, entries[number].quantity)) for number in concerned}


def compare(samples: Samples, entries: Sequence[Verify], looks: Sequence[Mapping[int, Worst]]) -> tuple[Check, ...]:
    """Compare faces and contacts with the entries, and add what was found when looking at all patches."""
    checks = []
    for number, entry in enumerate(entries):
        found = [look[number] for look in looks if number in look]
        found += [_worst(entry, values) for values in _values(samples, entry) if len(values)]
        if not found:
            raise CaseError(f"verify[{number}]: the sides of the contact lie opposite at no sample point")
        difference, values = max(found, key=lambda worst: np.inf if np.isnan(worst.difference) else worst.difference)
        checks.append(
            Check(
                quantity=entry.quantity,
                on=entry.on,
                expected=list(entry.value) if isinstance(entry.value, tuple) else entry.value,
                found=values.tolist() if isinstance(entry.value, tuple) else float(values[0]),
                difference=difference,
                tolerance=entry.tolerance,
                passed=difference <= entry.tolerance,
                source=entry.source,
            )
        )
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


def _concerns(entry: Verify, body: str) -> bool:
    """Whether an entry asks for all sample points of a body."""
    return entry.quantity not in ON_CONTACTS and entry.on in (None, body)


def _worst(entry: Verify, values: Array) -> Worst:
    """Find where values (q,) or (q, k) differ most."""
    rows = values.reshape(len(values), -1)
    difference = np.abs(rows - np.array(entry.value)).max(axis=1)
    worst = int(np.argmax(difference))  # of a value that is no number where there is one
    return Worst(float(difference[worst]), rows[worst])


def _quantity(part: BodySamples, quantity: str) -> Array:
    """The values (q,) or (q, k) of a quantity."""
    return QUANTITIES[quantity].values(part) if quantity in QUANTITIES else np.asarray(getattr(part, quantity))


def _values(samples: Samples, entry: Verify) -> Iterator[Array]:
    """Yield arrays (q,) or (q, k) of a quantity on the faces or contacts that an entry names."""
    if entry.quantity in ON_CONTACTS:
        yield from _contact_values(samples, entry)
        return
    for face in samples.result.model.groups.get(entry.on or "", ()):
        yield _quantity(samples.face(face), entry.quantity)


def _contact_values(samples: Samples, entry: Verify) -> Iterator[Array]:
    """Yield a quantity of each contact; fields only where the primary side lies opposite."""
    whole = {"penetration": "penetration", "contact_area": "area", "contact_force": "force", "contact_moment": "moment"}
    for contact in (c for c in samples.result.pairs if entry.on in (None, c.definition.secondary)):
        if entry.quantity in whole:
            yield np.atleast_1d(getattr(contact, whole[entry.quantity]))[None]
            continue
        parts = samples.contacts[contact]
        if entry.quantity == "pressure_max":
            yield np.array([max(part.pressure.max() for part in parts)])
        else:
            yield from (getattr(part, entry.quantity)[~np.isnan(part.gap)] for part in parts)
