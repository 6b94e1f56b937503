"""Models of the registries, open in gmsh for a while, and as we read them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gmsh

from geom2iga.cad import session
from geom2iga.cad.topology import Topology, read_topology


@contextmanager
def opened(make: Callable[[Any], object]) -> Iterator[None]:
    """A model of its own in gmsh, which is started where it does not run; current as long as the context lasts."""
    with session.session():
        make(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        yield


def topology_of(make: Callable[[Any], object]) -> Topology:
    """What we read of a model."""
    with opened(make):
        return read_topology(session.boundary())
