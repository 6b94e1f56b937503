"""Write the job of the elasticity benchmarks: the geometry of ours, refined, for all.

python prepare.py JOB.npz GEOMETRY DEGREE SPANS

Beside it JOB.mesh holds the same as MFEM reads it. The load vector is for peers that have no body forces.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from case_elasticity import elasticity_case
from scipy.interpolate import BSpline

from geom2iga import Patch, build
from geom2iga.exchange.mfem import write_mfem


def unit_load(patch: Patch) -> Any:
    """Integrals (n0, n1, n2) of the patch's functions over its volume, by Gauss points."""
    bases, slopes, rules = zip(*map(functions, patch.knots, patch.degrees), strict=True)
    weights = np.ones(patch.shape) if patch.weights is None else patch.weights.reshape(patch.shape)
    points = patch.control_points.reshape(*patch.shape, 3) * weights[..., None]

    def summed(values: Any, along: int | None = None) -> Any:
        matrices = [slopes[d] if d == along else bases[d] for d in range(3)]
        return np.einsum("qi,rj,sk,ijk...->qrs...", *matrices, values, optimize=True)

    divisor, place = summed(weights), summed(points)
    slope = [
        (summed(points, d) - place * (summed(weights, d) / divisor)[..., None]) / divisor[..., None] for d in range(3)
    ]
    volume = np.linalg.det(np.stack(slope, axis=-1)) / divisor
    return weights * np.einsum("qi,rj,sk,qrs,q,r,s->ijk", *bases, volume, *rules, optimize=True)


def functions(knots: Any, degree: int) -> tuple[Any, Any, Any]:
    """Values and slopes (q, n) of splines at Gauss points, and their weights (q,)."""
    breaks = np.unique(knots)
    at, weights = np.polynomial.legendre.leggauss(degree + 2)
    half, middle = np.diff(breaks) / 2, (breaks[1:] + breaks[:-1]) / 2
    points = (middle[:, None] + half[:, None] * at).ravel()
    spline = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return spline(points), spline.derivative()(points), (half[:, None] * weights).ravel()


def main() -> None:
    """Write the files named on the command line."""
    name, geometry, degree, spans = sys.argv[1:]
    case = elasticity_case(geometry, int(degree), int(spans))
    model = build(case)
    (patch,) = model.patches.values()
    weights = np.ones(patch.shape) if patch.weights is None else patch.weights
    material, (body_force,) = case["solve"]["material"][0], case["solve"]["body_force"]
    np.savez(
        name,
        case=json.dumps(case),
        degrees=patch.degrees,
        **{f"knots{direction}": knots for direction, knots in enumerate(patch.knots)},
        control_points=patch.control_points.reshape(*patch.shape, 3),
        weights=weights.reshape(patch.shape),
        young=material["young"],
        poisson=material["poisson"],
        force=body_force["force"],
        load=unit_load(patch)[..., None] * body_force["force"],
    )
    write_mfem(Path(name).with_suffix(".mesh"), model)


if __name__ == "__main__":
    main()
