"""What people look at: files for ParaView, pictures, report, summary, checks against known answers."""

from geom2iga import start  # noqa: F401 - before all that takes its time
from post.case import PostCase
from post.export import export
from post.meshes import as_mesh
from post.probes import probe
from post.verify import Check, verify

__all__ = ["Check", "PostCase", "as_mesh", "export", "probe", "verify"]
