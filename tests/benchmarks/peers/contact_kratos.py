"""Kratos: hexahedra, mortar contact by augmented Lagrange multipliers, algebraic multigrid (amgcl).

python contact_kratos.py SPANS [tight]

The time and the memory are those of the process that imports Kratos, reads the mesh and solves; writing the mesh is not
counted. `tight` raises zero_tolerance_factor, without which its integrals leave out small pieces of overlap.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from two_blocks import POISSON, PRESSURE, STRESS, YOUNG, Block, blocks, report

TIGHT = 1e3  # zero_tolerance_factor; Kratos' own is 1


def listed(kind: str, lines: Any) -> str:
    """One list of the mesh file."""
    return f"Begin {kind}\n" + "\n".join(" ".join(map(str, line)) for line in lines) + f"\nEnd {kind.split()[0]}\n"


def part(name: str, **members: Any) -> str:
    """A group of nodes, elements or conditions."""
    inside = "".join(listed(f"SubModelPart{kind}", numbers[:, None].tolist()) for kind, numbers in members.items())
    return f"Begin SubModelPart {name}\n{inside}End SubModelPart\n"


def mesh(lower: Block, upper: Block) -> Iterator[str]:
    """The mesh file, part by part."""
    shift, later = len(lower.points), len(lower.elements)
    points = np.concatenate([lower.points, upper.points])
    elements = np.concatenate([lower.elements, upper.elements + shift]) + 1
    hexahedra = np.arange(len(elements)) + 1
    faces = {
        "Top": elements[later + upper.layer(True)][:, 4:],
        "Masters": elements[lower.layer(True)][:, 4:],
        "Slaves": elements[later + upper.layer(False)][:, 3::-1],
    }
    ends = np.cumsum([0, *map(len, faces.values())])
    numbers = {name: np.arange(ends[n], ends[n + 1]) + 1 for n, name in enumerate(faces)}
    yield "Begin ModelPartData\nEnd ModelPartData\nBegin Properties 0\nEnd Properties\n"
    yield listed("Nodes", ([n + 1, *point] for n, point in enumerate(points.tolist())))
    yield listed("Elements SmallDisplacementElement3D8N", with_numbers(hexahedra, elements))
    for name, each in faces.items():
        kind = "SurfaceLoadCondition3D4N" if name == "Top" else "SurfaceCondition3D4N"
        yield listed(f"Conditions {kind}", with_numbers(numbers[name], each))
    yield part("Body", Nodes=np.arange(len(points)) + 1, Elements=hexahedra, Conditions=np.arange(ends[-1]) + 1)
    near = np.concatenate([lower.layer(True), upper.layer(False) + later]) + 1
    yield part("Near", Nodes=np.unique(elements[near - 1]), Elements=near)
    for axis, name in enumerate("XYZ"):
        yield part(f"Held{name}", Nodes=np.flatnonzero(points[:, axis] < 1e-9) + 1)
    for name, each in faces.items():
        yield part(name, Nodes=np.unique(each), Conditions=numbers[name])
    sides = np.concatenate([faces["Masters"].ravel(), faces["Slaves"].ravel()])
    pair = np.concatenate([numbers["Masters"], numbers["Slaves"]])
    yield part("Pair", Nodes=np.unique(sides), Conditions=pair)


def with_numbers(numbers: Any, corners: Any) -> Iterator[list[int]]:
    """Number, property and nodes of each."""
    return ([n, 0, *each] for n, each in zip(numbers.tolist(), corners.tolist(), strict=True))


def process(module: str, package: str, **parameters: Any) -> dict[str, Any]:
    """An entry of a list of processes."""
    return {"python_module": module, "kratos_module": package, "Parameters": parameters}


def settings(tight: bool) -> dict[str, Any]:
    """The parameters of the analysis."""
    fix, load = "assign_vector_variable_process", "assign_scalar_variable_to_conditions_process"
    held = [
        process(
            fix,
            "KratosMultiphysics",
            model_part_name=f"Structure.Held{name}",
            variable_name="DISPLACEMENT",
            constrained=[axis == fixed for fixed in range(3)],
            value=[0.0 if axis == fixed else None for fixed in range(3)],
        )
        for axis, name in enumerate("XYZ")
    ]
    pressure = process(
        load,
        "KratosMultiphysics",
        model_part_name="Structure.Top",
        variable_name="POSITIVE_FACE_PRESSURE",
        value=PRESSURE,
    )
    contact = process(
        "alm_contact_process",
        "KratosMultiphysics.ContactStructuralMechanicsApplication",
        model_part_name="Structure",
        contact_model_part={"0": ["Pair"]},
        assume_master_slave={"0": ["Slaves"]},
        contact_type="Frictionless",
        **({"zero_tolerance_factor": TIGHT} if tight else {}),
    )
    return {
        "problem_data": {
            "problem_name": "blocks",
            "parallel_type": "OpenMP",
            "start_time": 0.0,
            "end_time": 1.0,
            "echo_level": 0,
        },
        "solver_settings": solver_settings(),
        "processes": {"constraints": held, "loads": [pressure], "contact": [contact]},
    }


def solver_settings() -> dict[str, Any]:
    """How it solves."""
    return {
        "model_part_name": "Structure",
        "domain_size": 3,
        "echo_level": 0,
        "solver_type": "Static",
        "analysis_type": "non_linear",
        "model_import_settings": {"input_type": "mdpa", "input_filename": "blocks"},
        "material_import_settings": {"materials_filename": "materials.json"},
        "contact_settings": {"mortar_type": "ALMContactFrictionless"},
        "time_stepping": {"time_step": 1.1},
        "convergence_criterion": "contact_residual_criterion",
        "max_iteration": 20,
        "linear_solver_settings": {"solver_type": "amgcl"},
    }


def materials() -> dict[str, Any]:
    """The material."""
    law = {"name": "KratosMultiphysics.StructuralMechanicsApplication.LinearElastic3DLaw"}
    variables = {"DENSITY": 1.0, "YOUNG_MODULUS": YOUNG, "POISSON_RATIO": POISSON}
    material = {"name": "M", "constitutive_law": law, "Variables": variables, "Tables": {}}
    return {"properties": [{"model_part_name": "Structure.Body", "properties_id": 1, "Material": material}]}


def solve() -> None:
    """Run the analysis in this folder; the process that is measured."""
    import KratosMultiphysics as Kratos
    import KratosMultiphysics.ContactStructuralMechanicsApplication
    from KratosMultiphysics.StructuralMechanicsApplication import structural_mechanics_analysis

    Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
    model, parameters = Kratos.Model(), Kratos.Parameters(Path("settings.json").read_text())
    structural_mechanics_analysis.StructuralMechanicsAnalysis(model, parameters).Run()
    structure = model["Structure"]
    info, variable = structure.ProcessInfo, Kratos.CAUCHY_STRESS_VECTOR
    elements = model["Structure.Near"].Elements
    stress = [list(point) for element in elements for point in element.CalculateOnIntegrationPoints(variable, info)]
    error = float(np.abs(np.array(stress) - STRESS).max() / PRESSURE)
    steps = int(info[Kratos.NL_ITERATION_NUMBER])
    Path("found.json").write_text(json.dumps({"error": error, "steps": steps}))


def main() -> None:
    """Write the input, run Kratos on it in a process of its own."""
    tight, script = "tight" in sys.argv[2:], str(Path(__file__).resolve())
    lower, upper = blocks()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "blocks.mdpa").write_text("".join(mesh(lower, upper)))
        (folder / "settings.json").write_text(json.dumps(settings(tight)))
        (folder / "materials.json").write_text(json.dumps(materials()))
        began = time.perf_counter()
        started = subprocess.Popen([sys.executable, script, "solve"], cwd=folder, stdout=subprocess.DEVNULL)
        usage = os.wait4(started.pid, 0)[2]
        seconds = time.perf_counter() - began
        found = json.loads((folder / "found.json").read_text())
    report(
        version=version("KratosMultiphysics"),
        unknowns=3 * (len(lower.points) + len(upper.points)),
        seconds={"whole": seconds},
        peak=1024 * usage.ru_maxrss,
        solver="amgcl",
        **found,
    )


if __name__ == "__main__":
    solve() if sys.argv[1] == "solve" else main()
