"""Textures from photos: painted objects, drawn, and baked again."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from vig import Explanation
from vig.inference import Fit, Verdict
from vig.inference.calibration import CONFIDENCE_FEATURES
from vig.photo.window import Window
from vig.renderer.drawing import draw_mesh, mesh_of, vertex_irradiance
from vig.scene import Latents, ObjectClass, ShapeModel
from vig_app.glb import Texture
from vig_app.glb import bake as bake_any
from vig_app.glb.atlas import GAP, SIDE, atlas_of
from vig_app.glb.bake import INVENTED, MIRRORED, SEEN
from vig_app.pictures import part_albedo
from vig_renderer.edges import smooth_normals

MAGENTA = np.array([1.0, 0.0, 1.0], np.float32)


def paint(points: np.ndarray, object_class: ObjectClass) -> np.ndarray:
    """Colours (N, 3) of points (N, 3), metres; not those of their mirror images."""
    x, y, z = points.T * (0.2 / np.ptp(object_class.shape_model.mean, axis=0).max())
    red, blue = 0.4 + 0.3 * np.sin(40 * x + 20 * y), 0.4 + 0.3 * np.sin(30 * z)
    return np.stack([red, 0.5 + 2 * y, blue], axis=1).astype(np.float32)


def painted(object_class: ObjectClass, hidden: slice | None = None) -> Explanation:
    """What is right for a drawing of a painted object; columns of the photo may be covered by magenta."""
    modes = object_class.shape_model.modes
    latents = Latents(
        np.zeros((1, modes), np.float32),
        np.array([0.4], np.float32),
        np.array([0.5], np.float32),
        np.array([[0.4, 0.5, 0.4]], np.float32),
        np.array([[2.6, 0.1, 0.5, -0.3, *[0.05] * 5]], np.float32),
    )
    vertices = object_class.shape_model.vertices(latents.shape)[0]
    faces, camera = object_class.shape_model.faces, object_class.camera(300)
    normals = smooth_normals(vertices, faces)
    colours = paint(vertices, object_class)
    colours = colours * vertex_irradiance(latents, normals, object_class)[:, None]
    rotation, translation = camera.pose(latents.azimuth, latents.elevation)
    eye = rotation[0], translation[0], (camera.focal,) * 2, (camera.cx, camera.cy)
    drawn = draw_mesh(mesh_of(faces, vertices), vertices, normals, colours, eye, 300, 300)
    photo = drawn.rgb
    coverage = drawn.coverage.reshape(150, 2, 150, 2).mean((1, 3))
    visible = coverage.copy()
    if hidden is not None:
        photo[:, hidden] = MAGENTA
        visible[:, hidden.start // 2 : hidden.stop // 2] = 0
    fit = Fit(
        latents=latents,
        framing=np.zeros(4, np.float32),
        deviation=np.ones(14 + modes, np.float32) / 100,
        framing_deviation=np.ones(4, np.float32) / 100,
        visible=visible,
        mask=visible > 0.5,
        mask_by_pixel=visible > 0.5,
        coverage=coverage,
        verdict=Verdict.TRUSTED,
        reason="",
        confidence=0.9,
        mask_confidence=0.9,
        mask_trusted=True,
        confidence_features=np.zeros(len(CONFIDENCE_FEATURES), np.float32),
        evidence=0.0,
        start_evidence=0.0,
        evaluations=1,
        alternatives=(),
        descent=np.concatenate([latents.to_vector(), np.zeros((1, 4), np.float32)], axis=1),
    )
    return Explanation(photo, Window.of(300, 300), fit, object_class)


def bake(explanation: Explanation) -> Texture:
    """The texture, which there is."""
    texture = bake_any(explanation)
    assert texture is not None
    return texture


def points_of(texture: Texture, explanation: Explanation) -> np.ndarray:
    """(T, 3) where on the object the texels lie."""
    points: np.ndarray = texture.atlas.at_texels(explanation.vertices)
    return points


@pytest.fixture(scope="module", params=["teapot", "mug", "car"])
def object_class(request: pytest.FixtureRequest) -> ObjectClass:
    return ObjectClass.load(request.param)


def test_texels_of_a_face_are_where_its_coordinates_say(object_class: ObjectClass) -> None:
    """And no face lies over another, or nearer to another chart than the gap: charts are seen one by one."""
    atlas, model = atlas_of(object_class), object_class.shape_model
    assert atlas is not None
    np.testing.assert_array_equal(atlas.source[atlas.faces], model.faces)
    shares = atlas.weights
    assert shares.min() > -1e-4 and np.abs(shares.sum(1) - 1).max() < 1e-5
    corners = SIDE * atlas.coordinates[atlas.faces]
    places = (corners[atlas.face] * shares[..., None]).sum(1)
    column, row = places.astype(int).T
    np.testing.assert_allclose(places, np.stack([column, row], axis=1) + 0.5, atol=2e-3)
    np.testing.assert_array_equal(atlas.texels[row * SIDE + column], np.arange(len(places)))
    assert corners.min() >= GAP - 1e-3 and corners.max() <= SIDE - GAP + 1e-3
    # A face as large as a few texels shows itself in its middle: nothing else is drawn over it.
    a, b, c = corners.transpose(1, 0, 2)
    area = np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))) / 2
    middle = corners.mean(1).astype(int)
    shown = atlas.face[atlas.texels[middle[:, 1] * SIDE + middle[:, 0]]]
    beside = np.abs(model.mean[model.faces].mean(1) - model.mean[model.faces[shown]].mean(1)).max(1)
    assert beside[area > 4].max() < 0.05 * np.ptp(model.mean, axis=0).max()


def in_pieces(count: int) -> ShapeModel:
    """So many triangles, which share no vertex."""
    random = np.random.default_rng(0)
    corners = random.uniform(-0.05, 0.05, (count, 1, 3)) + random.normal(0, 0.005, (count, 3, 3))
    return ShapeModel(
        mean=corners.reshape(-1, 3).astype(np.float32),
        basis=np.zeros((1, 3 * count, 3), np.float32),
        faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        parts=np.zeros(3 * count, np.int32),
        part_names=("whole",),
        explained_variance_ratio=np.ones(1),
    )


def test_a_mesh_in_many_pieces_has_a_texture_as_far_as_they_go_in(
    teapot: ObjectClass, tmp_path: Path
) -> None:
    some = atlas_of(replace(teapot, shape_model=in_pieces(300), transfer=None, points={}, families=()))
    assert some is not None and len(np.unique(some.face)) == 300
    crumbled = replace(teapot, shape_model=in_pieces(20_000), transfer=None, points={}, families=())
    assert atlas_of(crumbled) is None
    explanation = painted(crumbled)
    assert bake_any(explanation) is None
    explanation.save(tmp_path, files=["object.glb"])
    assert b"baseColorFactor" in (tmp_path / "object.glb").read_bytes()


def test_what_is_seen_has_the_photos_colour_without_its_light(teapot: ObjectClass) -> None:
    explanation = painted(teapot)
    texture = bake(explanation)
    points = points_of(texture, explanation)
    seen, mirrored = texture.origin == SEEN, texture.origin == MIRRORED
    assert 0.1 < seen.mean() < 0.3 and 0.05 < mirrored.mean() < 0.3
    error = np.abs(texture.colours - paint(points, explanation.object_class)).max(1)
    assert np.median(error[seen]) < 0.005 and np.quantile(error[seen], 0.9) < 0.05
    counterpart = np.abs(texture.colours - paint(points * [1, -1, 1], teapot)).max(1)
    assert np.median(counterpart[mirrored]) < 0.005 and np.quantile(counterpart[mirrored], 0.9) < 0.05
    assert np.median(error[mirrored]) > 0.1, "its own paint differs: the test tells the two apart"


def test_what_neither_side_shows_has_its_parts_colour(teapot: ObjectClass) -> None:
    explanation = painted(teapot)
    texture, model = bake(explanation), teapot.shape_model
    points = points_of(texture, explanation)
    below = points[:, 2] < 0.002  # the foot's underside
    assert (texture.origin[below] == INVENTED).all() and below.sum() > 1000
    part = model.parts[model.faces[texture.atlas.face[below], 0]]
    np.testing.assert_array_equal(texture.colours[below], part_albedo(explanation)[part])


def test_nothing_of_what_covers_the_object_is_on_it(teapot: ObjectClass) -> None:
    explanation = painted(teapot, hidden=slice(150, 220))
    texture = bake(explanation)
    far_from = np.abs(texture.colours - MAGENTA).max(1)
    assert far_from.min() > 0.2
    assert (texture.origin == SEEN).mean() < 0.8 * (bake(painted(teapot)).origin == SEEN).mean()


def test_nothing_seen_is_all_invented(teapot: ObjectClass) -> None:
    explanation = painted(teapot, hidden=slice(0, 300))
    assert bake(explanation).shares == {"seen": 0.0, "mirrored": 0.0, "invented": 1.0}


def test_a_class_without_a_mirror_takes_nothing_from_it(teapot: ObjectClass) -> None:
    one_sided = replace(teapot, mirror=False)
    shares = bake(painted(one_sided)).shares
    assert shares["mirrored"] == 0 and shares["seen"] > 0.1


def test_dark_parts_keep_their_colour() -> None:
    """The renderer draws a car's windows by their reflectance; the photo's colour is that of the windows."""
    car = ObjectClass.load("car")
    explanation = painted(car)
    texture = bake(explanation)
    points, part = points_of(texture, explanation), car.shape_model.parts[car.shape_model.faces]
    face = texture.atlas.face
    inside = (texture.origin == SEEN) & (part[face] == part[face][:, :1]).all(1)
    dark = inside & (part[face, 0] == car.shape_model.part_names.index("dark"))
    true = (
        paint(points, explanation.object_class)
        * np.array(car.part_reflectance, np.float32)[part[face, 0]][:, None]
    )
    for those in (dark, inside & ~dark):
        assert those.sum() > 300
        assert np.median(np.abs(texture.colours - true)[those]) < 0.03


def test_the_file_holds_texture_and_origin(teapot: ObjectClass, tmp_path: Path) -> None:
    explanation = painted(teapot)
    explanation.save(tmp_path, files=["object.glb", "texture_seen.png"])
    texture = bake(explanation)
    data = (tmp_path / "object.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    described, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def picture(number: int) -> np.ndarray:
        view = described["bufferViews"][described["images"][number]["bufferView"]]
        return np.asarray(Image.open(io.BytesIO(binary[view["byteOffset"] :][: view["byteLength"]])))

    (mesh,) = described["meshes"]
    told: dict[str, Any] = mesh["extras"]["texture_seen"]
    assert told["values"] == {"seen": 255, "mirrored": 128, "invented": 0}
    assert told["shares"] == texture.shares and sum(told["shares"].values()) == pytest.approx(1)
    for seen in (picture(told["image"]), np.asarray(Image.open(tmp_path / "texture_seen.png"))):
        np.testing.assert_array_equal(seen, texture.origin_picture)
    number = described["textures"][0]["source"]
    assert np.abs(picture(number).astype(int) - texture.picture).mean() < 2  # as far as JPEG keeps it
    for material in described["materials"]:
        assert material["pbrMetallicRoughness"]["baseColorTexture"] == {"index": 0}
        assert "baseColorFactor" not in material["pbrMetallicRoughness"], "it would multiply the texture"
    explanation.save(tmp_path / "other")
    assert not (tmp_path / "other" / "texture_seen.png").exists()


def test_a_map_that_cannot_be_made_leaves_none_of_before(
    teapot: ObjectClass, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    explanation = painted(teapot)
    explanation.save(tmp_path, files=["texture_seen.png"])
    assert (tmp_path / "texture_seen.png").exists()
    monkeypatch.setattr("vig_app.report.folder.bake", lambda explanation: None)
    explanation.save(tmp_path, files=["texture_seen.png"])
    assert not (tmp_path / "texture_seen.png").exists()
    assert capsys.readouterr().err.startswith("vig: texture_seen.png is left out")
