"""Geometry to trivariate NURBS: from a case file through gmsh to a model of patches.

>>> import geom2iga
>>> model = geom2iga.build({"geometry": {"degree": 2, "block": [{"name": "cube", "size": [1, 1, 1]}]}})
>>> model.patches["cube"]
Patch('cube', degree 2, 1 x 1 x 1 spans, polynomial, 27 control points in a box of 1 x 1 x 1)
"""

from geom2iga import start  # noqa: F401 - before all that takes its time
from geom2iga.build import build, build_from_gmsh
from geom2iga.case import GeometryCase
from geom2iga.errors import CaseError, GeometryError, NotConvergedError, UserError, VerificationError
from geom2iga.facets import faceted
from geom2iga.files import read_model, write_model
from geom2iga.model import Glued, Model
from geom2iga.patch import Face, Patch, elevated, evaluate, refined, reversed_along, surface
from geom2iga.quality.certificate import Certificate
from geom2iga.tables import Case, read_case

__all__ = [
    "Case",
    "CaseError",
    "Certificate",
    "Face",
    "GeometryCase",
    "GeometryError",
    "Glued",
    "Model",
    "NotConvergedError",
    "Patch",
    "UserError",
    "VerificationError",
    "build",
    "build_from_gmsh",
    "elevated",
    "evaluate",
    "faceted",
    "read_case",
    "read_model",
    "refined",
    "reversed_along",
    "surface",
    "write_model",
]
