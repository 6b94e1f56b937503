"""The JSON schema of the case file, from which editors complete keys and show what they mean."""

from collections.abc import Sequence
from typing import Any

from pydantic import Field, create_model

from geom2iga.tables import TABLES, Table

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema(tables: Sequence[type[Table]], program: str) -> dict[str, Any]:
    """Return the JSON schema of what some stages read of a case; what others read may stand there, too.

    Parameters
    ----------
    tables : types
        What each stage reads.
    program : str
        Command that reads them all.
    """
    fields: dict[str, Any] = {
        name: (Any, Field(None, description=f"not read by {program}, may hold anything")) for name in TABLES
    }
    for table in tables:
        fields |= {name: (info.annotation, info) for name, info in table.model_fields.items()}
    kind = create_model("Case", __base__=Table, **fields)
    about = {"title": "Case file of geom2iga", "description": f"What {program} reads of a case."}
    return {"$schema": DIALECT, **kind.model_json_schema(), **about}
