"""Isogeometric elasticity with mortar-KTS contact on a model of NURBS patches."""

from geom2iga import start  # noqa: F401 - before all that takes its time
from solve.analysis import solve
from solve.case import SolveCase
from solve.files import read_result, write_result
from solve.newton import Status
from solve.result import ContactResult, Result, State

__all__ = ["ContactResult", "Result", "SolveCase", "State", "Status", "read_result", "solve", "write_result"]
