"""Exact shapes for people who have no CAD."""
