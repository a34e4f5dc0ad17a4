"""Furniture catalogues: sizes, axes, picks and attribution; what is wrong is named and left out."""

import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig_train.building.reading import read_scans
from vig_world.assets.own.catalogue import mesh_folder, read_sources, unpack
from vig_world.assets.own.catalogue.choice import split_words
from vig_world.assets.own.catalogue.reading import PROPERTIES, parse_properties
from vig_world.assets.own.catalogue.zones import zones_of
from vig_world.assets.own.furniture import read_furniture
from vig_world.assets.own.furniture_families import family_of_thing
from vig_world.assets.own.props import read_props
from vig_world.assets.things import ZONE_NAMES

Z_UP = "1 0 0 0 0 1 0 -1 0"
"""The modelRotation of a file whose Z points up: its +Z becomes the catalogue's +Y, its -Y the front +Z."""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def box(size: tuple[float, float, float], peak: int = 1, material: str = "") -> str:
    """An OBJ box in units of its own off the origin; its faces reach to a point beyond the +`peak` side."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * size + 7.0
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    stray = "v 900 900 900\n"  # belongs to no face, so that it counts for nothing
    quads = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    tip = corners.mean(0)
    tip[peak] = corners[:, peak].max() + 0.25 * size[peak]
    marked = f"v {tip[0]} {tip[1]} {tip[2]}\nf 10/1 1/2 2/3\n"
    uv = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    faces = "".join(
        "f " + " ".join(f"{v}/{n}" for n, v in enumerate(quad.split(), 1)) + "\n" for quad in quads
    )
    return material + vertices + stray + uv + faces + marked


def picture(side: int = 8) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (side, side), (200, 20, 20)).save(file, "png")
    return file.getvalue()


CAR = {
    "name": "Red car", "tags": "Toy, Vehicle", "category": "Vehicles", "model": "/a/car/car.obj",
    "width": "20", "height": "10", "depth": "40", "creator": "Ada", "license": "CC-BY 3.0", "id": "a#car",
}  # fmt: skip
CUP = {
    "name": "Caf\\u00e9 cup", "tags": "Drink", "category": "Kitchen", "model": "/a/cup.obj",
    "width": "8", "height": "9", "depth": "6", "modelRotation": Z_UP,
}  # fmt: skip
FILES: dict[str, bytes] = {
    "a/car/car.obj": box((2, 1, 4), 2, "mtllib car.mtl\nusemtl paint\n").encode(),
    "a/car/car.mtl": b"newmtl paint\nKd 1 1 1\nmap_Kd ../pictures/red.PNG\n",
    "a/pictures/red.png": picture(),
    "a/cup.obj": box((1, 1, 3), 2).encode(),
}


def catalogue(
    path: Path, models: list[dict[str, str]] | None = None, files: dict[str, bytes] | None = None
) -> Path:
    """A catalogue of a car (Y up, front +Z, a peak there, textured) and a cup (Z up, a peak above)."""
    lines = ["# of a test", "id=t", "name=Tiny", "license=Public domain", "provider=us"]
    for number, model in enumerate([CAR, CUP] if models is None else models, 1):
        lines += [f"{key}#{number}={value}" for key, value in model.items()]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(PROPERTIES, "\n".join(lines).encode("latin-1"))
        archive.writestr("PluginFurnitureCatalog_fr.properties", b"name#1=Voiture\n")
        for name, data in (FILES | (files or {})).items():
            archive.writestr(name, data)
    return path


def points(parts) -> np.ndarray:
    return np.concatenate([mesh.vertices for mesh, _ in parts]).astype(float)


def peak_side(vertices: np.ndarray) -> int:
    """The axis along which the point beyond a box's side lies, signed and counted from 1: -2 for -Y."""
    counts = {}
    for axis, along in enumerate(np.unique(vertices.round(6), axis=0).T, 1):
        counts |= {axis: (along == along.max()).sum(), -axis: (along == along.min()).sum()}
    (side,) = [side for side, count in counts.items() if count == 1]
    return side


