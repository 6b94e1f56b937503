"""summary.json and history.csv."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from geom2iga.files import replacing
from post.fields import sample_contact, sample_patch
from post.verify import Check
from solve.newton import Step
from solve.result import Result


def summarise(result: Result, checks: Sequence[Check], samples: int) -> dict[str, Any]:
    """Collect the numbers of a result; stresses are extremes over the sample points."""
    statistics = result.statistics
    keys = ("dofs", "newton_iterations", "linear_iterations", "strain_energy", "equilibrium_error", "peak_memory")
    return {
        "status": result.status.name.lower(),
        **{key: statistics[key] for key in keys},
        "seconds": dict(statistics["seconds"]),
        "bodies": {body: _body(result, body, samples) for body in result.model.bodies},
        "patches": {name: certificate.data for name, certificate in result.model.certificates.items()},
        "contact": list(_contacts(result, samples)),
        "verify": [asdict(check) for check in checks],
    }


def _body(result: Result, body: str, samples: int) -> dict[str, Any]:
    parts = [sample_patch(result, name, samples) for name in result.model.bodies[body]]
    stress = np.concatenate([part.stress for part in parts])
    return {
        "displacement_max": max(float(np.linalg.norm(part.displacement, axis=1).max()) for part in parts),
        "stress_min": stress.min(axis=0).tolist(),
        "stress_max": stress.max(axis=0).tolist(),
    }


def _contacts(result: Result, samples: int) -> Any:
    for contact in result.contacts:
        parts = sample_contact(result, contact, samples)
        gaps = np.concatenate([part.gap for part in parts])
        yield {
            "secondary": contact.definition.secondary,
            "primary": contact.definition.primary,
            "force": contact.force.tolist(),
            "area": contact.area,
            "pressure_max": max(float(part.pressure.max()) for part in parts),
            "gap_min": None if np.isnan(gaps).all() else float(np.nanmin(gaps)),
            "active": int(contact.active.sum()),
            "penalty": contact.penalty,
        }


def write_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """Write summary.json."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def write_history(path: Path, history: Sequence[Step]) -> None:
    """Write history.csv, a row per Newton step."""
    with replacing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Step)])
        writer.writeheader()
        writer.writerows(asdict(step) for step in history)
