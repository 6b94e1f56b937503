"""summary.json and the tables that go with it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from geom2iga.bspline import Array
from post.fields import BodySamples, Samples
from post.verify import Check
from solve.output import write_rows
from solve.result import Result, carried, first_passes


class Extremes(NamedTuple):
    """Of some sample points of a body; where stress is not defined, it does not count."""

    displacement: float  # largest length
    lowest: Array  # (6,) stress
    highest: Array  # (6,) stress


def extremes_of(part: BodySamples) -> Extremes:
    """Find the extremes of some samples."""
    largest = float(np.linalg.norm(part.displacement, axis=1).max())
    return Extremes(largest, np.fmin.reduce(part.stress), np.fmax.reduce(part.stress))


def summarise(samples: Samples, checks: Sequence[Check], extremes: Mapping[str, Sequence[Extremes]]) -> dict[str, Any]:
    """Collect the numbers of a result; stresses are extremes over the sample points, given part by part."""
    result, statistics = samples.result, samples.result.statistics
    keys = ("dofs", "newton_iterations", "linear_iterations", "factorisations", "strain_energy", "equilibrium_error")
    return {
        "status": result.status.name.lower(),
        "diagnosis": result.diagnosis and asdict(result.diagnosis),
        **{key: statistics[key] for key in keys},
        "peak_memory": statistics["peak_memory"],
        "seconds": dict(statistics["seconds"]),
        "bodies": {body: _body(parts) for body, parts in extremes.items()},
        "patches": {name: certificate.data for name, certificate in result.model.certificates.items()},
        "contact": list(_contacts(samples)),
        "reactions": [
            {"on": reaction.on, "force": reaction.force.tolist(), "moment": reaction.moment.tolist()}
            for reaction in result.state.reactions
        ],
        "load_steps": load_steps(result),
        "verify": [asdict(check) for check in checks],
    }


def _body(parts: Sequence[Extremes]) -> dict[str, Any]:
    return {
        "displacement_max": max(part.displacement for part in parts),
        "stress_min": np.fmin.reduce([part.lowest for part in parts]).tolist(),
        "stress_max": np.fmax.reduce([part.highest for part in parts]).tolist(),
    }


def _contacts(samples: Samples) -> Iterator[dict[str, Any]]:
    for contact in samples.result.pairs:
        parts = samples.contacts[contact]
        gaps = np.concatenate([part.gap for part in parts])
        yield {
            **carried(contact),
            "method": contact.definition.method,
            "enforcement": contact.definition.enforcement,
            "pressure_max": max(float(part.pressure.max()) for part in parts),
            "gap_min": None if np.isnan(gaps).all() else float(np.nanmin(gaps)),
            "warnings": list(contact.warnings),
            "penalty": contact.penalty if np.isfinite(contact.penalty) else None,
        }


def load_steps(result: Result) -> list[dict[str, Any]]:
    """Say what each contact carries in each load step."""
    return [
        {"load_factor": state.load_factor, "contact": [carried(contact) for contact in first_passes(state.contacts)]}
        for state in result.states
    ]


def write_load_steps(path: Path, result: Result) -> None:
    """Write load_steps.csv, a row per load step and contact."""
    rows = [
        {
            "load_step": number,
            "load_factor": step["load_factor"],
            "secondary": values["secondary"],
            "primary": values["primary"],
            **_components("force", values["force"]),
            **_components("moment", values["moment"]),
            **{key: values[key] for key in ("area", "penetration", "active", "candidates")},
        }
        for number, step in enumerate(load_steps(result), start=1)
        for values in step["contact"]
    ]
    write_rows(path, list(rows[0]) if rows else ["load_step"], rows)


def write_reactions(path: Path, result: Result) -> None:
    """Write reactions.csv, a row per load step and support."""
    rows = [
        {
            "load_step": number,
            "load_factor": state.load_factor,
            "on": reaction.on,
            **_components("force", reaction.force),
            **_components("moment", reaction.moment),
        }
        for number, state in enumerate(result.states, start=1)
        for reaction in state.reactions
    ]
    write_rows(path, list(rows[0]), rows)


def _components(name: str, vector: Iterable[float]) -> dict[str, float]:
    """Columns of a vector."""
    return {f"{name}_{axis}": float(value) for axis, value in zip("xyz", vector, strict=True)}