def test_props_have_the_catalogues_size_front_and_picture(tmp_path: Path) -> None:
    props, problems = read_props(catalogue(tmp_path / "tiny.sh3f"))
    assert problems == []
    cup, car = props
    assert (car.name, car.family, car.zones) == ("red-car/red-car.obj", "red_car", ("floor",))
    assert (cup.name, cup.family, cup.zones) == ("cafe-cup/cafe-cup.obj", "cafe_cup", ("dining", "drinks"))
    vertices = points(car.read())  # width along X, depth along Y, height along Z
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.2, 0.4, 0.1], atol=1e-6)
    np.testing.assert_allclose(vertices.min(0), [-0.1, -0.2, 0], atol=1e-6)
    assert peak_side(vertices) == -2, "the front is -Y"
    texture = car.read()[0][1].texture
    assert texture[..., 0].min() > 10 * texture[..., 1].max()
    vertices = points(cup.read())
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.08, 0.06, 0.09], atol=1e-6)
    assert peak_side(vertices) == 3, "its modelRotation puts it upright"


def test_scans_have_the_same_size_and_names(tmp_path: Path) -> None:
    path = catalogue(tmp_path / "tiny.sh3f")
    scans, refused = read_scans(path)
    assert refused == {} and [scan.name for scan in scans] == ["cafe-cup/cafe-cup.obj", "red-car/red-car.obj"]
    np.testing.assert_allclose(np.ptp(scans[1].vertices, axis=0), [0.2, 0.4, 0.1], atol=1e-6)
    assert peak_side(scans[1].vertices) == -2


def test_a_model_that_is_turned_a_quarter_has_its_width_along_what_was_its_depth(tmp_path: Path) -> None:
    turned = CAR | {"modelRotation": "0 0 -1 0 1 0 1 0 0", "width": "40", "depth": "20"}
    ((car,), _) = read_props(catalogue(tmp_path / "tiny.sh3f", [turned]))
    vertices = points(car.read())
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.4, 0.2, 0.1], atol=1e-6)
    assert peak_side(vertices) == -1  # that rotation takes the file's +Z to -X


def test_words_pick_by_name_tag_and_category(tmp_path: Path) -> None:
    folder = tmp_path / "all"
    folder.mkdir()
    path = catalogue(folder / "tiny.sh3f")

    def picked(words: str, source: Path = path) -> list[str]:
        return [source.name for source in read_sources(mesh_folder(f"{source}:{words}")).models]

    assert picked("CARS") == picked("toy") == picked("vehicle") == ["Red car"]
    assert picked("red car") == ["Red car"]
    assert picked("kitchen") == picked("café") == ["Café cup"]
    assert picked("cup,vehicles") == ["Café cup", "Red car"]
    catalogue(folder / "b.SH3F", [CAR | {"name": "Car"}])
    assert picked("car", folder) == ["Car", "Red car"]
    assert len(read_sources(mesh_folder(folder)).models) == 3
    with pytest.raises(UserError, match=r"'ca' picks none.*Vehicles \(1\), Kitchen \(1\)") as caught:
        mesh_folder(f"{path}:car,ca")
    assert "Near to it: car" in str(caught.value)


def test_things_of_one_name_are_numbered(tmp_path: Path) -> None:
    models = [CAR, CAR | {"name": "Red Car"}, CAR | {"name": "red-car-1"}, CAR | {"name": "\\u8eca"}]
    folder = mesh_folder(catalogue(tmp_path / "tiny.sh3f", models))
    names = sorted(path.parent.name for path in folder.rglob("*.obj"))
    assert names == ["model", "red-car-1", "red-car-2", "red-car-3"]


@pytest.mark.parametrize(
    "source, parts",
    [
        ("a.sh3f", ("a.sh3f", None)),
        ("a.sh3f:car,truck", ("a.sh3f", "car,truck")),
        (r"C:\x.sh3f", (r"C:\x.sh3f", None)),
        (r"C:\x.sh3f:car", (r"C:\x.sh3f", "car")),
        ("C:/x.sh3f:car", ("C:/x.sh3f", "car")),
        ("C:x.sh3f", ("C:x.sh3f", None)),
        ("/a:b/c", ("/a:b/c", None)),
        (":car", (":car", None)),
    ],
)
def test_the_colon_of_a_drive_separates_nothing(source: str, parts: tuple[str, str | None]) -> None:
    assert split_words(source) == parts


