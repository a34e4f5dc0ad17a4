"""Materials as programs write them: what is read, or what was taken instead and is said."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.vig_world.assets.own.test_meshes import Scene
from vig.io.errors import UserError
from vig_world.assets.own.load import Loaded, MeshPiece, load

RED, GREY, TEAL = [0.578, 0.02, 0.02], [0.5] * 3, [0.02, 0.212, 0.212]
"""Linear albedo of the picture (200, 20, 20), without one, and of Kd 0 0.5 0.5."""
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACES = "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
MTL = "newmtl skin\nKd 0 0.5 0.5\nmap_Kd t.png\n"
PNG = "t.png"


def picture(path: Path, colour: tuple[int, ...] = (200, 20, 20)) -> None:
    path.parent.mkdir(exist_ok=True, parents=True)
    Image.new("RGBA" if len(colour) == 4 else "RGB", (4, 4), colour).save(path, "png")


def obj(
    folder: Path, mtl: str | bytes, head: str = "mtllib m.mtl\nusemtl skin\n", encoding: str = "utf-8"
) -> Path:
    (folder / "m.mtl").write_bytes(mtl if isinstance(mtl, bytes) else mtl.encode(encoding, "replace"))
    (folder / "a.obj").write_bytes((head + QUAD + FACES).encode(encoding))
    return folder / "a.obj"


def read(path: Path) -> tuple[MeshPiece, list[str]]:
    loaded: Loaded = load(path.parent, path)
    (piece,) = loaded.pieces
    return piece, loaded.notes


def is_colour(path: Path, colour: list[float], opacity: float = 1.0) -> list[str]:
    piece, notes = read(path)
    np.testing.assert_allclose(piece.texture.mean((0, 1)), colour, atol=0.01)
    assert piece.opacity == pytest.approx(opacity, abs=0.01)
    return notes


@pytest.mark.parametrize(
    ("statements", "opacity"),
    [
        ("Tr 1", 1), ("Tr 0", 1), ("Tr 0.3", 0.7), ("d 0.3", 0.3), ("d 1\nTr 1", 1), ("d 1\nTr 0", 1),
        ("d 0\nTr 0", 1), ("D -halo 0.4", 0.4), ("Tr 0.3\nnewmtl opaque\nTr 1", 0.3),
        ("Tr 0.3\nnewmtl opaque\nTr 0\nnewmtl hidden\nTr 1", 0.7), ("Tr x", 1), ("d nan", 1),
        ("map_d veil.png", 0.4), ("map_d t.png", 1), ("d 0.5\nmap_d veil.png", 0.2),
    ],
)  # fmt: skip
def test_transparency_as_programs_mean_it(statements: str, opacity: float, tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    picture(tmp_path / "veil.png", (102, 102, 102))
    assert is_colour(obj(tmp_path, MTL + statements + "\n"), RED, opacity) == []


def test_a_model_is_not_wholly_transparent(tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    (note,) = is_colour(obj(tmp_path, MTL + "d 0\n"), RED)
    assert "transparent" in note


@pytest.mark.parametrize(
    ("name", "encoding"),
    [
        ("Tür", "latin-1"), ("木头", "gbk"), ("木头", "utf-16"), ("木头", "utf-16-le"), ("木头", "utf-16-be"),
        ("木头", "utf-8-sig"), ("дверь", "cp1251"), ("扉", "shift_jis"),
    ],
)  # fmt: skip
def test_names_in_any_encoding(name: str, encoding: str, tmp_path: Path) -> None:
    """Of the material in both files, and of the picture, whose file has its name in UTF-8."""
    picture(tmp_path / f"{name}.png")
    mtl = f"# für Müller\nnewmtl {name}\nmap_Kd {name}.png\n"
    for others in ("utf-8", encoding):
        path = obj(tmp_path, mtl.encode(encoding, "replace"))
        path.write_bytes(f"mtllib m.mtl\no {name}\nusemtl {name}\n{QUAD}{FACES}".encode(others))
        assert is_colour(path, RED) == []
        assert f"{name}.png" in load(tmp_path, path).files or encoding != "utf-16"


@pytest.mark.parametrize("file", ["tu\u0308te.png", "t\u00fcte.png", "T\u00dcTE.PNG"])
@pytest.mark.parametrize("name", ["tu\u0308te.png", "t\u00fcte.png"])
def test_composed_and_decomposed_names_are_one(file: str, name: str, tmp_path: Path) -> None:
    picture(tmp_path / file)
    assert is_colour(obj(tmp_path, MTL.replace(PNG, name)), RED) == []


@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("map_Kd -s 1 1 1 t.png", PNG), ("MAP_KD\t-o 0 0 -clamp on t.png", PNG),
        ("map_Kd -mm 0 1 1.png", "1.png"),
        ("map_Kd -s 1 1 2.png", "2.png"), ('map_Kd "my skin.png"', "my skin.png"),
        ("map_Kd my skin.png", "my skin.png"),
        ("map_Kd -bm 1 my skin.png # as baked", "my skin.png"), ("map_Kd t.png -s 1 1 1", PNG),
        ("map_Kd C:\\Users\\me\\t.png", PNG), ("map_Kd tex\\T.PNG", "Tex/t.png"),
        ("map_Kd ./tex//t.png", "tex/t.png"),
        ("map_Kd /home/me/t.png", PNG), ("map_Kd my%20skin.png", "my skin.png"), ("map_Kd \\\n t.png", PNG),
        ("map_Kd gone.png\nmap_Kd t.png", PNG), ("map_Kd t.png\nmap_Kd gone.png", PNG),
        ("map_Kd t.png\r", PNG),
        ("map_Kd t#1.png", "t#1.png"),
    ],
)  # fmt: skip
def test_a_picture_by_any_way_to_name_it(line: str, file: str, tmp_path: Path) -> None:
    picture(tmp_path / file)
    assert is_colour(obj(tmp_path, MTL.replace("map_Kd t.png", line)), RED) == []


def test_options_move_a_picture(tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    piece, _ = read(obj(tmp_path, MTL.replace(PNG, "-s 2 3 -o 0.5 t.png")))
    assert (piece.uv.min(0).tolist(), piece.uv.max(0).tolist()) == ([0.5, 0], [2.5, 3])


@pytest.mark.parametrize(
    ("head", "colour", "words"),
    [
        ("mtllib m.mtl\n", RED, ""), ("MTLLIB m.mtl\nUseMtl skin\n", RED, ""),
        ("mtllib other.mtl m.mtl\nusemtl skin\n", RED, ""),
        ("mtllib other.mtl\nmtllib m.mtl\nusemtl skin\n", RED, ""),
        ('mtllib "m.mtl"\nusemtl skin\n', RED, ""),
        ("mtllib my own.mtl\nusemtl skin\n", RED, ""), ("mtllib m.mtl\nusemtl SKIN # \n", RED, ""),
        ("mtllib gone.mtl\nusemtl skin\n", TEAL, "gone.mtl is missing or unreadable; a.mtl instead"),
        ("mtllib sub/m.mtl\nusemtl skin\n", RED, ""), ("mtllib m.mtl\nusemtl 'skin'\n", RED, ""),
        ("usemtl skin\n", TEAL, "no library of them (mtllib); a.mtl instead"),
        ("mtllib m.mtl\nusemtl hide\n", GREY, "material 'hide' is in no library; grey instead"),
        ("mtllib other.mtl two.mtl\n", GREY, "faces without material (usemtl); grey instead"),
        ("mtllib void.mtl\nusemtl skin\n", GREY, "material 'skin' is in no library; grey instead"),
        ("", GREY, ""),
    ],
)  # fmt: skip
def test_libraries_and_materials_as_objs_name_them(
    head: str, colour: list[float], words: str, tmp_path: Path
) -> None:
    picture(tmp_path / PNG)
    picture(tmp_path / "sub" / "beside.png")
    (tmp_path / "sub" / "m.mtl").write_text(MTL.replace(PNG, "beside.png"))
    path = obj(tmp_path, MTL, head)
    for name in ("other", "two"):
        (tmp_path / f"{name}.mtl").write_text(f"newmtl {name}\nKd 1 1 1\n")
    (tmp_path / "my own.mtl").write_text(MTL)
    (tmp_path / "void.mtl").write_text("# nothing\n")
    (tmp_path / "a.mtl").write_text("newmtl skin\nKd 0 0.5 0.5\n")
    notes = is_colour(path, colour)
    assert (words in notes[0] and len(notes) == 1) if words else not notes


@pytest.mark.parametrize(
    ("statement", "colour", "words"),
    [
        ("Kd 0 0.5 0.5 # teal", TEAL, ""), ("Kd 0 127.5 127.5", TEAL, ""), ("kd 0.5", [0.212] * 3, ""),
        ("Kd spectral a.rfl", GREY, "has Kd spectral a.rfl for a colour"),
        ("Ka 1 1 1", GREY, "has neither Kd nor map_Kd"),
        ("Kd 1 0 0\nmap_Kd gone.png", GREY, "gone.png is missing or unreadable; grey instead"),
        ("map_Kd lfs.png", GREY, "lfs.png is a Git LFS pointer; run git lfs pull; grey instead"),
        ("map_Kd web.png", GREY, "web.png is a web page"),
        ("map_Kd m.mtl", GREY, "m.mtl is missing or unreadable"),
        ("map_Kd t.png\nmap_d gone.png", RED, "gone.png is missing or unreadable; an opaque one instead"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_said(statement: str, colour: list[float], words: str, tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    (tmp_path / "lfs.png").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:aa\nsize 9\n")
    (tmp_path / "web.png").write_text("\n<!DOCTYPE html><html></html>")
    notes = is_colour(obj(tmp_path, f"newmtl skin\n{statement}\n"), colour)
    assert (words in notes[0] and len(notes) == 1) if words else not notes


def test_a_picture_without_coordinates_counts_by_its_mean(tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    path = obj(tmp_path, MTL)
    path.write_text("mtllib m.mtl\nusemtl skin\n" + QUAD + "f 1 2 3\nf 1 3 4\n")
    assert "without texture coordinates" in is_colour(path, RED)[0]
    path.write_text("mtllib m.mtl\nusemtl skin\n" + QUAD + "f 1/1 2/2 3/3\nf 1 3 4\n")  # some faces have none
    assert is_colour(path, RED) == []


@pytest.mark.parametrize(("mtl", "colour"), [("newmtl skin\nKd 1 1 1\n", [0.02, 0.212, 0.212]), (MTL, RED)])
@pytest.mark.parametrize("most", [1, 255])
def test_colours_of_an_objs_vertices_count_without_a_picture(
    mtl: str, colour: list[float], most: int, tmp_path: Path
) -> None:
    picture(tmp_path / PNG)
    path = obj(tmp_path, mtl)
    colours = [
        f"v {xyz} 0 {most / 2} {most / 2 if n else most * 0.49}"
        for n, xyz in enumerate(("0 0 0", "1 0 0", "1 1 0", "0 1 0"))
    ]
    path.write_text(
        "mtllib m.mtl\nusemtl skin\n" + "\n".join(colours) + "\n" + QUAD[QUAD.index("vt") :] + FACES
    )
    assert is_colour(path, colour) == []


@pytest.mark.parametrize("names", [("texture_u", "texture_v"), ("s", "t"), ("u", "v")])
@pytest.mark.parametrize("remark", ["comment TextureFile tüte.png", 'obj_info texturefile "TÜTE.png"'])
def test_plys_picture_by_vertices(names: tuple[str, str], remark: str, tmp_path: Path) -> None:
    picture(tmp_path / "tüte.png")
    path = tmp_path / "a.ply"
    header = f"ply\nformat ascii 1.0\n{remark}\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", *names))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(header + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n", "utf-8")
    assert is_colour(path, RED) == []
    (tmp_path / "tüte.png").unlink()
    assert "TE.png is missing or unreadable; grey instead" in is_colour(path, GREY)[0].replace("üte", "ÜTE")


def wedges(colours: bool) -> str:
    """A square of two faces with pictures of their own, and one face without."""
    return (
        "ply\nformat ascii 1.0\ncomment TextureFile t.png\ncomment TextureFile u.png\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\n"
        + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue") if colours)
        + "element face 3\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
        "property int texnumber\nend_header\n"
        + "".join(f"{xyz}{' 0 188 188' if colours else ''}\n" for xyz in ("0 0 0", "1 0 0", "1 1 0", "0 1 1"))
        + "3 0 1 2 6 0 0 1 0 1 1 0\n3 0 2 3 6 0 0 1 1 0 1 1\n3 3 2 1 0 -1\n"
    )


def test_plys_pictures_by_faces(tmp_path: Path) -> None:
    """Each face has its picture; where that is missing, the colours of vertices, or grey."""
    picture(tmp_path / PNG)
    picture(tmp_path / "u.png", (0, 188, 0))
    for colours, last in ((False, GREY), (True, [0.02, 0.503, 0.503])):
        (tmp_path / "a.ply").write_text(wedges(colours))
        pieces = load(tmp_path, tmp_path / "a.ply").pieces
        shown = sorted(piece.texture.mean((0, 1)).round(2).tolist() for piece in pieces)
        np.testing.assert_allclose(shown, sorted([RED, [0.02, 0.503, 0.02], last]), atol=0.01)
        assert [len(piece.faces) for piece in pieces] == [1, 1, 1]
    (tmp_path / "u.png").unlink()
    loaded = load(tmp_path, tmp_path / "a.ply")
    assert loaded.notes == ["u.png is missing or unreadable; the colours of its vertices or faces instead"]


def test_plys_colours_as_fractions_or_up_to_255(tmp_path: Path) -> None:
    for kind, colour in (("uchar", "200 20 20"), ("float", "0.784 0.078 0.078"), ("float", "200 20 20")):
        header = (
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        )
        header += "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
        header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        rows = "".join(f"{xyz} {colour}\n" for xyz in ("0 0 0", "1 0 0", "0 1 0"))
        (tmp_path / "a.ply").write_text(header + rows + "3 0 1 2\n")
        assert is_colour(tmp_path / "a.ply", RED) == []


def scene(folder: Path, material: dict, colours: np.ndarray | None = None, kind: int = 5126) -> Path:
    """A glTF of one triangle with a picture, its material, and colours of its vertices."""
    made = Scene(folder)
    made.box()
    if colours is not None:
        made.primitive["attributes"]["COLOR_0"] = made.accessor(
            colours, kind, "VEC3", normalized=kind != 5126
        )
    made.primitive["attributes"]["TEXCOORD_0"] = made.accessor(np.zeros((8, 2), np.float32), 5126, "VEC2")
    made.primitive["material"] = 0
    made.tree |= {"materials": [material], "textures": [{"source": 0}], "images": [{"uri": PNG}]}
    return made.write()


@pytest.mark.parametrize("kind", [5126, 5121, 5123])
def test_gltfs_colours_of_vertices_are_a_factor(kind: int, tmp_path: Path) -> None:
    """Of the base colour, linear; as floats, or as bytes and words that are fractions."""
    most, dtype = {5126: (1.0, "<f4"), 5121: (255, "u1"), 5123: (65535, "<u2")}[kind]
    half = (np.full((8, 3), 0.5) * most).astype(dtype)
    factor = {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.4, 0.2, 1]}}
    assert is_colour(scene(tmp_path, factor, half, kind), [0.4, 0.2, 0.1]) == []
    picture(tmp_path / PNG)
    factor["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}  # type: ignore[assignment]
    assert is_colour(scene(tmp_path, factor, half, kind), [0.4 * 0.578, 0.02, 0.02]) == []


def test_gltfs_colours_of_vertices_tint_a_picture_in_parts(tmp_path: Path) -> None:
    picture(tmp_path / PNG, (255, 255, 255))
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    colours = np.float32([[1, 0, 0]] * 4 + [[0, 0, 1]] * 4)
    pieces = load(tmp_path, scene(tmp_path, material, colours)).pieces
    assert sum(len(piece.faces) for piece in pieces) == 12 and 2 <= len(pieces) <= 8
    reds = [piece.texture.mean((0, 1))[0] for piece in pieces if piece.vertices[:, 0].max() < 0]
    assert reds == [pytest.approx(0.95)]  # the box's first four vertices are those with x < 0


@pytest.mark.parametrize("within", [True, False])
def test_specular_glossiness(within: bool, tmp_path: Path) -> None:
    picture(tmp_path / PNG)
    gloss = {"diffuseFactor": [0.5, 1, 1, 0.3]} | ({"diffuseTexture": {"index": 0}} if within else {})
    material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}, "alphaMode": "BLEND"}
    colour = [0.289, 0.02, 0.02] if within else [0.5, 0.95, 0.95]
    assert is_colour(scene(tmp_path, material), colour, 0.3) == []


@pytest.mark.parametrize(
    ("break_picture", "words"),
    [
        (lambda tree: tree["images"][0].update(uri="gone.png"), "gone.png is missing or unreadable; grey"),
        (lambda tree: tree["images"][0].update(uri="lfs.png"), "lfs.png is a Git LFS pointer"),
        (lambda tree: tree["images"][0].update(uri="data:,AA"), "a picture within the file is"),
        (lambda tree: tree["images"][0].pop("uri"), "picture 0 is missing or unreadable; grey"),
        (lambda tree: tree["textures"][0].pop("source"), "picture None is missing or unreadable; grey"),
    ],
    ids=["missing", "pointer", "damaged", "empty", "basisu"],
)  # fmt: skip
def test_gltfs_unreadable_picture_is_grey_and_said(
    break_picture: Callable[[dict], object], words: str, tmp_path: Path
) -> None:
    (tmp_path / "lfs.png").write_text("version https://git-lfs.github.com/spec/v1\n")
    stated = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 1, 1]}
    path = scene(tmp_path, {"pbrMetallicRoughness": stated})
    tree = json.loads(path.read_text())
    break_picture(tree)
    path.write_text(json.dumps(tree))
    (note,) = is_colour(path, [0.5, 0.25, 0.5])
    assert words in note


@pytest.mark.parametrize("mesh", ["gltf", "obj"])
@pytest.mark.parametrize("siblings_are_links", [True, False])
def test_files_that_are_links(mesh: str, siblings_are_links: bool, tmp_path: Path) -> None:
    """As in a hub's cache, where all lead to numbered files; or one to a mesh beside its other files."""
    blobs, shown = tmp_path / "blobs", tmp_path / "snapshots" / "main"
    shown.mkdir(parents=True)
    blobs.mkdir()
    picture(blobs / PNG)
    if mesh == "obj":
        path = obj(blobs, MTL)
    else:
        path = scene(blobs, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    for number, file in enumerate(sorted(blobs.iterdir())):
        if siblings_are_links:
            (shown / file.name).symlink_to(file.rename(blobs / f"{number}"))
        elif file == path:
            (shown / file.name).symlink_to(file)
    assert is_colour(shown / path.name, RED) == []
    assert load(tmp_path / "snapshots", shown / path.name).notes == []


def test_a_folder_that_is_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    picture(tmp_path / "elsewhere" / PNG)
    obj(tmp_path / "elsewhere", MTL)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "m0").symlink_to(tmp_path / "elsewhere")
    assert load(tmp_path / "meshes", tmp_path / "meshes" / "m0" / "a.obj").notes == []


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb", "gltf"])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("version https://git-lfs.github.com/spec/v1\noid", "a Git LFS pointer; run git lfs pull"),
        ("\ufeff\n<!DOCTYPE HTML>\n<html><head>", "a web page; download the file itself"),
        ("<?xml version='1.0'?><Error/>", "an XML document; download the file itself"),
        ("/annex/objects/SHA256E-s9--aa.obj\n", "a git-annex pointer; run git annex get"),
    ],
    ids=["lfs", "web", "xml", "annex"],
)  # fmt: skip
def test_what_stands_for_a_mesh_is_named(suffix: str, content: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_text(content, "utf-8")
    with pytest.raises(UserError, match=f"expected a mesh; got {words}"):
        load(tmp_path, path)


def test_a_buffer_that_is_a_pointer_is_named(tmp_path: Path) -> None:
    path = scene(tmp_path, {})
    path.with_suffix(".bin").write_text("version https://git-lfs.github.com/spec/v1\n" + " " * 500)
    with pytest.raises(UserError, match="a.bin is a Git LFS pointer"):
        load(tmp_path, path)


def test_a_flat_mesh_is_read(tmp_path: Path) -> None:
    """An open rectangle, as of a poster."""
    (tmp_path / "a.obj").write_text("v -0.1 0 0\nv 0.1 0 0\nv 0.1 0 0.15\nv -0.1 0 0.15\nf 1 2 3\nf 1 3 4\n")
    piece, notes = read(tmp_path / "a.obj")
    assert len(piece.faces) == 2 and notes == []
