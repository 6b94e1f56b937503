import logging
from dataclasses import replace

import numpy as np
import pytest

from geom2iga import build, build_from_gmsh
from geom2iga.assembly import assembled, face_groups, joined, with_mesh
from geom2iga.body_case import Body
from geom2iga.cad.conversion import Built
from geom2iga.errors import CaseError, GeometryError
from geom2iga.exchange.gismo import write_gismo
from geom2iga.model import SIDES, Face, Part
from geom2iga.patch import reversed_along
from tests.cases import block_patch, model_of, moved
from tests.geom2iga.test_selectors import open_gmsh

ONE = (1, 1, 1)
SIDE_FACES = {side: (k // 2, k % 2) for k, side in enumerate(SIDES)}


def built(name, *patches, faces=None, tags=None, **mesh):
    """A body of patches as they come from a reader."""
    ways = {patch.name: ("given", None) for patch in patches}
    return Built(name, Part(patches, faces or {}), Body(**mesh), ways, tags or {})


def tower(name="tower", count=2, **more):
    """Blocks one upon the other, the faces of each named "left1" and so on."""
    patches = [block_patch(f"{name}/{n}", origin=(0, 0, n)) for n in range(count)]
    faces = {f"{side}{p.name[-1]}": (Face(p.name, *place),) for p in patches for side, place in SIDE_FACES.items()}
    return built(name, *patches, faces=faces, **more)


def test_patches_that_meet_are_one_body_and_take_its_mesh():
    body = joined(tower(count=3, spans=(2, 3, 4)))
    assert len(body.glued) == 2
    patches = with_mesh(body, {}, (2, 1, 3))
    for patch in patches:
        assert patch.degrees == (2, 1, 3)
        assert [len(at) - 1 for at in patch.breaks] == [2, 3, 4]
    model = assembled([body], [patches], [])
    assert dict(model.bodies) == {"tower": ("tower/0", "tower/1", "tower/2")}
    assert model.glued == body.glued


def test_the_degree_of_a_body_goes_before_that_of_the_case():
    assert with_mesh(joined(tower(degree=2)), {}, (3, 3, 3))[0].degrees == (2, 2, 2)


@pytest.mark.parametrize(
    ("origins", "pieces"),
    [
        ([(0, 0, 0), (0, 0, 1.5)], 2),
        ([(0, 0, 0), (1, 1, 0)], 2),  # they share an edge
        ([(0, 0, 0), (0.5, 0, 1)], 2),  # and half a face
        ([(0, 0, 0), (0, 0, 1), (3, 0, 0), (0, 0, 7)], 3),
    ],
)
def test_a_body_that_falls_apart_is_refused(origins, pieces):
    patches = [block_patch(f"body/{n}", origin) for n, origin in enumerate(origins)]
    with pytest.raises(
        GeometryError, match=rf'falls apart into {pieces} pieces, "body/0" and "body/\d".*occ\.fragment'
    ):
        joined(built("body", *patches))


def test_faces_inside_a_body_are_left_out_of_its_groups():
    body = joined(tower())
    inside = {face for pair in body.glued for face in (pair.first, pair.second)}
    assert inside == {Face("tower/0", 2, 1), Face("tower/1", 2, 0)}
    names = {f"{side}{n}" for side in SIDES for n in range(2)}
    assert set(body.faces) == names - {"top0", "bottom1"}
    assert {face.face for face in body.outer} == {face for group in body.faces.values() for face in group}


def test_a_group_keeps_its_faces_outside():
    patches = [block_patch(f"body/{n}", origin=(0, 0, n)) for n in range(2)]
    faces = {"tops": tuple(Face(patch.name, 2, 1) for patch in patches)}
    assert joined(built("body", *patches, faces=faces)).faces == {"tops": (Face("body/1", 2, 1),)}


def test_a_left_handed_patch_is_refused():
    patch = reversed_along(block_patch("body"), 1)
    with pytest.raises(GeometryError, match=r'patch "body" is.*left-handed'):
        joined(built("body", patch))


def test_a_folded_patch_is_refused():
    points = block_patch("body").control_points.copy()
    points[1, 1, 1] = (-1, -1, -1)
    with pytest.raises(GeometryError, match=r'patch "body" is folded.*split the volume'):
        joined(built("body", replace(block_patch("body"), control_points=points)))


def test_a_collapsed_edge_is_allowed_but_said(caplog, monkeypatch):
    points = block_patch("body").control_points.copy()
    points[0, 0], points[0, 1] = points[0, 0].copy(), points[0, 0].copy()
    monkeypatch.setattr(logging.getLogger("geom2iga"), "propagate", True)  # a command turns it off
    with caplog.at_level(logging.WARNING, "geom2iga"):
        body = joined(built("body", replace(block_patch("body"), control_points=points)))
    assert body.certificates["body"].jacobian.status == "degenerate"
    assert 'patch "body"' in caplog.text


def test_two_groups_of_one_name_are_refused():
    bodies = [joined(built(name, block_patch(name))) for name in ("one", "two")]
    face = (Face("one", 0, 0),)
    with pytest.raises(CaseError, match='two groups of faces are called "low": rename one'):
        assembled(bodies, [body.patches for body in bodies], [{"low": face}, {"low": (Face("two", 0, 0),)}])
    model = assembled(bodies, [body.patches for body in bodies], [{"low": face}, {"high": face}])
    assert model.groups == {"low": face, "high": face}


def test_two_tables_cannot_give_one_name_to_faces():
    blocks = [{"name": name, "size": ONE, "faces": [{"name": "low", "z": 0.0}]} for name in ("one", "two")]
    with pytest.raises(CaseError, match='"low"'):
        build({"geometry": {"block": blocks}})


def test_a_name_for_faces_cannot_be_that_of_a_side():
    with pytest.raises(CaseError, match="letters"):
        build({"geometry": {"block": [{"name": "a", "size": ONE, "faces": [{"name": "a/top", "z": 0.0}]}]}})


def test_one_table_cannot_give_one_name_twice():
    faces = [{"name": "low", "z": 0.0}, {"name": "low", "x": 0.0}]
    with pytest.raises(CaseError, match='"low"'):
        build({"geometry": {"block": [{"name": "a", "size": ONE, "faces": faces}]}})


def test_a_selector_cannot_take_the_name_of_a_physical_group():
    body = joined(built("body", block_patch("body"), tags={Face("body", 2, 0): 5}))
    with pytest.raises(CaseError, match='"low"'):
        face_groups(Body(faces=[{"name": "low", "x": 0.0}]), "geometry.cad[0]", [body], {"low": (5,)})


def test_physical_groups_of_faces_keep_their_names_where_they_hold_an_outer_face():
    tags = {Face("tower/0", 2, 0): 1, Face("tower/0", 2, 1): 2, Face("tower/1", 2, 0): 2, Face("tower/1", 2, 1): 3}
    body = joined(tower(tags=tags))
    physical = {"ends of it": (1, 3), "inside": (2,), "elsewhere": (17,)}
    groups = face_groups(Body(), "here", [body], physical)
    assert groups == {"ends of it": (Face("tower/0", 2, 0), Face("tower/1", 2, 1))}


def test_two_bodies_of_one_name_are_refused():
    bodies = [joined(built("body", moved(block_patch(f"{n}"), (3 * n, 0, 0)))) for n in range(2)]
    with pytest.raises(CaseError, match='two bodies are called "body": rename one'):
        assembled(bodies, [body.patches for body in bodies], [])


def test_two_bodies_of_one_name_are_called_so_though_their_faces_have_one_name_too():
    with pytest.raises(CaseError, match="two bodies are called"):
        assembled([joined(tower())] * 2, [joined(tower()).patches] * 2, [])


PRIMITIVES = {
    "cylinder": {"radius": 1.0, "height": 2.0},
    "pipe": {"inner": 1.0, "outer": 2.0, "height": 1.0},
    "sphere": {"radius": 1.0},
    "hemisphere": {"radius": 1.0},
    "domed_block": {"size": [1, 1, 1], "radius": 2.0},
    "extrusion": {"points": [[1, 0], [2, 0], [2, 1], [1, 1]], "vector": [0, 0, 1]},
    "revolution": {"points": [[1, 0], [2, 0], [2, 1], [1, 1]]},
}


def assert_certified(model, ways):
    """Each patch is proven, its volume found alike in two ways."""
    assert set(model.certificates) == set(model.patches)
    for certificate in model.certificates.values():
        assert certificate.way in ways
        assert certificate.jacobian.status == "proven"
        assert 0 < certificate.jacobian.bound <= certificate.jacobian.sampled_minimum
        assert certificate.volume == pytest.approx(certificate.enclosed_volume, rel=1e-11)


@pytest.mark.parametrize("kind", PRIMITIVES)
def test_every_primitive_is_certified(kind):
    model = build({"geometry": {kind: [PRIMITIVES[kind] | {"name": "body"}]}})
    assert_certified(model, ["exact", "given"])
    assert all(certificate.distance is None for certificate in model.certificates.values())


def test_blocks_are_certified_by_their_distance_from_what_gmsh_built():
    model = build({"geometry": {"block": [{"name": "body", "size": [1, 2, 3], "spans": 2}]}})
    assert_certified(model, ["exact"])
    (certificate,) = model.certificates.values()
    assert certificate.distance <= 3e-12
    assert certificate.volume == pytest.approx(6, rel=1e-12)


def test_cad_bodies_are_certified_by_their_distance_from_the_cad_faces():
    with open_gmsh() as occ:
        occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(1, 0, 0, 1, 1, 1))])
        occ.synchronize()
        model = build_from_gmsh(name="body")
    assert len(model.patches) == 2
    assert_certified(model, ["exact"])
    assert all(certificate.distance <= 2e-12 for certificate in model.certificates.values())


def test_imported_bodies_are_certified(tmp_path):
    write_gismo(tmp_path / "body.xml", model_of(block_patch("a", size=(1, 2, 3))))
    model = build({"geometry": {"import": [{"name": "body", "file": str(tmp_path / "body.xml")}]}})
    assert_certified(model, ["given"])
    assert model.certificates["body"].distance is None
    assert model.certificates["body"].volume == pytest.approx(6, rel=1e-14)


def test_the_mesh_does_not_change_what_is_certified():
    coarse, fine = (joined(tower(degree=p, spans=s)).certificates for p, s in ((1, 1), (3, 4)))
    assert coarse == fine


def test_samples_of_outer_faces_have_outward_normals():
    body = joined(tower())
    centre = np.array([0.5, 0.5, 1.0])
    for face in body.outer:
        assert np.einsum("qi,qi->q", face.points - centre, face.normals).min() > 0
        np.testing.assert_allclose(np.linalg.norm(face.normals, axis=1), 1, rtol=1e-12)