def test_folders_of_meshes_stay_what_they_are(tmp_path: Path) -> None:
    for name in ("meshes", "with:colon.sh3f", "both"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.obj").write_text(box((0.1, 0.1, 0.1)))
        assert mesh_folder(tmp_path / name) == tmp_path / name
    catalogue(tmp_path / "both" / "c.sh3f")
    assert mesh_folder(tmp_path / "both") == tmp_path / "both"
    assert mesh_folder(tmp_path / "missing") == tmp_path / "missing"
    (tmp_path / "meshes" / "sources.json").write_text('{"of": "another program"}')
    assert read_sources(tmp_path / "meshes").models == ()
    with pytest.raises(UserError, match=r"expected catalogues \(.sh3f\) in '.*meshes', from which ':car'"):
        mesh_folder(f"{tmp_path / 'meshes'}:car")


def test_a_second_use_unpacks_nothing_and_a_changed_catalogue_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = catalogue(tmp_path / "tiny.sh3f")
    folder = mesh_folder(path)
    whole, unpacked = unpack._unpack, []
    monkeypatch.setattr(
        unpack, "_unpack", lambda choice, to: (unpacked.append(choice.words), whole(choice, to))
    )
    assert mesh_folder(path) == folder and unpacked == []
    assert mesh_folder(f"{path}:car") != folder
    catalogue(path, [CUP])
    assert mesh_folder(path) != folder and unpacked == [("car",), ()]
    (folder / "sources.json").unlink()  # as somebody who tidies up leaves it
    catalogue(path)
    assert mesh_folder(path) == folder and (folder / "sources.json").is_file()


def test_a_kill_leaves_nothing_that_is_taken_for_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    def interrupted(self, model, folder: Path) -> None:
        folder.mkdir()
        raise KeyboardInterrupt

    path = catalogue(tmp_path / "tiny.sh3f")
    abandoned = cache / "vig" / "catalogues" / ".0123456789ab"
    abandoned.mkdir(parents=True)
    os.utime(abandoned, (0, 0))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(unpack._Unpacker, "unpack", interrupted)
        mesh_folder(path)
    assert list((cache / "vig" / "catalogues").iterdir()) == []
    assert len(read_props(path)[0]) == 2


def test_names_authors_and_licences_are_kept(tmp_path: Path) -> None:
    path = catalogue(tmp_path / "tiny.sh3f")
    sources = json.loads((mesh_folder(path) / "sources.json").read_text())
    assert sources["models"][1] == {
        "file": "red-car/red-car.obj", "name": "Red car", "creator": "Ada", "licence": "CC-BY 3.0",
        "catalogue": "tiny.sh3f",
    }  # fmt: skip
    assert sources["models"][0]["licence"] == "Public domain", "the catalogue's, where a model states none"


def test_what_hangs_on_a_wall_is_no_prop_but_a_mesh(tmp_path: Path) -> None:
    models = [CAR, CUP | {"elevation": "150"}, CUP | {"doorOrWindow": "true", "name": "Pane"}]
    path = catalogue(tmp_path / "tiny.sh3f", models)
    assert [prop.family for prop in read_props(path)[0]] == ["red_car"]
    assert len(list(mesh_folder(path).rglob("*.obj"))) == 3
    with pytest.raises(UserError, match="not one usable prop. 1 with skip = true"):
        read_props(f"{path}:pane")


def test_furniture_has_its_family_and_size(tmp_path: Path) -> None:
    table = CAR | {"name": "Oak coffee table", "category": "Living room", "width": "120", "height": "45"}
    table |= {"depth": "60", "model": "a/table.obj"}
    flat = box((2, 1, 4)).rsplit("v ", 1)[0].encode()  # without the peak
    path = catalogue(tmp_path / "tiny.sh3f", [table], {"a/table.obj": flat})
    ((own,), _) = read_furniture(path)
    assert own.family == "coffee_table"
    (support,) = own.read().supports
    assert support.zone == "reading" and support.centre[2] == pytest.approx(0.45, abs=1e-5)
    assert 2 * support.half[0] == pytest.approx(1.2, abs=0.1)
    assert 2 * support.half[1] == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize(
    "change, files, reason",
    [
        ({"model": "/a/none.obj"}, {}, "expected its file a/none.obj in the catalogue; it is missing"),
        ({"model": "/a/car.dae"}, {"a/car.dae": b"x"}, "expected a model in an OBJ file; got '/a/car.dae'"),
        ({"model": ""}, {}, "expected a path within the catalogue; got ''"),
        ({"model": "../car.obj"}, {"../car.obj": FILES["a/cup.obj"]}, "a path within the catalogue"),
        ({"model": "//etc/car.obj"}, {"/etc/car.obj": FILES["a/cup.obj"]}, "a path within the catalogue"),
        ({"model": "a/../../car.obj"}, {"a/../../car.obj": FILES["a/cup.obj"]}, "within the catalogue"),
        ({"model": "C:/car.obj"}, {"C:/car.obj": FILES["a/cup.obj"]}, "a path within the catalogue"),
        ({"model": "http://x.org/car.obj"}, {}, "a path within the catalogue"),
        ({"width": "0"}, {}, "expected a width, height and depth of up to 10000 cm; got 0, 10, 40"),
        ({"depth": "deep"}, {}, "got 20, 10, deep"),
        ({"height": "nan"}, {}, "got 20, nan, 40"),
        ({"modelRotation": "1 0 0 0 1 0"}, {}, "nine numbers of a rotation"),
        ({"modelRotation": "-1 0 0 0 1 0 0 0 1"}, {}, "nine numbers of a rotation"),  # a mirror
        ({"modelRotation": "2 0 0 0 2 0 0 0 2"}, {}, "nine numbers of a rotation"),
        ({}, {"a/car/car.obj": b""}, "expected a mesh; got an empty file"),
        ({}, {"a/car/car.obj": b"v 0 0 0\n"}, "it has no faces"),
        ({}, {"a/car/car.obj": b"v 0 0 0\nv 1 0 0\nf 1 2 3\n"}, "expected a readable OBJ file"),
        ({}, {"a/car/car.obj": b"v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"}, "expected a readable OBJ file"),
        ({}, {"a/car/car.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"}, "not all finite"),
        ({}, {"a/car/car.obj": b"v 0 0 0\nf 1 2 99999999999999999999 4\n"}, "expected a readable OBJ file"),
    ],
)
def test_a_model_that_cannot_be_used_is_named_and_left_out(
    tmp_path: Path, change: dict[str, str], files: dict[str, bytes], reason: str
) -> None:
    path = catalogue(tmp_path / "tiny.sh3f", [CAR | change, CUP], files)
    for read, notes in ((read_props, list), (read_scans, dict.items)):
        for _ in range(2):  # the second time, too
            got, problems = read(path)
            (note,) = map(str, notes(problems))
            assert len(got) == 1 and "Red car of tiny.sh3f" in note and reason in note and "\n" not in note
    assert {each.name for each in tmp_path.iterdir()} == {"cache", path.name}, "nothing else is written"
    assert [each.name for each in (tmp_path / "cache").rglob("*.obj")] == ["cafe-cup.obj"]
    with pytest.raises(UserError, match="expected usable models; got none of 1. Red car"):
        mesh_folder(f"{path}:toy")


def test_files_that_unpack_to_too_much_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpack, "MAX_ENTRY", 10_000)
    path = catalogue(tmp_path / "tiny.sh3f", files={"a/car/car.obj": b"#" * 10_001})
    assert "unpacks to 10,001 bytes where at most 10,000 are read" in read_props(path)[1][0]
    monkeypatch.setattr(unpack, "MAX_UNPACKED", 100)
    with pytest.raises(UserError, match="got none of 2.*at most 100 are read"):
        mesh_folder(catalogue(tmp_path / "other.sh3f", [CAR, CUP | {"creator": "Bob"}]))


