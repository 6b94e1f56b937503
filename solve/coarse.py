"""The coarse part of the preconditioner: displacements that are trilinear in the parameters of each glued patch.

They carry from patch to patch what the inverses of single patches cannot, so that the iterations do not grow with the
number of patches (additive Schwarz with a coarse space; Toselli & Widlund 2005, ch. 3 and 6). Rigid motions that the
supports leave free are added: on curved patches turns are not trilinear.
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from scipy.sparse import block_diag, coo_array, csc_array, csr_array, diags_array, kron
from scipy.sparse.linalg import splu

from geom2iga.bspline import Array, Indices, greville
from geom2iga.patch import Patch, evaluate
from solve.bricks import Floats
from solve.material import Material
from solve.patchwise import Modes
from solve.rigid import find_pieces, kernel, rigid_modes
from solve.space import Space

POINTS = 4  # Gauss points per direction of a patch
FIXED = 1e-9  # a motion is free where the supports take less than this fraction of it
FLOATING = 1e-2  # energy given to motions without any, over that of the diagonal; single precision asks for no less
CORNERS = tuple(product((0, 1), repeat=3))


class Coarse:
    """Φ E^-1 Φ' + Z S^-1 Z' with the energies E of the coarse functions Φ, and S given to free rigid motions Z.

    Parameters
    ----------
    space : Space
    materials : body name to Material
    freedom : (n, 3, 3)
        Projections of the control points on the displacements that the supports allow.
    touching : (k,)
        Control points of faces that take part in contacts.
    """

    count = 2

    def __init__(self, space: Space, materials: Mapping[str, Material], freedom: Array, touching: Indices) -> None:
        names = sorted({face.patch for pair in space.model.glued for face in (pair.first, pair.second)})
        corners = {name: _corners(space, name) for name in names}
        vertices = np.unique(np.concatenate(list(corners.values())))
        places = {name: np.searchsorted(vertices, own) for name, own in corners.items()}
        values = _vertex_functions(space, places, len(vertices))
        allowed = _allowed(values, freedom)
        self._functions = csr_array(kron(values, np.eye(3)) @ allowed)
        energy = allowed.T @ _energies(space, materials, places, len(vertices)) @ allowed
        diagonal = energy.diagonal()
        rigid = _free_motions(space, freedom, vertices)
        rows = (3 * vertices[:, None] + np.arange(3)).ravel()
        moved = allowed.T @ rigid[rows]
        self._rigid = rigid / np.sqrt(FLOATING * (diagonal @ moved**2))
        shift = FLOATING * diagonal * (np.abs(moved).max(axis=1, initial=0.0) > 0)
        self._solve = splu(csc_array(energy + diags_array(shift))).solve if len(shift) else np.zeros_like
        self._blended, self._moved = self._functions.astype(np.float32), self._rigid.astype(np.float32)
        self._transposed = csr_array(self._blended.T)
        self._touching = np.isin(np.arange(space.size), touching)[:, None]

    def modes(self, forces: Floats) -> Modes:
        """Coarse displacements and rigid motions under forces (size, 3)."""
        pushed = (self._transposed @ forces.ravel()).astype(float)
        return [self._solve(pushed).astype(np.float32), forces.ravel() @ self._moved]

    def displacements(self, modes: Modes) -> Floats:
        """Displacements (size, 3)."""
        return (self._blended @ modes[0] + self._moved @ modes[1]).reshape(-1, 3)

    def pushed(self, forces: Floats) -> Modes:
        """Coarse displacements under forces (size, 3) on the touching faces alone."""
        return self.modes(forces)

    def traced(self, modes: Modes) -> Floats:
        """Displacements (size, 3) of the touching faces, zero elsewhere."""
        return self.displacements(modes) * self._touching

    def between(self, operator: csr_array) -> Array:
        """G B G' (m, m) for a gap operator (m, dofs)."""
        gaps, opened = csr_array(operator @ self._functions), operator @ self._rigid
        return gaps @ self._solve(gaps.T.toarray()) + opened @ opened.T


def _corners(space: Space, name: str) -> Indices:
    """Control points (8,) at the corners of a patch."""
    grid = space.numbers[name].reshape(space.model.patches[name].shape)
    return np.array([grid[tuple(-side for side in corner)] for corner in CORNERS])


