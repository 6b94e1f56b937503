"""Stiffness of isotropic linear elasticity, assembled."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from geom2iga.bspline import Array, Indices
from geom2iga.progress import tracked
from geom2iga.threads import thread_count
from solve.material import Material
from solve.pattern import Band, find_pattern
from solve.products import Known, Tile, directions_of
from solve.rules import full_rules
from solve.space import Space
from solve.sums import GradientProducts


def assemble_stiffness(space: Space, materials: Mapping[str, Material]) -> csr_array:
    """Assemble the stiffness matrix.

    K_ai,bj = ∫ lambda R_a,i R_b,j + mu R_a,j R_b,i + mu delta_ij R_a,k R_b,k dV        (Hughes 2000, sec. 2.7)

    Parameters
    ----------
    materials : body name to Material

    Returns
    -------
    (dofs, dofs)
        Symmetric, positive semidefinite [stress · length]; an entry, be it zero, where two functions share a span.

    Raises
    ------
    GeometryError
        A patch with a Jacobian that is not positive.
    """
    pattern, rules = find_pattern(space), full_rules(space)
    values = pattern.allocated()
    known: Known = {}
    with ThreadPoolExecutor(thread_count()) as pool:
        for name, patch in tracked(space.model.patches.items(), "patches"):
            lame, shear = materials[space.model.body_of(name)].lame
            products = GradientProducts(patch, shear, directions_of(patch, rules[name], known))
            part = _Part(products, lame / shear, pattern.starts[name], values)
            tiles = products.tiles()
            for _ in tracked(pool.map(part.write, tiles), "tiles of the stiffness", len(tiles)):
                pass
            pattern.merge(name, values)
    values.resize(len(pattern.indices), refcheck=False)  # the rest was for rows that are merged now
    return csr_array((values, pattern.indices, pattern.indptr), shape=(space.dofs, space.dofs))


class _Part(NamedTuple):
    """A patch and where its entries belong among the values of the matrix."""

    products: GradientProducts
    ratio: float  # λ/µ
    starts: Indices
    values: Array

    def write(self, tiles: tuple[Tile, Tile]) -> None:
        """Write the rows of the functions of two tiles, and their columns by symmetry."""
        patch, (first, second, third) = self.products.patch, self.products.directions
        starts = self.starts.reshape(first.band.size, -1)
        bands = (first.band, second.band, third.band)
        rows, columns = ([getattr(tile, side) for tile in tiles] for side in ("rows", "columns"))
        upper, lower = _Boxes.of(bands, rows, columns), _Boxes.of(bands, columns, rows)
        for row, sums in self.products.slabs(*tiles):
            others = np.arange(row, row + sums.shape[2])
            _elastic(sums, self.ratio)
            if self.products.rational:
                weights = patch.weights.reshape(first.band.size, -1)
                sums *= weights[row].take(upper.rows) * weights[others].take(lower.rows, axis=1)
            upper.write(self.values, starts, np.full_like(others, row), others, sums)
            lower.write(self.values, starts, others[1:], np.full_like(others[1:], row), sums.swapaxes(0, 1)[:, :, 1:])


def _elastic(sums: Array, ratio: float) -> None:
    """From ∫ R_a,i R_b,j to λ/µ ∫ R_a,i R_b,j + ∫ R_a,j R_b,i + δ_ij ∫ R_a,k R_b,k, in place."""
    laplace = sums[0, 0] + sums[1, 1] + sums[2, 2]
    for i in range(3):
        sums[i, i] *= 1 + ratio
        sums[i, i] += laplace
        for j in range(i):
            transposed = sums[i, j] + ratio * sums[j, i]
            sums[i, j] *= ratio
            sums[i, j] += sums[j, i]
            sums[j, i] = transposed


class _Boxes(NamedTuple):
    """Where pairs of functions of the second and third direction stand in the rows of a patch."""

    first: Band
    rows: Indices  # (k_2, k_3) flat number of the row's function
    offsets: Indices  # (k_2, k_3) where the pair stands among the columns for one function of the first direction
    lengths: Indices  # (k_2, k_3) columns for one function of the first direction

    @classmethod
    def of(cls, bands: tuple[Band, Band, Band], rows: Sequence[Indices], columns: Sequence[Indices]) -> "_Boxes":
        """Find the places of pairs (k_2,), (k_3,)."""
        _, second, third = bands
        widths = third.width[rows[1]]
        offsets = np.multiply.outer(columns[0] - second.lowest[rows[0]], widths) + columns[1] - third.lowest[rows[1]]
        numbers = third.size * rows[0][:, None] + rows[1]
        return cls(bands[0], numbers, 3 * offsets, 3 * np.multiply.outer(second.width[rows[0]], widths))

    def write(self, values: Array, starts: Indices, rows: Indices, columns: Indices, sums: Array) -> None:
        """Write blocks (3, 3, k_1, k_2, k_3) of pairs (k_1,) of functions of the first direction and of all these."""
        at = starts[rows].take(self.rows, axis=1) + self.offsets
        at += np.multiply.outer(columns - self.first.lowest[rows], self.lengths)
        length = np.multiply.outer(self.first.width[rows], self.lengths)
        for i in range(3):
            for j in range(3):
                values[j:][at] = sums[i, j]
            at += length
