"""solution.h5: a result written and read back exactly."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from geom2iga.bspline import Array
from geom2iga.files import created, get_model, opened, put_model
from geom2iga.seal import ANEW
from solve.case import Contact
from solve.diagnosis import Diagnosis
from solve.material import Material
from solve.newton import Status, Step
from solve.reactions import Reaction
from solve.result import ContactResult, Result, State

FORMAT, VERSION = "geom2iga solution", 5


def write_result(path: str | Path, result: Result, stamp: str = "") -> None:
    """Write a result to solution.h5, with its model; the file appears under its name only when it is whole."""
    with created(Path(path), FORMAT, VERSION, stamp) as file:
        file.attrs["status"] = result.status.name
        file.attrs["statistics"] = json.dumps(dict(result.statistics))
        file.attrs["materials"] = json.dumps({name: asdict(m) for name, m in result.materials.items()})
        file.attrs["history"] = json.dumps([asdict(step) for step in result.history])
        file.attrs["diagnosis"] = json.dumps(result.diagnosis and asdict(result.diagnosis))
        put_model(file.create_group("model"), result.model)
        for number, state in enumerate(result.states):
            _put(file, f"states/{number}", state, STATE)
            for which, contact in enumerate(state.contacts):
                name = f"states/{number}/contacts/{which}"
                _put(file, name, contact, CONTACT)
                file[name].attrs["definition"] = contact.definition.model_dump_json()
                file[name].attrs["warnings"] = json.dumps(contact.warnings)
            _put_reactions(file.create_group(f"states/{number}/reactions"), state.reactions)


STATE = ("displacement", "load_factor")
CONTACT = (
    "penalty",
    "rows",
    "control_area",
    "centres",
    "control_gap",
    "pressure",
    "active",
    "force",
    "moment",
)


def read_result(path: str | Path, stamp: str | None = None, remedy: str = ANEW) -> Result:
    """Read solution.h5; raise CaseError where it is missing, damaged or, given a stamp, made from something else."""
    with opened(Path(path), FORMAT, VERSION, stamp, remedy) as file:
        groups = [file[f"states/{n}"] for n in range(len(file.get("states", ())))]
        result = Result(
            Status[file.attrs["status"]],
            get_model(file["model"]),
            {name: Material(**values) for name, values in json.loads(file.attrs["materials"]).items()},
            tuple(
                State(**_get(group, STATE), contacts=_contacts(group), reactions=_get_reactions(group["reactions"]))
                for group in groups
            ),
            tuple(Step(**step) for step in json.loads(file.attrs["history"])),
            json.loads(file.attrs["statistics"]),
            _diagnosis(json.loads(file.attrs["diagnosis"])),
        )
        for state in result.states:
            _check_state(state, result.space.size)
        return result


def _check_state(state: State, size: int) -> None:
    """Raise ValueError where a state does not fit a model of so many control points, or is not of finite numbers."""
    _check("load_factor", np.asarray(state.load_factor))
    _check("displacement", state.displacement, size, 3)
    for contact in state.contacts:
        for field in ("rows", "control_area", "control_gap", "pressure", "active"):
            _check(field, getattr(contact, field), len(contact.rows))
        _check("penalty", np.asarray(1 / contact.penalty))  # of a Lagrange multiplier it is infinite
        _check("centres", contact.centres, len(contact.rows), 3)
    carriers: tuple[ContactResult | Reaction, ...] = (*state.contacts, *state.reactions)
    for carrier in carriers:
        _check("force", carrier.force, 3)
        _check("moment", carrier.moment, 3)


def _check(name: str, array: Array, *shape: int) -> None:
    """Raise ValueError unless an array has a shape and finite entries."""
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has entries that are no finite numbers")


def _diagnosis(values: dict[str, Any] | None) -> Diagnosis | None:
    """Make a diagnosis of what was written of one."""
    if values is None:
        return None
    return Diagnosis(values["load_step"], values["load_steps"], tuple(values["seen"]), tuple(values["advice"]))


def _contacts(state: Any) -> tuple[ContactResult, ...]:
    """Read the contacts of a state."""
    groups = [state[f"contacts/{number}"] for number in range(len(state.get("contacts", ())))]
    return tuple(
        ContactResult(
            Contact.model_validate_json(group.attrs["definition"]),
            warnings=tuple(json.loads(group.attrs["warnings"])),
            **_get(group, CONTACT),
        )
        for group in groups
    )


def _put_reactions(group: Any, reactions: Sequence[Reaction]) -> None:
    """Write the reactions of a state, a row per support."""
    group.attrs["supports"] = json.dumps([(reaction.number, reaction.on) for reaction in reactions])
    for field in ("force", "moment"):
        group[field] = np.array([getattr(reaction, field) for reaction in reactions]).reshape(-1, 3)


def _get_reactions(group: Any) -> tuple[Reaction, ...]:
    """Read the reactions of a state."""
    rows = zip(json.loads(group.attrs["supports"]), group["force"][()], group["moment"][()], strict=True)
    return tuple(Reaction(number, on, force, moment) for (number, on), force, moment in rows)


def _put(file: Any, name: str, record: object, fields: tuple[str, ...]) -> None:
    group = file.create_group(name)
    for field in fields:
        group[field] = getattr(record, field)


def _get(group: Any, fields: tuple[str, ...]) -> dict[str, Any]:
    values = {field: group[field][()] for field in fields}
    return {field: value if isinstance(value, np.ndarray) else value.item() for field, value in values.items()}
