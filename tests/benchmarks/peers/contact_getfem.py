"""GetFEM: hexahedra, nodal contact by augmented Lagrange multipliers between non-matching meshes, direct solver.

python contact_getfem.py SPANS

Gaps are those of nodes: a uniform stress does not come out exactly. The time is that of the whole process up to the
solution; the stresses for the error are evaluated after it.
"""

import subprocess
import sys

import getfem
import numpy as np
from common import memory, since_start
from two_blocks import POISSON, PRESSURE, STRESS, YOUNG, report

LEFT, FRONT, BOTTOM, TOP = 1, 2, 3, 4  # numbers of regions
NAMES = ("lower", "upper")


def cube(spans: int, bottom: float) -> getfem.Mesh:
    """A unit cube with regions."""
    at = np.linspace(0, 1, spans + 1)
    mesh = getfem.Mesh("cartesian", at, at, bottom + at)
    places = {LEFT: (0, 0.0), FRONT: (1, 0.0), BOTTOM: (2, bottom), TOP: (2, bottom + 1)}
    for region, (axis, place) in places.items():
        mesh.set_region(region, mesh.faces_from_pid(np.flatnonzero(np.abs(mesh.pts()[axis] - place) < 1e-9)))
    return mesh


def linear(mesh: getfem.Mesh, components: int) -> getfem.MeshFem:
    """Linear hexahedra."""
    space = getfem.MeshFem(mesh, components)
    space.set_fem(getfem.Fem("FEM_QK(3,1)"))
    return space


def contact_model(meshes: list[getfem.Mesh]) -> getfem.Model:
    """Elasticity, supports, load and contact."""
    model = getfem.Model("real")
    model.add_initialized_data("lame", [YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))])
    model.add_initialized_data("mu", [YOUNG / (2 + 2 * POISSON)])
    model.add_initialized_data("r", [YOUNG])
    model.add_initialized_data("pressure", [0.0, 0.0, -PRESSURE])
    rules = [getfem.MeshIm(mesh, getfem.Integ("IM_GAUSS_PARALLELEPIPED(3,3)")) for mesh in meshes]
    for name, mesh, rule in zip(NAMES, meshes, rules, strict=True):
        model.add_fem_variable(name, linear(mesh, 3))
        model.add_isotropic_linearized_elasticity_brick(rule, name, "lame", "mu")
        for region in (LEFT, FRONT, BOTTOM) if name == "lower" else (LEFT, FRONT):
            model.add_normal_Dirichlet_condition_with_multipliers(rule, name, 1, region)
    model.add_source_term_brick(rules[1], "upper", "pressure", TOP)
    model.add_nodal_contact_between_nonmatching_meshes_brick(
        *rules[::-1], *NAMES[::-1], "contact", "r", BOTTOM, TOP, True, False
    )
    return model


def largest_error(model: getfem.Model, meshes: list[getfem.Mesh]) -> float:
    """Largest difference of any stress from the exact one, over the pressure, at the elements' nodes."""
    found = []
    for name, mesh in zip(NAMES, meshes, strict=True):
        space = getfem.MeshFem(mesh, 1)
        space.set_classical_discontinuous_fem(1)
        strain = f"(Grad_{name} + Grad_{name}')"
        stress = model.interpolation(f"lame * Trace(Grad_{name}) * Id(3) + mu * {strain}", space)
        found.append(stress.reshape(-1, 9)[:, [0, 4, 8, 1, 5, 2]])
    return float(np.abs(np.concatenate(found) - STRESS).max() / PRESSURE)


def main() -> None:
    """Solve."""
    getfem.util_trace_level(0)
    spans = int(sys.argv[1])
    meshes = [cube(spans, 0.0), cube(spans - 1, 1.0)]
    model = contact_model(meshes)
    steps, _ = model.solve("max_res", 1e-8, "max_iter", 30)
    seconds, peak = since_start(), memory("VmHWM")
    report(
        version=version(),
        unknowns=3 * sum(mesh.nbpts() for mesh in meshes),
        seconds={"whole": seconds},
        peak=peak,
        error=largest_error(model, meshes),
        steps=int(steps),
        solver="direct",
    )


def version() -> str:
    """The version of Debian's package; the library does not tell its own."""
    asked = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", "python3-getfem"], capture_output=True, text=True)
    return asked.stdout.partition("+")[0] or "unknown"


if __name__ == "__main__":
    main()
