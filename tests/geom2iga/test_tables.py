"""Case files that are too long, too deep or no case files at all, and what messages say of wrong values."""

import pytest

from geom2iga.case import GeometryCase
from geom2iga.errors import LONGEST, CaseError
from geom2iga.tables import LARGEST, MOST_NUMBERS, MOST_TABLES, SMALLEST, checked, read_case
from post.case import PostCase
from solve.case import SolveCase


def refusal(kind, tables):
    """What a user reads of wrong tables."""
    with pytest.raises(CaseError) as error:
        checked(tables, kind)
    return str(error.value)


def file_refusal(folder, content):
    """What a user reads of a wrong file."""
    path = folder / "case.toml"
    path.write_bytes(content)
    with pytest.raises(CaseError) as error:
        checked(read_case(path), PostCase)
    return str(error.value)


def block(**keys):
    return {"geometry": {"block": [{"name": "cube", "size": [1, 1, 1], **keys}]}}


def solve_case(**keys):
    contact = {"secondary": "a", "primary": "b", **keys}
    return {"solve": {"material": [{"young": 1.0, "poisson": 0.3}], "contact": [contact]}}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", None),
        (b"\xef\xbb\xbftitle = 'x'\r\n", None),
        (b"title = 'x'\rpost = {}", "not a TOML file"),
        (b"\xff\xfet\x00", "not a TOML file: it is not text in UTF-8 (byte 0)"),
        (b"\0" * 100, "not a TOML file"),
        (b"title = 'x'\ntitle = 'x'", "not a TOML file"),
        (b"title = " + b"9" * 5000, "thousands of digits"),
        (b"title = 0x" + b"f" * 5000, "title has more digits"),
        (b"title = " + b"[" * 5000 + b"]" * 5000, "within each other"),
        (b"title = " + b"[" * 30 + b"]" * 30, "within each other"),
        (b"title = " + b"{a=" * 3000 + b"1" + b"}" * 3000, "within each other"),
        (b"title" + b".a" * 20_000 + b" = 1", "within each other"),  # takes tomllib a minute and a gigabyte
        (b"# " + b"x" * 10_000_000, "longer than"),
        (b"title = [" + b"0," * (MOST_NUMBERS + 1) + b"]", f"title has {MOST_NUMBERS + 1} entries"),
        (b"title = [" + b"{}," * (MOST_TABLES + 1) + b"]", f"title has {MOST_TABLES + 1} entries"),
    ],
    ids=range(15),
)
def test_what_is_no_case_file_is_said_at_once(tmp_path, content, said):
    if said is None:
        (tmp_path / "case.toml").write_bytes(content)
        assert checked(read_case(tmp_path / "case.toml"), PostCase).post.samples is None
    else:
        assert said in file_refusal(tmp_path, content)


@pytest.mark.parametrize("value", [1e300, -1e300, 1.001 * LARGEST, 10**40])
def test_numbers_lie_in_a_range_in_which_their_powers_can_be_computed(value):
    assert "geometry.block[0].origin[1]" in refusal(GeometryCase, block(origin=[0.0, value, 0.0]))
    assert checked(block(origin=[0.0, LARGEST, -LARGEST]), GeometryCase)


@pytest.mark.parametrize("value", [5e-324, 1e-300, 0.999 * SMALLEST])
def test_a_size_whose_powers_would_be_nought_is_refused(value):
    said = refusal(GeometryCase, block(size=[1.0, 1.0, value]))
    assert f"geometry.block[0].size[2]: should be at least {SMALLEST:g}" in said
    assert checked(block(size=[1.0, 1.0, SMALLEST]), GeometryCase)


@pytest.mark.parametrize(
    ("kind", "tables", "said"),
    [
        (
            SolveCase,
            solve_case(method="mrtar"),
            'method = \'mrtar\': should be "mortar" or "kts"; did you mean "mortar"?',
        ),
        (SolveCase, solve_case(penalty="atuo"), "penalty = 'atuo': should be a valid number or \"auto\"; did you mean"),
        (SolveCase, solve_case(penalty=-1.0), 'penalty = -1.0: should be greater than 0 or "auto"'),
        (
            PostCase,
            {"post": {"formats": ["pgn"]}},
            'post.formats[0] = \'pgn\': should be "png", "svg" or "pdf"; did you',
        ),
        (
            PostCase,
            {"post": {"pictures": [{"name": "x"}]}},
            "should be true or false; tables go under [[post.picture]]",
        ),
        (
            PostCase,
            {"verify": [{"quantity": "gap", "value": "x", "tolerance": 1}]},
            "verify[0].value = 'x': should be a",
        ),
        (PostCase, {"verify": [{"quantity": "gap", "value": [0, "x"], "tolerance": 1}]}, "verify[0].value[1] = 'x'"),
        (PostCase, {"verify": [{"quantity": "stres", "value": 1, "tolerance": 1}]}, 'did you mean "stress"?'),
        (PostCase, {"verify": [{"quantity": "gap", "value": [1, 2], "tolerance": 1}]}, "gap has 1 component, found 2"),
        (GeometryCase, {"geometry": {"extrusion": [7]}}, "geometry.extrusion[0] = 7: should be a table"),
        (
            GeometryCase,
            block(faces=[{"name": "a", "sphere": -1}]),
            "faces[0].sphere.radius = -1: should be greater than 0",
        ),
        (GeometryCase, block(grading={"towards": "top", "ratio": 2}), 'did you mean "toward"?'),
    ],
)
def test_a_wrong_value_is_told_in_the_words_of_the_case_file(kind, tables, said):
    found = refusal(kind, tables)
    assert said in found
    assert not any(word in found for word in ("float", "literal", "tuple", "dict"))


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31mred", "\u202e", "\0", "é" * 1_000_000])
def test_what_a_case_holds_is_repeated_on_one_line_that_prints(name):
    for said in (refusal(GeometryCase, block(**{name: 1})), refusal(GeometryCase, block(name=name))):
        assert said.isprintable()
        assert len(said) <= LONGEST


@pytest.mark.parametrize("count", [2, MOST_TABLES])
def test_bodies_of_one_name_are_told_however_many_there_are(count):
    bodies = [{"name": f"a{n // 2 * 2}" if n > count - 3 else f"a{n}", "size": [1, 1, 1]} for n in range(count)]
    assert f'two bodies are called "a{count - 2}"' in refusal(GeometryCase, {"geometry": {"block": bodies}})
