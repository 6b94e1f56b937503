"""Whether there is memory for what people look at, before any of it is made."""

from collections.abc import Iterable
from math import prod

from geom2iga.limits import check_memory
from geom2iga.model import Model
from geom2iga.patch import Patch
from post.bezier_size import size_of_bezier
from post.case import Post
from post.grid import LONG, SLAB, choose_samples, sample_grid
from solve.case import Contact

# Measured on two blocks in contact, as the peak over what lay in memory before.
POINT = 400  # bytes of a sample point while its slab is written: 340, 430 and 320 at degree 1, 2 and 3
CONTACT_POINT = 1000  # bytes of a sample point of a secondary face while it is sampled: 640, 860 and 1040 likewise
COPIES = 1.8  # of bezier.vtu, with the stress projected: 1.5, 1.7 and 1.75 likewise


def check_post(model: Model, contacts: Iterable[Contact], post: Post) -> None:
    """Raise CaseError where slabs of sample points, or the Bézier elements, need more memory than is free."""
    samples = post.samples or choose_samples(model)
    slab = max(_points_of_slab(patch, samples) for patch in model.patches.values())
    faces = [model.surface(face) for contact in contacts for face in model.faces(contact.secondary)]
    kept = CONTACT_POINT * sum(prod(samples * (len(at) - 1) for at in face.breaks) for face in faces)
    check_memory(
        f"post.samples: {samples} points per span and direction", kept + POINT * slab, "take fewer, or fewer spans"
    )
    if post.bezier:
        check_memory("Bézier elements", kept + COPIES * size_of_bezier(model), "set bezier = false in [post]")


def _points_of_slab(patch: Patch, samples: int) -> int:
    """Sample points that are held at once: those of a whole span of the first direction at least."""
    first, *others = sample_grid(patch, samples, joined=True).shape
    each = prod(others)
    return each * min(first, max(samples, min(LONG, SLAB // each)))
