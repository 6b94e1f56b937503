import pytest

from geom2iga.cad import importing
from geom2iga.errors import GeometryError
from tests.robustness import cad_mutation
from tests.robustness.cad_mutants import attempted
from tests.robustness.cad_mutation import Mutant, mutant, seeds

FEW, MORE = range(2000, 2004), range(2100, 2160)


@pytest.mark.parametrize("number", [*FEW, *(pytest.param(number, marks=pytest.mark.slow) for number in MORE)])
def test_a_mutant_of_a_cad_file_ends_with_one_sentence_and_leaves_nothing(number):
    assert attempted(number).wrong == ()


@pytest.mark.slow
@pytest.mark.parametrize("trap", cad_mutation.TRAPS, ids=lambda trap: trap[:20])
def test_a_script_that_does_not_end_or_grows_without_bounds_is_stopped(monkeypatch, trap):
    text = cad_mutation.HEAD + trap.format(self="model.geo", other="beside.geo")
    monkeypatch.setattr("tests.robustness.cad_mutants.mutant", lambda number: Mutant("model.geo", text.encode(), {}))
    ending = attempted(0)
    assert ending.wrong == ()
    assert ending.code == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in sorted(seeds()) if not name.endswith(".iges")])
def test_what_the_mutants_are_made_of_is_read(monkeypatch, name):
    """A mutant that ends with a message would show nothing, were its seed not read at all."""
    monkeypatch.setattr("tests.robustness.cad_mutants.mutant", lambda number: Mutant(name, seeds()[name], {}))
    ending = attempted(0)
    assert ending.wrong == ()
    refused = {
        "ball": "is a sphere of 1 edges|meets itself|has 1 face",
        "octant": "has 4 faces",
        "script1": "split|faces",
    }
    if ending.code:
        assert name.partition(".")[0] in refused


def test_a_mutant_is_always_the_same():
    assert [mutant(number) for number in range(5)] == [mutant(number) for number in range(5)]


def test_the_patience_with_gmsh_grows_with_the_file(tmp_path):
    (tmp_path / "short.step").write_bytes(b"")
    (tmp_path / "long.step").write_bytes(b" " * 10_000_000)
    assert importing._patience(tmp_path / "short.step") == importing.PATIENCE
    (tmp_path / "script.geo").write_bytes(b'Merge "long.step";\nMerge "missing.step";\n'.ljust(500_000))
    assert importing._patience(tmp_path / "long.step") == importing.PATIENCE + 10 * importing.PER_MEGABYTE
    assert importing._patience(tmp_path / "script.geo") == importing.PATIENCE + 10.5 * importing.PER_MEGABYTE


SECTIONS = ("Curve2ds", "Curves", "Polygon3D", "PolygonOnTriangulations", "Surfaces", "Triangulations")


def brep(locations="Locations 0\n", shapes="", count=0):
    """The text of a boundary representation."""
    middle = "".join(f"{name} 0\n" for name in SECTIONS)
    return f"CASCADE Topology V1, (c) Matra-Datavision\n{locations}{middle}\nTShapes {count}\n{shapes}\n+1 0\n"


@pytest.mark.parametrize(
    "text",
    [
        brep(shapes="Co\n\n1111111\n+1 0 *\n", count=1),  # a compound of itself
        brep(shapes="Co\n\n1111111\n+1 0 *\nCo\n\n1111111\n+2 0 *\n", count=2),  # two of each other
        brep("Locations 2\n1\n1 0 0 nan\n0 1 0 0\n0 0 1 0\n2 1 1 0\n"),
        brep("Locations 1\n1\n1 0 0 1e300\n0 1 0 0\n0 0 1 0\n"),
        brep("Locations 4\n" + "1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n" * 2 + "2 1 1 2 1 0\n2 3 999999999 0\n", count=0),
        brep(
            "Locations 60\n"
            + "1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n" * 2
            + "2 1 1 2 1 0\n"
            + "".join(f"2 {k} 1 {k} 1 0\n" for k in range(3, 60))
        ),
        brep().replace("Curves 0\n", "Curves 1\n" + "8 0 1 " * 20_000),  # a trimmed curve of a trimmed curve of ...
        brep().replace("Surfaces 0", "Surfaces " + "9" * 5000),
    ],
    ids=["itself", "each other", "nan", "huge", "power", "doubled", "trimmed", "count"],
)
def test_a_boundary_representation_that_would_not_end_is_refused(text):
    with pytest.raises(GeometryError, match="cut off or damaged"):
        importing.read_brep(text)
