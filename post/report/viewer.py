"""A pyvista scene as a page of HTML that shows it by vtk.js, turned with mouse or fingers, without a server."""

import io
import json
import re
import zipfile
from typing import Any

import pyvista

from geom2iga.errors import UserError

ICON = re.compile(r"https?://[^\"'`\s]*favicon[^\"'`\s]*")  # the only thing that the viewer would fetch


def viewer_page(plotter: pyvista.Plotter) -> str:
    """Make a page that shows what a plotter shows.

    The plotter's own `export_html` starts a server to ask it for the scene, and leaves it running. What that server
    would do is done here: the scene is serialised, packed and handed to the same viewer.

    Raises
    ------
    UserError
        trame-vtk is missing, which holds the viewer.
    """
    try:
        from trame_vtk.tools.vtksz2html import write_html
    except ImportError as error:
        raise UserError(
            f"report.html needs trame-vtk for its 3D scene ({error}): pip install trame-vtk, or set report = false in "
            "[post]"
        ) from None
    packed, page = io.BytesIO(), io.StringIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("index.json"), json.dumps(_serialised(plotter)), zipfile.ZIP_DEFLATED)
    write_html(packed.getvalue(), page)
    return ICON.sub("data:,", page.getvalue())


def _serialised(plotter: pyvista.Plotter) -> dict[str, Any]:
    """Describe the scene as vtk.js reads it: the objects, and under their hashes the arrays these refer to."""
    from trame_vtk.modules.vtk import serializers

    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    window, camera = plotter.render_window, plotter.renderer.camera
    scene = serializers.serialize(None, window, serializers.reference_id(window), context, 1)
    scene["extra"] = {
        "vtkRefId": serializers.reference_id(window),
        "camera": serializers.reference_id(camera),
        "centerOfRotation": camera.GetFocalPoint(),
    }
    arrays = {
        entry["hash"]: {**entry, "content": context.get_cached_data_array(entry["hash"])}
        for entry in serializers.extract_array_hash(scene)
    }
    return {"scene": scene, "hashes": arrays}
