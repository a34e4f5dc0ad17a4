"""Users' props: textures, axes, units and settings; what is wrong is named and left out."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from vig.io.errors import UserError
from vig.scene import linear_from_srgb
from vig_world.assets.own.counting import MAX_FACES as MAX_READ
from vig_world.assets.own.props import MAX_FACES, read_props
from vig_world.mesh import face_normals

RED, BLUE = (200, 20, 20), (20, 20, 200)


def box(path: Path, size: tuple[float, float, float] = (0.06, 0.04, 0.1), **settings: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(size, **settings).export(path)
    return path


def textured(folder: Path, picture: bool = True) -> None:
    """A tetrahedron whose picture is red above and blue below."""
    folder.mkdir(exist_ok=True)
    (folder / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl skin\n"
        "f 1/1 3/3 2/2\nf 1/1 2/2 4/3\nf 1/1 4/3 3/2\nf 2/1 3/2 4/3\n"
    )
    (folder / "a.mtl").write_text("newmtl skin\nKd 0 0 0\nmap_Kd skin.png\n")
    if picture:
        pixels = np.zeros((512, 512, 3), np.uint8)
        pixels[:256], pixels[256:] = RED, BLUE
        Image.fromarray(pixels).save(folder / "skin.png")


def linear(colour: tuple[int, int, int]) -> np.ndarray:
    return np.clip(linear_from_srgb(np.array(colour) / 255), 0.02, 0.95)


def size(prop) -> np.ndarray:
    return np.ptp(np.concatenate([mesh.vertices for mesh, _ in prop.read()]), axis=0)


def test_an_obj_keeps_its_texture_and_stands_centred(tmp_path: Path) -> None:
    textured(tmp_path)
    ((own,), problems) = read_props(tmp_path)
    assert problems == [] and own.name == "a.obj" and own.family == "a" and own.zones == ()
    ((mesh, material),) = own.read()
    assert material.texture.shape == (256, 256, 3) and material.kind == "plastic"
    np.testing.assert_allclose(material.texture[0, 0], linear(RED), atol=1e-5)
    np.testing.assert_allclose(material.texture[-1, 0], linear(BLUE), atol=1e-5)
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    np.testing.assert_allclose([low[2], *(low + high)[:2]], 0, atol=1e-7)
    tip = mesh.uv[mesh.vertices[:, 2].argmax()]
    np.testing.assert_allclose(tip, [0, 1])  # v = 1 is the picture's top


def test_a_missing_picture_is_grey_and_named(tmp_path: Path) -> None:
    textured(tmp_path, picture=False)
    ((own,), problems) = read_props(tmp_path)
    assert len(problems) == 1 and "skin.png is missing or unreadable" in problems[0]
    (tmp_path / "skin.png").write_bytes(b"\x89PNG\r\n\x1a\n half a picture")
    assert "skin.png" in read_props(tmp_path)[1][0]
    assert np.ptp(own.read()[0][1].texture) == 0


def test_the_fingerprint_follows_every_file_that_was_read_and_the_settings(tmp_path: Path) -> None:
    textured(tmp_path)
    marks = [read_props(tmp_path)[0][0].fingerprint]
    Image.new("RGB", (4, 4), BLUE).save(tmp_path / "skin.png")
    marks.append(read_props(tmp_path)[0][0].fingerprint)
    (tmp_path / "vig.toml").write_text('[defaults]\nzones = ["desk"]\n')
    marks += [read_props(tmp_path)[0][0].fingerprint for _ in range(2)]
    assert len(set(marks)) == 3 and marks[2] == marks[3] and len(marks[0]) == 64


def test_gltf_is_y_up_and_its_nested_transforms_are_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[0.5, 0.25, 0.125, 1.0])
    brick = trimesh.creation.box((0.1, 0.2, 0.05))
    brick.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
    double = np.diag([2.0, 2.0, 2.0, 1.0])
    scene.graph.update("outer", "world", matrix=double)
    scene.add_geometry(brick, node_name="brick", parent_node_name="outer")
    scene.export(tmp_path / "a.glb")
    ((own,), _) = read_props(tmp_path)
    np.testing.assert_allclose(size(own), [0.2, 0.1, 0.4], atol=1e-6)
    texture = own.read()[0][1].texture
    np.testing.assert_allclose(texture.reshape(3), [0.5, 0.25, 0.125], atol=0.003)


def test_only_the_nodes_asked_for_are_taken(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for name, height in (("pot", 0.1), ("cup", 0.05)):
        scene.add_geometry(trimesh.creation.box((0.05, height, 0.05)), node_name=name, geom_name=name)
    scene.export(tmp_path / "set.glb")
    (tmp_path / "vig.toml").write_text('[files."set.glb"]\nnodes = ["cup"]\n')
    np.testing.assert_allclose(size(read_props(tmp_path)[0][0])[2], 0.05, atol=1e-6)
    (tmp_path / "vig.toml").write_text('[files."set.glb"]\nnodes = ["jug"]\n')
    with pytest.raises(UserError, match="expected nodes among cup pot; got jug"):
        read_props(tmp_path)


def test_several_materials_become_several_parts_and_colours_of_faces_a_palette(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.05, 0.05, 0.1))
    mesh.visual.face_colors = [(*RED, 255)] * 6 + [(*BLUE, 255)] * 6
    scene = trimesh.Scene()
    for name, colour in (("a", RED), ("b", BLUE)):
        brick = trimesh.creation.box((0.05, 0.05, 0.05))
        brick.apply_translation([0.1 if name == "b" else 0, 0, 0])
        paint = trimesh.visual.material.PBRMaterial(baseColorFactor=[*colour, 255])
        brick.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=paint)
        scene.add_geometry(brick, node_name=name)
    scene.export(tmp_path / "parts.glb")
    mesh.export(tmp_path / "coloured.ply")
    (coloured, parts), _ = read_props(tmp_path)
    assert len(parts.read()) == 2
    ((mesh, material),) = coloured.read()
    column = (mesh.uv[mesh.faces].mean(1)[:, 0] * material.texture.shape[1]).astype(int)
    seen = material.texture[0, column]
    expected = [linear(RED), linear(BLUE)]
    assert all(min(np.abs(colour - one).max() for one in expected) < 0.02 for colour in seen)
    assert len(np.unique(seen, axis=0)) == 2


def test_what_can_stand_on_one_side_only_stands_on_it(tmp_path: Path) -> None:
    cone = trimesh.creation.cone(0.04, 0.12)
    cone.export(tmp_path / "z.obj")
    cone.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    cone.export(tmp_path / "y.obj")
    (y, z), problems = read_props(tmp_path)
    assert problems == []
    np.testing.assert_allclose(size(y), size(z), atol=1e-6)
    for own in (y, z):
        vertices = own.read()[0][0].vertices
        assert np.hypot(*vertices[vertices[:, 2].argmax(), :2]) < 1e-6  # the tip is up


@pytest.mark.parametrize(
    ("units", "metres", "said"),
    [(0.1, 0.1, ""), (80, 0.08, "millimetres"), (20, 0.2, "centimetres"), (250, 0.25, "millimetres")],
)
def test_units_are_guessed_by_the_size_of_household_things(
    tmp_path: Path, units: float, metres: float, said: str
) -> None:
    box(tmp_path / "a.stl", (units / 2, units / 2, units))
    ((own,), problems) = read_props(tmp_path)
    assert abs(size(own).max() - metres) < 1e-6
    assert [said in problem for problem in problems] == ([True] if said else [])


def test_the_toml_goes_before_every_guess(tmp_path: Path) -> None:
    box(tmp_path / "deep" / "a.obj", (20, 30, 40))
    (tmp_path / "vig.toml").write_text('[defaults]\nup = "x"\nscale = 0.01\nzones = ["desk"]\n')
    (tmp_path / "deep" / "vig.toml").write_text('[files."a.obj"]\nscale = 0.001\nturn = 90\nfamily = "box"\n')
    ((own,), problems) = read_props(tmp_path)
    assert problems == [] and own.zones == ("desk",) and own.family == "box"
    np.testing.assert_allclose(size(own), [0.03, 0.04, 0.02], atol=1e-6)
    box(tmp_path / "b.obj", (0.5, 0.5, 0.5))
    (tmp_path / "vig.toml").write_text('[files."b.obj"]\nskip = true\n')
    assert [own.name for own in read_props(tmp_path)[0]] == ["deep/a.obj"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[defaults]\nheight = 3\n", "unknown field `height` - at `$`, in [defaults]"),
        ("[defaults]\nscale = 'big'\n", "Expected `float | null`, got `str` - at `$.scale`, in [defaults]"),
        ("[defaults]\nscale = 0\n", "Expected `float` > 0.0"),
        ("[defaults]\nscale = true\n", "Expected `float | null`, got `bool`"),
        ("[defaults]\nturn = nan\n", "turn"),
        (
            "[defaults]\nup = 'up'\n",
            "'up' - at `$.up`, in [defaults]). Tables are [defaults] and [files.NAME]; in each up is one of",
        ),
        ("[defaults]\nzones = 'desk'\n", "Expected `array`, got `str`"),
        ("[defaults]\nzones = ['moon']\n", "Invalid enum value 'moon'"),
        ("[defaults]\nskip = 1\n", "Expected `bool`, got `int`"),
        ("[files.'b.obj']\nskip = true\n", "[files.'b.obj'], but there is no such file beside it"),
        ("[files]\n'a.obj' = 3\n", "Expected `object`, got `int`, in a.obj"),
        ("files = 3\n", "Expected `object`, got `int`"),
        ("defaults = 3\n", "Expected `object`, got `int`"),
        ("[default]\n", "Invalid enum value 'default'"),
        ("up = \n", "Invalid value (at line 1, column 6)"),
    ],
)
def test_a_wrong_toml_is_refused_with_its_name(tmp_path: Path, text: str, said: str) -> None:
    box(tmp_path / "a.obj")
    (tmp_path / "vig.toml").write_text(text)
    with pytest.raises(UserError) as refusal:
        read_props(tmp_path)
    assert said in str(refusal.value) and "vig.toml" in str(refusal.value)


def bad_files(folder: Path) -> dict[str, str]:
    """Bad mesh files by name, and what is said of each."""
    box(folder / "whole.glb")
    (folder / "empty.obj").touch()
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (folder / "nan.obj").write_text("v 0 0 0\nv 0.1 0 nan\nv 0 0.1 0\nf 1 2 3\n")
    (folder / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0.2 0 0\nf 1 2 3\n")
    (folder / "index.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    (folder / "text.stl").write_text("not a mesh")
    (folder / "cut.glb").write_bytes((folder / "whole.glb").read_bytes()[:300])
    (folder / "alone.gltf").write_text(
        json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 9}],
                    "bufferViews": [{"buffer": 0, "byteLength": 9}],
                    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
                    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                    "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]})
    )  # fmt: skip
    (folder / "huge.stl").write_bytes(bytes(80) + struct.pack("<I", 10_000_000) + bytes(100))
    (folder / "huge.ply").write_text(
        "ply\nformat binary_little_endian 1.0\nelement vertex 5000000\nelement face 10000000\nend_header\n"
    )
    (folder / "huge.off").write_text("OFF\n5000000 10000000 0\n")
    (folder / "huge.obj").write_bytes(b"v 0 0 0\n" + b"f 1 1 1\n" * (MAX_READ + 1))
    box(folder / "hall.obj", (7, 8, 900))
    return {
        "empty.obj": "an empty file", "points.obj": "expected", "nan.obj": "NaN or infinite",
        "flat.obj": "degenerate", "index.off": "expected", "text.stl": "expected", "cut.glb": "damaged",
        "alone.gltf": "damaged", "huge.stl": "10,000,000", "huge.ply": "10,000,000",
        "huge.off": "10,000,000", "huge.obj": "at most 1,000,000 faces", "hall.obj": "900 units",
    }  # fmt: skip


def test_bad_meshes_are_named_and_left_out(tmp_path: Path) -> None:
    said = bad_files(tmp_path)
    props, problems = read_props(tmp_path)
    assert [own.name for own in props] == ["whole.glb"]
    assert len(problems) == len(said)
    for name, words in said.items():
        (line,) = [problem for problem in problems if name in problem]
        assert words in line and line.endswith("Left out.") and "\n" not in line, line


def test_dense_meshes_are_thinned_without_losing_shape_or_closedness(tmp_path: Path) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    assert len(sphere.faces) > 4 * MAX_FACES
    sphere.export(tmp_path / "a.ply")
    ((own,), _) = read_props(tmp_path)
    ((mesh, _),) = own.read()
    assert 0.3 * MAX_FACES < len(mesh.faces) <= MAX_FACES
    radius = np.linalg.norm(mesh.vertices - [0, 0, mesh.vertices[:, 2].max() / 2], axis=1)
    assert np.abs(radius - 0.1).max() < 0.002
    normals = face_normals(mesh.vertices.astype(np.float64), mesh.faces)
    assert np.abs(normals.sum(0)).max() < 1e-6


def test_open_meshes_get_a_back_and_inverted_ones_are_turned(tmp_path: Path) -> None:
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3\nf 1 3 4\n")
    brick = trimesh.creation.box((0.1, 0.1, 0.1))
    brick.invert()
    brick.export(tmp_path / "inverted.obj")
    (inverted, sheet), _ = read_props(tmp_path)
    normals = face_normals(sheet.read()[0][0].vertices, sheet.read()[0][0].faces)
    assert len(normals) == 4 and np.abs(normals.sum(0)).max() < 1e-9
    mesh = inverted.read()[0][0]
    centres = mesh.vertices[mesh.faces].mean(1) - [0, 0, 0.05]
    assert ((face_normals(mesh.vertices, mesh.faces) * centres).sum(1) > 0).all()


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    textured(tmp_path / "inside", picture=False)
    Image.new("RGB", (4, 4), RED).save(tmp_path / "skin.png")
    (tmp_path / "inside" / "a.mtl").write_text("newmtl skin\nmap_Kd ../skin.png\n")
    assert "../skin.png is missing" in read_props(tmp_path / "inside")[1][0]
    assert read_props(tmp_path)[1] == []  # from above, it lies within the folder that was named
