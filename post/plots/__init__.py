"""Pictures, one function each; every function takes data and returns a matplotlib figure."""

from post.plots.bodies import draw_bodies, drawn, plot
from post.plots.contact import draw_contact
from post.plots.convergence import draw_convergence, observed_slope
from post.plots.curves import draw_line, draw_point, draw_profile, draw_sweep
from post.plots.deformation import deformation_scale
from post.plots.history import draw_load_steps, draw_newton, what_is_active
from post.plots.plane import draw_contact_plane
from post.plots.style import Curve, Label
from post.plots.usual import pictures_of

__all__ = [
    "Curve",
    "Label",
    "deformation_scale",
    "draw_bodies",
    "draw_contact",
    "draw_contact_plane",
    "draw_convergence",
    "draw_line",
    "draw_load_steps",
    "draw_newton",
    "draw_point",
    "draw_profile",
    "draw_sweep",
    "drawn",
    "observed_slope",
    "pictures_of",
    "plot",
    "what_is_active",
]
