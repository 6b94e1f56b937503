"""CAD files that are nearly right: small models with bytes, lines, numbers or sections changed at random."""

import os
from collections.abc import Callable
from functools import cache
from math import pi
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any, NamedTuple

import gmsh

from geom2iga.exchange.gismo import write_gismo
from tests.cases import bent_patch, block_patch, model_of
from tests.robustness.streams import written_to

HEAD = 'SetFactory("OpenCASCADE");\n'
SCRIPTS = (
    "Box(1) = {0, 0, 0, 1, 2, 3};\n",
    """Cylinder(1) = {0, 0, 0, 0, 0, 1, 2, Pi/3};
Box(2) = {-1, -1, 0, 1.5, 4, 1};
BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }
""",
    """Box(1) = {0, 0, 0, 1, 1, 1};
Box(2) = {1, 0, 0, 1, 1, 1};
Coherence;
Physical Volume("pair") = {1, 2};
""",
    """Point(1) = {0, 0, 0, 1};
Point(2) = {1, 0, 0, 1};
Line(1) = {1, 2};
Extrude {0, 1, 0} { Line{1}; }
Extrude {0, 0, 1} { Surface{1}; Layers{3}; Recombine; }
""",
)
TRAPS = (  # scripts that do not end, or grow without bounds
    'Include "{self}";\n',
    'Include "{other}";\n',
    'Merge "{self}";\n',
    "For i In {{0:1}}\ni = 0;\nEndFor\n",
    "a = 1;\nFor i In {{0:1e9}}\na = a + i;\nEndFor\n",
    "For i In {{1:100000}}\nBox(i) = {{i, 0, 0, 0.5, 0.5, 0.5}};\nEndFor\n",
    "Macro again\nCall again;\nReturn\nCall again;\n",
    "l() = {{0:1e10}};\n",
    "l() = {{1}};\nFor i In {{0:60}}\nl() += l();\nEndFor\n",
    's = "aaaaaaaa";\nFor i In {{0:60}}\ns = StrCat(s, s);\nEndFor\n',
    "Box(1) = {{0, 0, 0, 1, 1, 1}};\nMesh.MeshSizeMax = 1e-9;\nMesh 3;\n",
    "Point(1) = {{0, 0, 0, 1}};\nExtrude {{0, 0, 1}} {{ Point{{1}}; Layers{{1000000000}}; }}\nMesh 1;\n",
    "Box(1) = {{0, 0, 0, 1, 1, 1}};\nTransfinite Curve{{:}} = 100000;\nTransfinite Surface{{:}};\nMesh 2;\n",
    "Box(1) = {{1/0, 0, 0, 1e300, 1, 0/0}};\n",
    "Box(1) = {{0, 0, 0, -1, 0, 1e-30}};\n",
    "Box(2147483647) = {{0, 0, 0, 1, 1, 1}};\nBox(99999999999) = {{0, 0, 0, 1, 1, 1}};\n",
    "Exit;\n",
    "Abort;\n",
    "Error(\"no\");\n",
    "Delete Model;\nDelete All;\n",
    "x = " + "(" * 20000 + "1" + ")" * 20000 + ";\n",
    "For i In {{0:1}}\n" * 2000,
)  # fmt: skip
VALUES = (
    *("nan", "-nan", "inf", "1e308", "-1e308", "1e-308", "1e400", "0", "-0", "-1", "1", "2147483648", "1e10", "1e-10"),
    *("99999999999999999999999", "-2147483649", "1e100", "0x1p3", "'", "", "**", "$", "1.", ".", "1e", "3e-8", "1e20"),
    *("2", "3", "0.5", "4", "5", "6", "7", "-0.5", "1e-5", "1e6", "1.0000001", "0.9999999", "0.7071", "10", "100"),
)
NONSENSE = (b"", b"\0", b"\xff\xfe", b"hello\n", b"ISO-10303-21;\n", b"DBRep_DrawableShape\n", b"<XAO>", b"\n" * 1000)
FORMATS = (*(".step", ".brep", ".geo") * 3, *(".xao",) * 2, ".iges", ".xml")
PLACES = ("folder", "link", "loop", "nothing", "unreadable")
NUMERIC = b"0123456789.eE+-"


class Mutant(NamedTuple):
    """A file, what is laid beside it, and what the table of the case says of it."""

    name: str
    content: bytes
    keys: dict[str, Any]
    place: str = "file"  # or one of PLACES


Change = Callable[[Random, bytes], bytes]


def _ring_sector(occ: Any) -> None:
    outer, inner = (occ.addCylinder(0, 0, 0, 0, 0, 1, radius, angle=pi / 2) for radius in (2, 1))
    occ.cut([(3, outer)], [(3, inner)])


def _pair(occ: Any) -> None:
    boxes = [occ.addBox(x, 0, 0, 1, 1, 1) for x in (0, 1)]
    occ.fragment([(3, boxes[0])], [(3, boxes[1])])


def _octant(occ: Any) -> None:
    occ.addSphere(0, 0, 0, 1, angle1=0, angle2=pi / 2, angle3=pi / 2)


def _twisted(occ: Any) -> None:
    loops = [
        occ.addWire([occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)])
        for points in (
            [occ.addPoint(x + 0.1 * z, y - 0.2 * x * z, z) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))] for z in (0, 1)
        )
    ]
    occ.addThruSections(loops)


MODELS: dict[str, Callable[[Any], object]] = {
    "box": lambda occ: occ.addBox(0, 0, 0, 1, 2, 3),
    "ring": _ring_sector,
    "pair": _pair,
    "octant": _octant,
    "ball": lambda occ: occ.addSphere(0, 0, 0, 1),
    "twisted": _twisted,
}


