"""Every public function refuses what it cannot use in one line: what it expected, what came, what to do."""

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.numpy import load_file, save_file

import vig
from vig.inference import ExplainSettings
from vig.photo import Window, as_photo, read_photo, write_png
from vig.photo.checks import MAX_PIXELS
from vig.renderer import MeshObject, Pinhole, Scene, Topology
from vig.scene import Block, LatentLayout, latent_layout
from vig_world.raster.rasterize import rasterize

GREY = np.full((40, 30, 3), 0.5)
VERTICES = torch.tensor([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]])
FACES = np.array([[0, 1, 2]], np.int32)
CAMERA = vig.Camera.standard(20)
SCENE = Scene(
    [MeshObject(VERTICES, Topology.of(FACES, VERTICES.numpy()), torch.full((3,), 0.5))],
    Pinhole(20, 20, torch.full((2,), 22.0), torch.full((2,), 10.0), torch.eye(3), torch.tensor([0, 0, 0.4])),
)
LATENTS = vig.Latents(np.zeros((1, 10)), np.zeros(1), np.zeros(1), np.zeros((1, 3)), np.zeros((1, 9)))
RASTER: dict[str, Any] = {
    "vertices": VERTICES.numpy(),
    "faces": FACES,
    "rotation": np.eye(3),
    "translation": np.array([0, 0, 0.4]),
    "camera": CAMERA,
}


def refused(call: Callable[[], Any], error: type[Exception], why: str) -> None:
    """The call raises exactly `error`, with one line of three parts: `why` is "expected; got. do"."""
    with pytest.raises(error) as caught:
        call()
    message = str(caught.value.args[0])
    assert caught.type is error and re.search(why, message), message
    assert "\n" not in message and message.endswith((".", "?")), message