def _vertex_functions(space: Space, corners: Mapping[str, Indices], count: int) -> csr_array:
    """Coefficients (size, v) of the functions that are 1 at one corner of patches and 0 at all others.

    The coefficients of a linear function are its values at the Greville points.
    """
    times, rows, columns, values = np.zeros(space.size), [], [], []
    for name, own in corners.items():
        patch, numbers = space.model.patches[name], space.numbers[name]
        at = [greville(*along) for along in zip(patch.knots, patch.degrees, strict=True)]
        shares = [(places - places[0]) / (places[-1] - places[0]) for places in at]
        np.add.at(times, numbers, 1.0)
        rows.append(np.tile(numbers, len(own)))
        columns.append(np.repeat(own, len(numbers)))
        values.append(_products(shares).ravel())
    where = np.concatenate(rows), np.concatenate(columns)
    found = coo_array((np.concatenate(values), where), shape=(space.size, count)).tocsr()
    found.eliminate_zeros()
    return csr_array(diags_array(1 / np.maximum(times, 1.0)) @ found)


def _products(shares: Sequence[Array]) -> Array:
    """Trilinear functions (8, n_1, n_2, n_3) of the corners from places between 0 and 1 in each direction."""
    first, second, third = (np.stack([1 - share, share]) for share in shares)
    return np.einsum("ia,jb,kc->ijkabc", first, second, third).reshape(8, *(len(share) for share in shares))


def _allowed(values: csr_array, freedom: Array) -> csr_array:
    """Directions (3 v, c) along which supports allow the function of a vertex everywhere."""
    squares = values.multiply(values).T
    taken = (squares @ (np.eye(3) - freedom).reshape(-1, 9)).reshape(-1, 3, 3)
    strength, axes = np.linalg.eigh(taken)
    free = strength <= FIXED * (squares @ np.ones(len(freedom)))[:, None]
    return csr_array(block_diag([own[:, kept] for own, kept in zip(axes, free, strict=True)]))


def _energies(space: Space, materials: Mapping[str, Material], corners: Mapping[str, Indices], count: int) -> csr_array:
    """Energies (3 v, 3 v) of the functions of all vertices in all directions."""
    rows, columns, values = [], [], []
    for name, own in corners.items():
        dofs = (3 * own[:, None] + np.arange(3)).ravel()
        rows.append(np.repeat(dofs, 24))
        columns.append(np.tile(dofs, 24))
        values.append(_patch_energies(space.model.patches[name], materials[space.model.body_of(name)]).ravel())
    where = np.concatenate(rows), np.concatenate(columns)
    return coo_array((np.concatenate(values), where), shape=(3 * count, 3 * count)).tocsr()


def _patch_energies(patch: Patch, material: Material) -> Array:
    """Energies (24, 24) of the trilinear functions of a patch."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    shares, ends = (1 + nodes) / 2, [(at[0], at[-1]) for at in patch.breaks]
    grid = np.stack(np.meshgrid(*(a + (b - a) * shares for a, b in ends), indexing="ij"), axis=-1).reshape(-1, 3)
    jacobians = evaluate(patch, grid, 1)[1] * [b - a for a, b in ends]
    volume = np.abs(np.linalg.det(jacobians)) * np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8
    lines, slopes = np.stack([1 - shares, shares]), np.repeat([[-1.0], [1.0]], POINTS, axis=1)
    tables = [[slopes if d == axis else lines for d in range(3)] for axis in range(3)]
    local = np.stack([np.einsum("ia,jb,kc->abcijk", *t).reshape(-1, 8) for t in tables], axis=-1)
    gradients = local @ np.linalg.pinv(jacobians)  # (q, 8, 3)
    lame, shear = material.lame
    products = np.einsum("q,qai,qbj->aibj", volume, gradients, gradients)
    found = lame * products + shear * products.transpose(0, 3, 2, 1)
    found += shear * np.einsum("akbk,ij->aibj", products, np.eye(3))
    return found.reshape(24, 24)


def _free_motions(space: Space, freedom: Array, vertices: Indices) -> Array:
    """Rigid motions (dofs, f) of the pieces with some control points that the supports leave free."""
    pieces, taken = find_pieces(space), np.eye(3) - freedom
    points = np.flatnonzero(np.abs(taken).max(axis=(1, 2)) > FIXED)
    modes = rigid_modes(pieces, points).reshape(len(points), 3, len(pieces.names), 6)
    stopped = np.einsum("aij,ajkl->aikl", taken[points], modes)
    found = [np.empty((space.size, 3, 0))]
    for piece in np.unique(pieces.owner[vertices]):
        slides, turns = np.split(kernel(stopped[:, :, piece].reshape(-1, 6)), 2)
        motions = slides[None] + np.cross(turns.T[None], pieces.arm[:, None]).swapaxes(1, 2)
        found.append(motions * (pieces.owner == piece)[:, None, None])
    return np.concatenate(found, axis=2).reshape(space.dofs, sum(part.shape[2] for part in found))
