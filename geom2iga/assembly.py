"""From coarse bodies to a model: what is glued, certificates, the mesh, the names of faces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geom2iga.body_case import Body
from geom2iga.cad.conversion import Built
from geom2iga.errors import CaseError, GeometryError
from geom2iga.glue import all_faces, conformed, find_glued, normalised
from geom2iga.model import Face, Glued, Model
from geom2iga.patch import Patch
from geom2iga.progress import tracked
from geom2iga.quality.certificate import Certificate, certify
from geom2iga.refinement import meshed, with_knots
from geom2iga.selectors import OuterFace, outer_face, select


@dataclass(frozen=True, eq=False)
class Joined:
    """A body of coarse patches that conform.

    Parameters
    ----------
    built : Built
        What it was made of.
    patches : tuple of Patch
        Knots run from 0 to 1.
    glued : tuple of Glued
    faces : name to faces
        Within the body, faces inside it left out.
    certificates : patch name to Certificate
    outer : tuple of OuterFace
    """

    built: Built
    patches: tuple[Patch, ...]
    glued: tuple[Glued, ...]
    faces: Mapping[str, tuple[Face, ...]]
    certificates: Mapping[str, Certificate]
    outer: tuple[OuterFace, ...]

    @property
    def name(self) -> str:
        """Name of the body."""
        return self.built.name


def joined(built: Built) -> Joined:
    """Glue the patches of a body and certify them.

    Raises
    ------
    GeometryError
        Patches that do not hang together, or are folded.
    """
    patches: tuple[Patch, ...] = tuple(normalised(patch) for patch in built.part.patches)
    glued = find_glued(patches)
    _check_connected(patches, glued)
    patches = conformed(patches, glued)
    certificates = {p.name: certify(p, *built.ways[p.name]) for p in tracked(patches, "certificates")}
    inside = {face for pair in glued for face in (pair.first, pair.second)}
    by_name = {patch.name: patch for patch in patches}
    names = {face: f"{built.name}/{name}" for name, group in built.part.faces.items() for face in group}
    outer = [
        outer_face(by_name[face.patch], face, built.name, built.tags.get(face), names.get(face, built.name))
        for face in all_faces(patches)
        if face not in inside
    ]
    faces = {name: tuple(f for f in group if f not in inside) for name, group in built.part.faces.items()}
    left = {name: group for name, group in faces.items() if group}
    return Joined(built, patches, glued, left, certificates, tuple(outer))


def with_mesh(body: Joined, groups: Mapping[str, tuple[Face, ...]], degrees: Sequence[int]) -> tuple[Patch, ...]:
    """Give the patches of a body the degrees and spans that the case asks for.

    Parameters
    ----------
    groups : name to faces
        Named by the case; gradings may lead toward them, too.
    degrees : (3,)
        Where the body gives none.

    Raises
    ------
    CaseError
        A grading that makes no sense, or too many spans.
    """
    mesh = body.built.mesh
    if body.built.knots is not None:
        return (with_knots(body.patches[0], mesh.degree or degrees, body.built.knots),)
    return meshed(body.patches, body.glued, mesh, mesh.degree or degrees, {**groups, **body.faces})


def _check_connected(patches: Sequence[Patch], glued: Sequence[Glued]) -> None:
    """Raise GeometryError where the patches of a body do not hang together."""
    place = {patch.name: number for number, patch in enumerate(patches)}
    ends = np.array([(place[g.first.patch], place[g.second.patch]) for g in glued], dtype=np.int64).reshape(-1, 2).T
    pieces, label = connected_components(coo_array((np.ones(ends.shape[1]), ends), shape=(len(patches),) * 2))
    if pieces > 1:
        other = patches[int(np.argmax(label != label[0]))].name
        raise GeometryError(
            f'the body falls apart into {pieces} pieces, "{patches[0].name}" and "{other}" among them: its volumes '
            "must meet in whole faces (occ.fragment), or be bodies of their own (tags, patches)"
        )


def face_groups(
    table: Body, where: str, bodies: Sequence[Joined], physical: Mapping[str, Sequence[int]]
) -> dict[str, tuple[Face, ...]]:
    """Find the groups of faces that a table names, and the physical groups of its file.

    Parameters
    ----------
    where : str
        Key of the table, for messages.
    physical : physical group to tags of CAD faces

    Raises
    ------
    CaseError
        A selector that fits no face, an unknown body.
    """
    groups: dict[str, tuple[Face, ...]] = {}
    everything = [face for body in bodies for face in body.outer]
    for name, tags in physical.items():
        found = tuple(face.face for face in everything if face.tag in tags)
        if found:
            groups[name] = found
    for number, faces in enumerate(table.faces):
        key = f'{where}.faces[{number}] "{faces.name}"'
        names = [body.name for body in bodies]
        if faces.body is not None and faces.body not in names:
            raise CaseError(f'{key}: there is no body "{faces.body}" in this table, only {", ".join(names)}')
        offered = [face for face in everything if faces.body in (None, face.body)]
        if faces.name in groups:
            raise CaseError(f"{key}: a physical group of faces is called so, too: choose another name")
        groups[faces.name] = select(offered, faces, physical, key)
    return groups


def assembled(
    bodies: Sequence[Joined], patches: Sequence[Sequence[Patch]], named: Sequence[Mapping[str, tuple[Face, ...]]]
) -> Model:
    """Put bodies, their patches with their mesh, and names of faces together.

    Raises
    ------
    CaseError
        Two bodies or two groups of one name.
    """
    names = [body.name for body in bodies]
    for name in names:
        if names.count(name) > 1:
            raise CaseError(f'two bodies are called "{name}": rename one')
    own = [{f"{body.name}/{name}": faces for name, faces in body.faces.items()} for body in bodies]
    groups: dict[str, tuple[Face, ...]] = {}
    for name, faces in (item for part in [*own, *named] for item in part.items()):
        if name in groups:
            raise CaseError(f'two groups of faces are called "{name}": rename one')
        groups[name] = faces
    return Model(
        {patch.name: patch for part in patches for patch in part},
        {body.name: tuple(patch.name for patch in part) for body, part in zip(bodies, patches, strict=True)},
        groups,
        tuple(pair for body in bodies for pair in body.glued),
        {name: certificate for body in bodies for name, certificate in body.certificates.items()},
    )
