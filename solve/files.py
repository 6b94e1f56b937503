"""solution.h5: a result written and read back exactly."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from geom2iga.files import created, get_model, opened, put_model
from solve.case import Contact
from solve.material import Material
from solve.newton import Status, Step
from solve.reactions import Reaction
from solve.result import ContactResult, Result, State

FORMAT, VERSION = "geom2iga solution", 4


def write_result(path: str | Path, result: Result, stamp: str = "") -> None:
    """Write a result to solution.h5, with its model; the file appears under its name only when it is whole."""
    with created(Path(path), FORMAT, VERSION, stamp) as file:
        file.attrs["status"] = result.status.name
        file.attrs["statistics"] = json.dumps(dict(result.statistics))
        file.attrs["materials"] = json.dumps({name: asdict(m) for name, m in result.materials.items()})
        file.attrs["history"] = json.dumps([asdict(step) for step in result.history])
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


def read_result(path: str | Path) -> Result:
    """Read solution.h5; raise CaseError where it is missing or damaged."""
    with opened(Path(path), FORMAT, VERSION) as file:
        states = [file[f"states/{n}"] for n in range(len(file.get("states", ())))]
        return Result(
            Status[file.attrs["status"]],
            get_model(file["model"]),
            {name: Material(**values) for name, values in json.loads(file.attrs["materials"]).items()},
            tuple(
                State(**_get(group, STATE), contacts=_contacts(group), reactions=_get_reactions(group["reactions"]))
                for group in states
            ),
            tuple(Step(**step) for step in json.loads(file.attrs["history"])),
            json.loads(file.attrs["statistics"]),
        )


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
