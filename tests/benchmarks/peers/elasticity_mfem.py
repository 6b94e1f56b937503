"""MFEM by PyMFEM: its elasticity integrator, conjugate gradients with symmetric Gauss-Seidel."""

import re
import sys
from pathlib import Path

import mfem.ser as mfem
from common import TOLERANCE, Job, Measured, read_job
from scipy.sparse import csr_matrix

MESH = Path(sys.argv[1]).with_suffix(".mesh")


def assembled(space: mfem.FiniteElementSpace, coefficients: list[mfem.ConstantCoefficient]) -> mfem.BilinearForm:
    """The stiffness of all degrees of freedom."""
    form, integrator = mfem.BilinearForm(space), mfem.ElasticityIntegrator(*coefficients)
    order = 2 * space.GetElementOrder(0)
    integrator.SetIntRule(mfem.IntRules.Get(mfem.Geometry.CUBE, order))  # as all do; its own has far more points
    form.AddDomainIntegrator(integrator)
    form.Assemble(0)  # zeros kept: with those left out the pattern is not symmetric
    form.Finalize(0)
    return form


def bottom() -> int:
    """The attribute of the clamped face, by the comments of the mesh file."""
    return int(re.search(r"boundary attribute (\d+): body/bottom", MESH.read_text()).group(1))


def scipy_matrix(matrix: mfem.SparseMatrix) -> csr_matrix:
    """The same memory as scipy sees it."""
    arrays = matrix.GetDataArray(), matrix.GetJArray(), matrix.GetIArray()
    return csr_matrix(arrays, shape=(matrix.Height(), matrix.Width()), copy=False)


def solve(measured: Measured, space: mfem.FiniteElementSpace, form: mfem.BilinearForm, job: Job) -> None:
    """Integrate the load, and solve."""
    with measured.phase("solve"):
        load = mfem.LinearForm(space)
        force = mfem.VectorConstantCoefficient(mfem.Vector(job.force))
        load.AddDomainIntegrator(mfem.VectorDomainLFIntegrator(force))
        load.Assemble()
        clamped = mfem.intArray()
        attributes = mfem.intArray([0] * space.GetMesh().bdr_attributes.Max())
        attributes[bottom() - 1] = 1
        space.GetEssentialTrueDofs(attributes, clamped)
        solution = mfem.GridFunction(space)
        solution.Assign(0.0)
        matrix, known, right = mfem.SparseMatrix(), mfem.Vector(), mfem.Vector()
        form.FormLinearSystem(clamped, solution, load, matrix, known, right)
        solver = mfem.CGSolver()
        solver.SetRelTol(TOLERANCE)
        solver.SetMaxIter(10000)
        smoother = mfem.GSSmoother(matrix)
        solver.SetPreconditioner(smoother)
        solver.SetOperator(matrix)
        solver.Mult(right, known)
        form.RecoverFEMSolution(known, load, solution)
    measured.found |= {
        "energy": (load * solution) / 2,
        "iterations": solver.GetNumIterations(),
        "solver": "CG, symmetric Gauss-Seidel",
    }


def main() -> None:
    """Assemble and solve."""
    job = read_job()
    measured = Measured("mfem", job)
    mesh = mfem.Mesh(str(MESH))
    with measured.phase("assembly"):
        space = mfem.FiniteElementSpace(mesh, mesh.GetNodes().FESpace().FEColl(), 3, mfem.Ordering.byVDIM)
        coefficients = [mfem.ConstantCoefficient(value) for value in job.lame]  # forms do not keep them alive
        form = assembled(space, coefficients)
    measured.matrix(scipy_matrix(form.SpMat()))
    if job.solves:
        solve(measured, space, form, job)
    measured.report()


if __name__ == "__main__":
    main()
