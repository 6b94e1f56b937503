"""report.html: one file that says and shows all of a run, and needs no other."""

from post.report.page import write_report

__all__ = ["write_report"]