@pytest.fixture(scope="module")
def explanation(explainer: vig.Explainer) -> vig.Explanation:
    return explainer.explain(GREY)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files that are no photos: an empty one, a text, a cut one, a small one, an HDR one; a folder."""
    Image.fromarray(np.zeros((40, 40, 3), np.uint8)).save(tmp_path / "whole.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:60])
    (tmp_path / "text.png").write_text("a photo")
    (tmp_path / "empty.png").touch()
    (tmp_path / "hdr.png").write_bytes(b"#?RADIANCE\n")
    Image.fromarray(np.zeros((40, 8, 3), np.uint8)).save(tmp_path / "small.png")
    (tmp_path / "folder").mkdir()
    return tmp_path


FILES = [
    ("nothing.png", "expected an image file; got nothing of that name. Check"),
    ("folder", "expected an image file; got a folder. Name the files"),
    ("empty.png", "expected an image file; got an empty file. Save or copy"),
    ("text.png", r"expected a photo \(JPEG, .*; got something else. Convert it"),
    ("cut.png", "expected a whole photo; got a damaged one .* Save or copy"),
    ("small.png", "expected at least 16 pixels a side; got 8 x 40. Give a larger"),
    ("hdr.png", "expected a photo .*; got an HDR image. Save it as 8-bit"),
]
ARRAYS = [
    (torch.rand(1, 3, 200, 200), r"expected \(H, W, 3\) or \(H, W\); got shape \(1, 3, 200, 200\). .*last"),
    (torch.rand(3, 200, 200), r"expected \(H, W, 3\).*; got shape \(3, 200, 200\). .*channels last"),
    (torch.rand(200, 200, 4), r"expected \(H, W, 3\).*; got shape \(200, 200, 4\). Convert it to RGB"),
    (np.zeros(200), r"expected \(H, W, 3\).*; got shape \(200,\). Convert it"),
    (GREY * 255, r"expected linear RGB in \[0, 1\]; got values from 127.5 to 127.5. .*Pass them as uint8"),
    (GREY - 1, r"expected linear RGB in \[0, 1\]; got values from -0.5 to -0.5. Clip"),
    (GREY * np.nan, r"expected linear RGB in \[0, 1\]; got values from nan to nan. Clip or clean"),
    (GREY.astype(np.int64), "expected uint8 sRGB or floating-point linear RGB; got int64. Convert it"),
    (torch.ones(40, 40, 3, dtype=torch.int64), "expected uint8 sRGB or .*; got int64. Convert it"),
    (GREY > 0, "expected uint8 sRGB or .*; got bool. Convert it"),
    (GREY.astype(str), "expected uint8 sRGB or .*; got <U.*. Convert it"),
    (GREY * 1j, "expected uint8 sRGB or .*; got complex128. Convert it"),
    (GREY[:8], "expected at least 16 pixels a side; got 30 x 8. Give a larger"),
    (np.broadcast_to(np.float32(0), (16, MAX_PIXELS, 3)), "expected at most 250 megapixels; got .* Make it"),
    (Image.new("RGB", (8, 40)), "expected at least 16 pixels a side; got 8 x 40. Give a larger"),
    (None, "expected a path, a PIL image or an array; got a NoneType. Convert it"),
    ([[0.5]], "expected a path, a PIL image or an array; got a list. Convert it"),
]


@pytest.mark.parametrize(("name", "why"), FILES)
def test_files_that_are_no_photos(explainer: vig.Explainer, folder: Path, name: str, why: str) -> None:
    for call in (explainer.explain, as_photo, read_photo, lambda path: as_photo(str(path))):
        refused(lambda call=call: call(folder / name), vig.UserError, why)
    refused(lambda: explainer.explain(folder / name), vig.UserError, re.escape(str(folder / name)))


@pytest.mark.parametrize(("photo", "why"), ARRAYS)
def test_arrays_that_are_no_photos(explainer: vig.Explainer, photo: Any, why: str) -> None:
    for call in (explainer.explain, as_photo, lambda array: next(explainer.explain_many([array]))):
        refused(lambda call=call: call(photo), vig.UserError, why)


@pytest.mark.parametrize("focal", [0, -3.0, math.inf, math.nan, "long"])
def test_focal_lengths(explainer: vig.Explainer, focal: Any) -> None:
    with pytest.raises(vig.UserError, match="expected a focal length in pixels, above 0; got .*. Leave"):
        explainer.explain(np.zeros((30, 40, 3), np.uint8), focal=focal)


@pytest.mark.parametrize(
    ("box", "why"),
    [
        ((1, 2, 3), r"expected a box of four numbers .*; got \(1, 2, 3\). Pass"),
        ("here", "expected a box of four numbers .*; got here. Pass"),
        (7, "expected a box of four numbers .*; got 7. Pass"),
        ((0, 0, np.nan, 20), "expected a box of four numbers .*; got .*nan.*. Pass"),
        ((0, 0, 131, 140), "expected a box .* in the photo of 30 x 40; got 0,0,131,140. w and h"),
        ((-15, 0, 20, 20), "expected a box .* in the photo .*; got -15,0,20,20. w and h"),
        ((0, 0, 7, 20), "expected a box x,y,w,h of at least 8 pixels a side.*; got 0,0,7,20. w and h"),
        ((0, 0, -20, -20), "expected a box .* of at least 8 pixels a side.*; got .*. w and h"),
    ],
)
def test_boxes(explainer: vig.Explainer, box: Any, why: str) -> None:
    refused(lambda: explainer.explain(GREY, box), vig.UserError, why)
    refused(lambda: next(explainer.explain_many([GREY], [box])), vig.UserError, why)


@pytest.mark.parametrize(
    ("box", "window"), [(None, "all"), (None, (0, 0, 9)), ((0, 0, 20, 20), Window(0, 0, 50))]
)
def test_windows_that_cannot_be_used_are_refused(box: Any, window: Any, explainer: vig.Explainer) -> None:
    refused(
        lambda: explainer.explain(GREY, box, window),
        vig.UserError,
        r"expected a box or a vig.photo.Window; got .* Give one",
    )


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"photos": "photo.jpg"}, "expected several photos; got a str. Put it in a list"),
        ({"photos": None}, "expected several photos; got a NoneType. Put it in"),
        ({"photos": GREY}, "expected several photos; got a ndarray. Put it in"),
        ({"photos": torch.from_numpy(GREY)}, "expected several photos; got a Tensor. Put it in"),
        ({"photos": [GREY, GREY], "boxes": [None]}, "expected a box .*for each photo; got 1 .*for more"),
        ({"photos": [GREY], "boxes": [None, None]}, "expected a box .*for each photo; got more .*for 1"),
        ({"photos": [GREY], "workers": 0}, "expected 1 or more workers; got 0. Give"),
        ({"photos": [GREY], "workers": 1.5}, "expected 1 or more workers; got 1.5. Give"),
        ({"photos": [GREY], "workers": "two"}, "expected 1 or more workers; got two. Give"),
    ],
)
def test_many_photos(explainer: vig.Explainer, arguments: dict[str, Any], why: str) -> None:
    quick = vig.Explainer.__new__(vig.Explainer)
    quick.__dict__.update(vars(explainer))
    quick.explain = lambda *_, focal: None  # type: ignore[method-assign, assignment, return-value]
    refused(lambda: list(quick.explain_many(**arguments)), vig.UserError, why)


def test_classes_from_memory_do_not_go_to_processes(explainer: vig.Explainer) -> None:
    made = vig.Explainer.__new__(vig.Explainer)
    made.__dict__.update(vars(explainer) | {"object_class": replace(explainer.object_class, folder=None)})
    why = "expected a class from a pack, for worker processes; got one from memory. Save it"
    refused(lambda: next(made.explain_many([GREY], workers=2)), vig.UserError, why)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (
            ("teapt",),
            "expected a class, one of car, mug, teapot, or a folder with class.json; got 'teapt'. Check",
        ),
        (("",), "expected a class, one of car, mug, teapot, .*; got ''. Check"),
        (("/dev/null",), "expected a class, .*; got '/dev/null'. Check"),
        ((7,), "expected a class's name or folder; got a int. Pass"),
        (("teapot", "quick"), "expected ExplainSettings; got a str. Pass"),
    ],
)
def test_explainers(arguments: tuple, why: str) -> None:
    refused(lambda: vig.Explainer(*arguments), vig.UserError, why)
    if len(arguments) == 1:
        refused(lambda: vig.ObjectClass.load(*arguments), vig.UserError, why)


def spoil_json(**changed: Any) -> Callable[[Path], None]:
    def spoil(pack: Path) -> None:
        held = json.loads((pack / "class.json").read_text())
        (pack / "class.json").write_text(json.dumps(held | changed))

    return spoil


def spoil_faces(pack: Path) -> None:
    arrays = load_file(pack / "shape.safetensors")
    save_file(arrays | {"faces": arrays["faces"] + 10**6}, pack / "shape.safetensors")


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (
            spoil_json(format=99),
            r"expected the description of a class at '.*'; got .*format 99.* Build or copy",
        ),
        (
            spoil_json(name=7),
            "expected the description of a class at '.*'; got .*Expected `str`.*name.* Build",
        ),
        (spoil_faces, "expected a class's shapes at '.*'; got .*faces must be from 0.* Build or copy"),
        (
            lambda pack: (pack / "shape.safetensors").unlink(),
            "expected a class's shapes at '.*'; got nothing of that name. Build or copy",
        ),
        (
            lambda pack: (pack / "recognition.safetensors").unlink(),
            "expected recognition weights at '.*'; got nothing of that name. Train them",
        ),
        (
            lambda pack: (pack / "recognition.safetensors").write_bytes(b"no weights"),
            "expected recognition weights at '.*'; got a damaged file .* Train them",
        ),
    ],
)
def test_foreign_packs(
    explainer: vig.Explainer, tmp_path: Path, spoil: Callable[[Path], None], why: str
) -> None:
    assert explainer.object_class.folder is not None
    pack = shutil.copytree(explainer.object_class.folder, tmp_path / "pack")
    spoil(pack)
    refused(lambda: vig.Explainer(pack), vig.UserError, why)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"light": np.zeros(4)}, r"light must be 9 finite numbers; got shape \(4,\).* Pass"),
        ({"light": np.full(9, np.inf)}, r"light must be 9 finite numbers; got shape \(9,\), .*inf.* Pass"),
        ({"light": "bright"}, "light must be 9 finite numbers; got bright. Pass"),
        ({"albedo": (0.1, 0.2)}, r"albedo must be 3 finite numbers; got shape \(2,\).* Pass"),
        ({"albedo": (10, 20, 214)}, r"albedo must be linear RGB in \[0, 1\]; got 10 to 214. .*Divide by 255"),
        ({"albedo": (-0.1, 0, 0)}, r"albedo must be linear RGB in \[0, 1\]; got -0.1 to 0. Clip"),
        ({"azimuth_deg": np.nan}, "azimuth_deg must be 1 finite number; got .*nan.* Pass"),
        ({"elevation_deg": "up"}, r"elevation_deg must be 1 finite number; got \['up'\]. Pass"),
        ({"camera": np.eye(3)}, "camera must be a vig.Camera; got a ndarray. Pass"),
    ],
)
def test_drawing_an_explanation(explanation: vig.Explanation, changed: dict[str, Any], why: str) -> None:
    refused(lambda: explanation.render(**changed), vig.UserError, why)


def test_saving_an_explanation(explanation: vig.Explanation, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    why = f"cannot write {tmp_path}/file/.*: a part of the path is a file, not a folder; choose another"
    refused(lambda: explanation.save(tmp_path / "file"), vig.UserError, why)
    why = "expected a folder's path; got a NoneType. Pass"
    refused(lambda: explanation.save(None), vig.UserError, why)  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def item(**changed: Any) -> Scene:
    return replace(SCENE, objects=[replace(SCENE.objects[0], **changed)])


def seen(**changed: Any) -> Scene:
    return replace(SCENE, camera=replace(SCENE.camera, **changed))


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (([],), "expected a scene or several; got none. Pass"),
        ((7,), "expected a scene or several; got a int. Pass"),
        (([SCENE, "scene"],), "expected a scene or several; got a str among them. Pass"),
        ((SCENE, "toon"), "shading must be 'vertex' or 'pixel'; got 'toon'. Choose"),
        ((SCENE, "vertex", 0), "samples must be a whole number from 1 to 4096; got 0. Take"),
        ((SCENE, "vertex", 1.5), "samples must be a whole number from 1 to 4096; got 1.5. Take"),
        (
            (item(vertices=VERTICES[:2]),),
            r"vertices of object 0 of scene 0 must be \(3, 3\); got \(2, 3\). .+",
        ),
        ((item(albedo=torch.zeros(4)),), r"albedo of .* must be \(3,\) or \(3, 3\); got \(4,\). .+"),
        ((item(light=torch.zeros(4)),), r"light of .* must be \(9,\) or \(9, 3\); got \(4,\). .+"),
        ((item(albedo=[0.5] * 3),), r"albedo of .* must be a tensor; got a list. .+"),
        (
            (item(vertices=VERTICES.double()),),
            "must be torch.float32 on cpu, .*; got torch.float64 .*. Convert",
        ),
        (
            (item(vertices=VERTICES * torch.nan),),
            "vertices of .* must be finite; 9 of 9 numbers are not. Clean",
        ),
        ((seen(focal=torch.ones(3)),), r"focal of scene 0 must be \(2,\); got \(3,\). .+"),
        ((seen(focal=torch.zeros(2)),), "focal .* must be positive pixels; got .* Give two"),
        ((seen(focal=torch.full((2,), -22.0)),), "focal .* must be positive pixels; got .* Give two"),
        ((seen(width=0),), "an image must have at least one pixel; got 0 x 20. Give"),
        (
            (seen(translation=torch.zeros(3).half()),),
            "must be float32 or float64; got torch.float16. Convert",
        ),
        (([SCENE, seen(width=30)],), "must be of one size, 20 x 20; got 30 x 20 .* Render .* apart"),
        ((replace(SCENE, background=torch.zeros(4)),), r"background of .* must be .*; got \(4,\). .+"),
    ],
)
def test_rendering(arguments: tuple, why: str) -> None:
    refused(lambda: vig.render(*arguments), ValueError, why)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"width": 0}, "must have 1 to 16384 whole pixels a side; got 0 x 20. Give"),
        ({"height": 10.5}, "must have 1 to 16384 whole pixels a side; got 20 x 10.5. Give"),
        ({"width": "wide"}, "must have 1 to 16384 whole pixels a side; got wide x 20. Give"),
        ({"focal": -1.0}, r"focal .* and distance .* must be positive and finite; got -1.0 and 0.4. Give"),
        ({"distance": np.inf}, r"must be positive and finite; got .* and inf. Give"),
        ({"cx": np.nan}, r"cx, cy .* must be finite numbers; got nan, .* Give"),
        ({"focal": None}, "must be positive and finite; got None and 0.4. Give"),
    ],
)
def test_cameras(changed: dict[str, Any], why: str) -> None:
    refused(lambda: replace(CAMERA, **changed), ValueError, why)


@pytest.mark.parametrize(
    ("changed", "got"),
    [
        ({"shape": np.zeros(10)}, r"shape \(10,\)"),
        ({"azimuth": np.zeros(2)}, r"azimuth \(2,\)"),
        ({"albedo": np.zeros((1, 4))}, r"albedo \(1, 4\)"),
        ({"light": np.zeros((1, 9, 3))}, r"light \(1, 9, 3\)"),
        ({"elevation": [0.0]}, "elevation a list"),
        ({"azimuth": 0.5}, "azimuth a float"),
    ],
)
def test_latents(changed: dict[str, Any], got: str) -> None:
    why = rf"latents must be arrays shape \(B, K\), azimuth \(B,\), .*; got .*{got}.* Give"
    refused(lambda: replace(LATENTS, **changed), ValueError, why)


def test_latents_of_arrays_and_tensors() -> None:
    why = "latents must be all arrays or all tensors; got shape ndarray, .*albedo Tensor.* Convert"
    refused(lambda: replace(LATENTS, albedo=torch.zeros(1, 3)), ValueError, why)


@pytest.mark.parametrize("vector", [np.zeros(24), np.zeros((2, 13)), torch.zeros(2, 13)])
def test_latents_from_vectors(vector: np.ndarray | torch.Tensor) -> None:
    why = rf"latents must be \(B, K \+ 14\); got {re.escape(str(tuple(vector.shape)))}. Give"
    refused(lambda: vig.Latents.from_vector(vector), ValueError, why)


LAYOUT = latent_layout(10)


@pytest.mark.parametrize(
    ("call", "error", "why"),
    [
        (lambda: LAYOUT["roll"], KeyError, "expected one of the blocks shape, .*; got 'roll'. Add it"),
        (lambda: LAYOUT.without("roll"), KeyError, "expected one of the blocks .*; got 'roll'. Add it"),
        (
            lambda: LAYOUT.split(torch.zeros(2, 23)),
            ValueError,
            r"must be \(..., 24\) for .*; got \(2, 23\). Take",
        ),
        (lambda: LAYOUT.join({"light": torch.zeros(9)}), ValueError, r"expected blocks .*; got \{.*\}. Name"),
        (lambda: LatentLayout((Block("a", 1),) * 2), ValueError, "different names; got a, a. Rename"),
        (lambda: Block("a", -1), ValueError, "'a' must have 0 or more numbers; got -1. Give"),
        (
            lambda: Block("a", 2, 0.0, (1.0, 2.0, 3.0)),
            ValueError,
            "upper of block 'a' must be 2; got 3. Give",
        ),
        (lambda: Block("a", 2, labels=("x",)), ValueError, "labels of block 'a' must be 2; got 1. Give"),
    ],
)
def test_layouts(call: Callable[[], Any], error: type[Exception], why: str) -> None:
    refused(call, error, why)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"rotation": np.eye(4)}, r"rotation must be \(3, 3\) numbers; got \(4, 4\) float64. Pass"),
        ({"translation": np.zeros((3, 1))}, r"translation must be \(3\) numbers; got \(3, 1\) float64. Pass"),
        ({"translation": "far"}, r"translation must be \(3\) numbers; got \(\) <U3. Pass"),
        ({"camera": np.eye(3)}, "camera must be a Camera; got a ndarray. Pass"),
    ],
)
def test_rasterizing(changed: dict[str, Any], why: str) -> None:
    refused(lambda: rasterize(**RASTER | changed), ValueError, why)


@pytest.mark.parametrize(
    ("array", "why"),
    [
        (
            np.zeros((4, 4, 2)),
            r"a picture must be \(H, W\), \(H, W, 3\) or \(H, W, 4\); got \(4, 4, 2\). Pass",
        ),
        (np.zeros((0, 4)), r"a picture must be \(H, W\), .*; got \(0, 4\). Pass"),
        (np.zeros((4, 4, 4)), "linear light must have 1 or 3 channels; got 4. Is the last one alpha"),
        (np.full((4, 4), np.nan), "linear light must be finite; got NaN or infinity. Clean"),
        (np.zeros((4, 4), np.int64), "a picture must be uint8, bool or floating; got int64. Convert"),
    ],
)
def test_writing_pictures(array: np.ndarray, why: str, tmp_path: Path) -> None:
    refused(lambda: write_png(tmp_path / "p.png", array), ValueError, why)
    (tmp_path / "file").touch()
    why = "cannot write .*: a part of the path is a file, not a folder; choose another"
    refused(lambda: write_png(tmp_path / "file" / "p.png", np.zeros((4, 4))), vig.UserError, why)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"likelihood": "robust"}, r"likelihood must be a PixelModel; got 'robust'\. See"),
        ({"optimizer": "lm"}, r"optimizer must be an Optimizer; got 'lm'\. See"),
        ({"stages": 3}, "must be a tuple of .*; got 3.* Pass"),
        ({"view_weight": float("nan")}, r"view_weight must be from 0 to inf; got nan\. Choose"),
        ({"prior_weight": -100.0}, r"prior_weight must be from 0 to inf; got -100\.0\. Choose"),
        ({"surroundings": 7.0}, r"surroundings must be from 0 to 1; got 7\.0\. Choose"),
        ({"silhouette": "foo"}, r"silhouette must be 'exact' or 'paper'; got 'foo'\. Choose"),
    ],
)
def test_settings_of_a_fit(changed: dict[str, Any], why: str) -> None:
    refused(lambda: ExplainSettings(**changed), ValueError, why)


def test_photos_are_copies_and_any_floating_type_is_taken() -> None:
    given = GREY.astype(np.float32)
    assert not np.shares_memory(as_photo(given), given)
    assert not np.shares_memory(as_photo(torch.from_numpy(given)), given)
    np.testing.assert_allclose(as_photo(torch.from_numpy(given).bfloat16()), given, atol=1 / 256)