def test_a_size_that_the_zip_states_wrongly_is_no_way_round_the_limit(tmp_path: Path) -> None:
    path = catalogue(tmp_path / "tiny.sh3f", files={"a/car/car.obj": FILES["a/car/car.obj"] + b"#" * 5000})
    real = len(FILES["a/car/car.obj"]) + 5000
    data = path.read_bytes()
    path.write_bytes(data.replace(real.to_bytes(4, "little"), (100).to_bytes(4, "little")))
    assert "expected a readable a/car/car.obj; got a damaged one" in read_props(path)[1][0]


def test_a_picture_of_too_many_pixels_is_grey_and_named(tmp_path: Path) -> None:
    header = picture()
    bomb = header[:16] + (60_000).to_bytes(4, "big") * 2 + header[24:]
    props, problems = read_props(catalogue(tmp_path / "tiny.sh3f", files={"a/pictures/red.png": bomb}))
    assert len(props) == 2 and len(problems) == 1
    assert "red.PNG is missing or unreadable; grey instead" in problems[0]


def test_only_materials_and_pictures_are_unpacked_beside_a_model(tmp_path: Path) -> None:
    material = b"newmtl paint\nmap_Kd ../cup.obj\nmap_Kd /../../../red.png\nmap_Kd ../../../../x.png\n"
    material += b"map_Kd -s 1 1 1 textures/red.png\nmap_Kd red-car.obj\n"
    files = {"a/car/car.mtl": material, "a/car/textures/red.png": picture(), "x.png": picture()}
    folder = mesh_folder(catalogue(tmp_path / "tiny.sh3f", [CAR], files))
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "vig.toml", "sources.json", "red-car/red-car.obj", "red-car/vig.toml", "red-car/car.mtl",
        "red-car/textures/red.png",
    }  # fmt: skip


