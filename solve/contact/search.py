"""Which spans of the two sides may touch."""

import numpy as np
import shapely

from geom2iga.bspline import Array, Indices


def find_span_pairs(secondary: Array, primary: Array) -> tuple[Indices, Indices]:
    """Find the pairs of spans whose outlines in the contact plane meet.

    Parameters
    ----------
    secondary, primary : (s, 4, 2)
        Corners of the spans of either side, in sequence around each span.

    Returns
    -------
    secondary_spans, primary_spans : (k,)
        Sorted by secondary span.
    """
    tree = shapely.STRtree(shapely.polygons(primary))
    secondary_spans, primary_spans = tree.query(shapely.polygons(secondary), predicate="intersects")
    order = np.lexsort((primary_spans, secondary_spans))
    return secondary_spans[order], primary_spans[order]
