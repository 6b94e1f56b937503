"""Stiffness of isotropic linear elasticity, assembled."""

from collections.abc import Mapping

import numpy as np
from scipy.sparse import coo_array, csr_array

from geom2iga.bspline import Array, Indices
from solve.material import Material
from solve.space import Quadrature, Space, volume_quadrature


def assemble_stiffness(space: Space, materials: Mapping[str, Material]) -> csr_array:
    """Assemble the stiffness matrix.

    K_ai,bj = ∫ lambda R_a,i R_b,j + mu R_a,j R_b,i + mu delta_ij R_a,k R_b,k dV        (Hughes 2000, sec. 2.7)

    Parameters
    ----------
    materials : body name to Material

    Returns
    -------
    (dofs, dofs)
        Symmetric, positive semidefinite [stress · length].

    Raises
    ------
    GeometryError
        A patch with a Jacobian that is not positive.
    """
    stiffness = csr_array((space.dofs, space.dofs))
    for name, patch in space.model.patches.items():
        material = materials[space.model.body_of(name)]
        for part in volume_quadrature(patch, space.point_counts[name]):
            dofs = (3 * space.numbers[name][part.indices][:, :, None] + np.arange(3)).reshape(len(part.indices), -1)
            stiffness = stiffness + _scattered(_span_stiffness(part, material), dofs, space.dofs)
    return stiffness


def _span_stiffness(part: Quadrature, material: Material) -> Array:
    """Stiffness (e, 3a, 3a) of each span."""
    lame, mu = material.lame
    spans, points, width, _ = part.gradients.shape
    gradient = part.gradients.reshape(spans, points, 3 * width)
    products = np.swapaxes(gradient * part.volume[:, :, None], 1, 2) @ gradient
    products = products.reshape(spans, width, 3, width, 3)
    stiffness = lame * products + mu * np.swapaxes(products, 2, 4)
    shear = mu * np.trace(products, axis1=2, axis2=4)
    for i in range(3):
        stiffness[:, :, i, :, i] += shear
    return stiffness.reshape(spans, 3 * width, 3 * width)


def _scattered(local: Array, dofs: Indices, size: int) -> csr_array:
    """Add up the matrices of single spans."""
    rows = np.broadcast_to(dofs[:, :, None], local.shape).ravel()
    columns = np.broadcast_to(dofs[:, None, :], local.shape).ravel()
    return coo_array((local.ravel(), (rows, columns)), shape=(size, size)).tocsr()