def test_what_is_no_catalogue_gets_one_line(tmp_path: Path) -> None:
    text, empty, listless = (tmp_path / f"{name}.sh3f" for name in ("text", "empty", "listless"))
    text.write_text("no zip")
    catalogue(empty, [])
    with zipfile.ZipFile(listless, "w") as archive:
        archive.writestr("readme.txt", "hello")
    cut = catalogue(tmp_path / "cut.sh3f")
    cut.write_bytes(cut.read_bytes()[:-200])
    for source, reason in (
        (text, r"expected a furniture catalogue \(a zip\) at '.*text.sh3f'; got a damaged file"),
        (cut, r"expected a furniture catalogue \(a zip\) at '.*cut.sh3f'; got a damaged file"),
        (empty, "expected models in '.*empty.sh3f'; its list is empty"),
        (listless, f"without its list {PROPERTIES}"),
        (tmp_path / "none.sh3f", "expected a furniture catalogue at '.*none.sh3f'; got no such file"),
        (f"{tmp_path / 'none.sh3f'}:car", "got no such file"),
        (f"{cut}:", "expected words after the colon"),
        (f"{cut}:,", "expected words after the colon"),
        (f"{tmp_path / 'none'}:car", "expected a folder of files"),
    ):
        with pytest.raises(UserError, match=reason) as caught:
            read_props(source)
        assert "\n" not in str(caught.value)
    with pytest.raises(UserError, match="got no such file"):
        read_scans(tmp_path / "none.sh3f")


def test_a_cache_that_cannot_be_written_gets_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(UserError, match="cannot write .*a part of the path is a file"):
        mesh_folder(catalogue(tmp_path / "tiny.sh3f"))


def test_properties_are_read_as_java_does() -> None:
    data = b"# c\n! c\n a = b \nc\\:d:e\\=f\ng h\\\n   i\nj\\u00e9=\\u20ac\\t\\\\\n"
    data += b"k\n=v\nl=\xe9\n\\ud83d\\ude00=x\n"
    assert parse_properties(data) == {
        "a": "b ", "c:d": "e=f", "g": "hi", "jé": "€\t\\", "k": "", "": "v", "l": "é", "\U0001f600": "x",
    }  # fmt: skip


@pytest.mark.parametrize(
    "name, tags, category, zones",
    [
        ("Cat", "Animal", "Characters", {"floor"}),
        ("Wine bottle", "Food, Drink", "Kitchen", {"dining", "drinks"}),
        ("Bowl with fruits", "Food", "Kitchen", {"dining", "cooking"}),
        ("Roasted chicken", "Food", "Kitchen", {"dining", "cooking"}),
        ("Shampoo bottle", "", "Bathroom", {"washing"}),
        ("Laptop", "Electronics, Computer", "Office", {"desk"}),
        ("Lamp", "", "Lights", {"bedside", "desk", "reading"}),
        ("Truc", "", "Divers", set()),
    ],
)
def test_things_belong_where_one_expects_them(name: str, tags: str, category: str, zones: set[str]) -> None:
    assert set(zones_of(name, tuple(tags.split(", ")), category)) == zones <= set(ZONE_NAMES)


@pytest.mark.parametrize(
    "name, family",
    [("bedside_table", "nightstand"), ("kitchen_chair", "chair"), ("armchair", "armchair"), ("bed", "bed"),
     ("desk_lamp", None), ("table_fan", None), ("vertical_shelves", "shelf")],
)  # fmt: skip
def test_a_thing_is_what_the_end_of_its_name_says(name: str, family: str | None) -> None:
    assert family_of_thing(name) == family