@cache
def seeds() -> dict[str, bytes]:
    """Write every model in every format, once."""
    with TemporaryDirectory() as name, TemporaryFile() as said, written_to(said.fileno()):
        folder = Path(name)
        for model, make in MODELS.items():
            gmsh.initialize(readConfigFiles=False, interruptible=False)
            try:
                gmsh.option.setNumber("General.Terminal", 0)
                make(gmsh.model.occ)
                gmsh.model.occ.synchronize()
                for ending in ("step", "brep", "iges", "xao"):
                    gmsh.write(str(folder / f"{model}.{ending}"))
            finally:
                gmsh.finalize()
        write_gismo(folder / "bent.xml", model_of(bent_patch(3)))
        write_gismo(folder / "two.xml", model_of(block_patch("a"), block_patch("b", origin=(1, 0, 0))))
        scripts = {f"script{number}.geo": (HEAD + text).encode() for number, text in enumerate(SCRIPTS)}
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())} | scripts


def mutant(number: int) -> Mutant:
    """Make the mutant of a number: always the same."""
    random = Random(number)
    suffix = random.choice(FORMATS)
    name = random.choice([name for name in sorted(seeds()) if name.endswith(suffix)])
    content = seeds()[name]
    keys: dict[str, Any] = {} if suffix == ".xml" else {"route": random.choice(("exact",) * 3 + ("mesh",))}
    if suffix == ".geo" and random.random() < 0.5:
        trap = random.choice(TRAPS).format(self="model.geo", other="beside.geo")
        content = random.choice((HEAD + trap, HEAD + SCRIPTS[0] + trap)).encode()
    elif random.random() < 0.06:
        return Mutant(f"model{suffix}", content, keys, random.choice(PLACES))
    else:
        for _ in range(random.choice((1, 1, 1, 2, 5))):
            content = random.choice(CHANGES)(random, content)
    if random.random() < 0.06:
        suffix = random.choice((".step", ".brep", ".iges", ".xao", ".geo", ".xml", ".stp", ".igs", ".STEP", ".msh", ""))
    if suffix == ".geo" and random.random() < 0.9:
        content += b"\n"
    return Mutant(f"model{suffix}", content, keys)


def lay_out(case: Mutant, folder: Path) -> None:
    """Write a mutant and its case into a folder."""
    path = folder / case.name
    if case.place == "folder":
        path.mkdir()
    elif case.place == "loop":
        path.symlink_to(case.name)
    elif case.place == "link":
        path.symlink_to("elsewhere")
        (folder / "elsewhere").symlink_to(case.name)
    elif case.place != "nothing":
        path.write_bytes(case.content)
    if case.place == "unreadable":
        path.chmod(0)
    (folder / "beside.geo").write_text(f'Include "{case.name}";\n')
    kind = "import" if path.suffix == ".xml" else "cad"
    keys = "".join(f'{key} = "{value}"\n' for key, value in case.keys.items() if kind == "cad")
    text = f'[[geometry.{kind}]]\nname = "body"\nfile = "{case.name}"\n{keys}'
    (folder / "case.toml").write_text(text + ("fit_spans = 2\n" if "mesh" in keys else ""))


def _cut_off(random: Random, content: bytes) -> bytes:
    return content[: random.randrange(len(content) + 1)]


def _begun_late(random: Random, content: bytes) -> bytes:
    return content[random.randrange(len(content) + 1) :]


def _flipped(random: Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(random.choice((1, 1, 3, 20))):
        if changed:
            changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def _bytes_replaced(random: Random, content: bytes) -> bytes:
    at = random.randrange(len(content) + 1)
    return content[:at] + random.randbytes(random.choice((1, 4, 200))) + content[at + random.choice((0, 1, 4, 200)) :]


def _lines_changed(random: Random, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    one, other = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            lines[one], lines[other] = lines[other], lines[one]
        case 1:
            lines.insert(other, lines[one])
        case 2:
            del lines[one]
        case 3:
            lines[one] *= random.choice((2, 1000))
    return b"".join(lines)


def _number_changed(random: Random, content: bytes) -> bytes:
    starts = [k for k in range(len(content)) if content[k : k + 1].isdigit() and content[k - 1 : k] not in NUMERIC]
    if not starts:
        return content
    start = random.choice(starts)
    end = start
    while end < len(content) and content[end : end + 1] in [bytes([each]) for each in NUMERIC]:
        end += 1
    return content[:start] + random.choice(VALUES).encode() + content[end:]


def _with_a_piece_of_another(random: Random, content: bytes) -> bytes:
    other = seeds()[random.choice(sorted(seeds()))]
    start, at = random.randrange(len(other) + 1), random.randrange(len(content) + 1)
    return content[:at] + other[start : start + random.choice((20, 500, 5000))] + content[at:]


def _section_repeated(random: Random, content: bytes) -> bytes:
    start = random.randrange(len(content) + 1)
    return content[:start] + content[start:][: random.choice((50, 2000))] * 3 + content[start:]


def _nonsense(random: Random, content: bytes) -> bytes:
    return random.choice((*NONSENSE, random.randbytes(random.choice((1, 50, 5000))), os.fsencode(HEAD)))


CHANGES: tuple[Change, ...] = (
    *(_cut_off, _begun_late, _flipped, _flipped, _bytes_replaced, _lines_changed, _lines_changed),
    *(_number_changed,) * 9,
    *(_with_a_piece_of_another, _section_repeated, _nonsense),
)
