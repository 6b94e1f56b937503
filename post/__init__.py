"""What people look at: files for ParaView, pictures, summary, checks against known answers."""

from post.case import PostCase
from post.export import export
from post.verify import Check, verify

__all__ = ["Check", "PostCase", "export", "verify"]
