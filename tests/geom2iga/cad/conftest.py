"""Sessions of gmsh that several files use."""

from contextlib import contextmanager

import gmsh
import pytest


@contextmanager
def session():
    """Open gmsh without its configuration and without talk, and close it again."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield
    gmsh.finalize()


@pytest.fixture(scope="module")
def gmsh_session():
    """A gmsh of our own."""
    with session():
        yield


@pytest.fixture
def empty_gmsh():
    """A gmsh with an empty model."""
    with session():
        yield
