"""The world of photographs: its draws, its pictures in the rasteriser, and what they say of themselves."""

from collections import Counter

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from tests.vig_world.generation.labels import silhouette
from vig.scene import Latents, ObjectClass
from vig_world.assets.coats import albedo_of, draw_coat, mean_albedo
from vig_world.assets.panoramas.light import mirror
from vig_world.assets.target import target_vertices
from vig_world.composition.photographs import draw_manner
from vig_world.composition.sampling import sample
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.cycles.appearance import bake_texture
from vig_world.renderers.rasterized import render

COUNT = 24


@pytest.fixture(scope="module")
def specs(library: Library, teapot: ObjectClass) -> list[SceneSpec]:
    return [sample(library, teapot, 31, index) for index in range(COUNT)]


def test_scenes_are_wide_and_pure(library: Library, specs: list[SceneSpec], teapot: ObjectClass) -> None:
    assert sample(Library("validation"), teapot, 31, 5) == specs[5]
    assert all(SceneSpec.from_json(spec.to_json()) == spec for spec in specs)
    finishes = Counter(spec.coat.finish for spec in specs if spec.coat)
    assert sum(finishes.values()) == COUNT and {"matt", "glossy", "painted"} <= finishes.keys()
    assert {spec.room.layout in library.sweeps for spec in specs} == {True, False}
    assert np.ptp([spec.lens.farther for spec in specs]) > 2
    assert np.mean([spec.elevation < np.radians(15) for spec in specs]) > 0.3
    assert np.std([spec.target for spec in specs]) > 0.2, "occlusion stays a controlled variable"


def test_the_paper_s_world_has_neither_coat_nor_lens(library: Library, teapot: ObjectClass) -> None:
    spec = sample(library, teapot, 31, 5, "paper")
    assert spec.coat is None
    assert (spec.lens.farther, spec.lens.roll, spec.lens.scale, spec.lens.shift) == (
        1.0,
        0.0,
        1.0,
        (0.0, 0.0),
    )


def test_objects_are_framed_as_boxes_do(teapot: ObjectClass) -> None:
    """Whatever the lens, the longer side of the object is about 1 / 1.4 of the image's."""
    vertices, sides = teapot.shape_model.mean, []
    for number in range(60):
        manner = draw_manner(np.random.default_rng(number), teapot, vertices, 0.1 * number)
        view = View.through(manner.lens, teapot, 0.1 * number, manner.elevation)
        seen = vertices @ view.rotation.T + view.translation
        across = view.camera.focal * seen[:, :2] / seen[:, 2:]
        sides.append(np.ptp(across, axis=0).max() / view.camera.width)
    assert abs(np.median(sides) * 1.4 - 1) < 0.05


def test_the_picture_s_mask_is_the_mesh_s_projection(
    library: Library, specs: list[SceneSpec], teapot: ObjectClass
) -> None:
    for spec in specs[:6]:
        picture = render(library, spec, teapot)
        canvas = silhouette(teapot, target_vertices(spec, teapot), spec)
        assert (canvas != picture.canvas).sum() < 0.01 * canvas.sum()


def test_a_white_and_a_black_coat_differ_where_the_object_is_seen_only(
    library: Library, specs: list[SceneSpec], teapot: ObjectClass
) -> None:
    from dataclasses import replace

    spec = next(each for each in specs if each.coat and each.occlusion < 0.4)
    assert spec.coat is not None
    parts = len(teapot.shape_model.part_names)
    images = []
    for level in (0.02, 0.9):
        coat = replace(spec.coat, colours=((level,) * 3,) * parts, metal=False, gloss=0.0, paint=None)
        images.append(render(library, replace(spec, coat=coat), teapot))
    changed = (images[0].image.astype(int) != images[1].image.astype(int)).any(-1)
    assert not (changed & ~binary_dilation(images[0].visible, iterations=2)).any()
    assert changed[binary_erosion(images[0].visible)].mean() > 0.95


def test_a_plain_coat_looks_as_the_model_s_albedo(
    library: Library, specs: list[SceneSpec], teapot: ObjectClass
) -> None:
    """The coat's shading and the rasteriser's own of one albedo agree to a few levels of 255."""
    from dataclasses import replace

    spec = specs[0]
    assert spec.coat is not None
    colours = (spec.albedo,) * len(teapot.shape_model.part_names)
    plain = replace(spec.coat, colours=colours, metal=False, gloss=0.0, paint=None)
    coated = render(library, replace(spec, coat=plain), teapot)
    own = render(library, replace(spec, coat=None), teapot)
    inner = binary_erosion(own.visible)
    off = np.abs(coated.image[inner].astype(int) - own.image[inner].astype(int))
    assert np.median(off) <= 1 and np.quantile(off, 0.95) <= 6


def test_mean_albedo_is_that_of_the_surface(teapot: ObjectClass) -> None:
    model = teapot.shape_model
    coat = draw_coat(np.random.default_rng(4), len(model.part_names), 0.0, 0.0)
    low, high = np.min(coat.colours, axis=0), np.max(coat.colours, axis=0)
    mean = mean_albedo(coat, model.mean, model)
    assert ((mean >= low - 1e-6) & (mean <= high + 1e-6)).all()


def test_albedo_is_finite_and_in_range_whatever_the_paint(teapot: ObjectClass) -> None:
    model, rng = teapot.shape_model, np.random.default_rng(0)
    with np.errstate(all="raise", under="ignore"):
        for _ in range(150):
            coat = draw_coat(rng, len(model.part_names), 1.0, 0.0)
            albedo = albedo_of(coat, model.mean, model.parts, float(model.mean[:, 2].max()))
            assert albedo.dtype == np.float32 and albedo.min() >= 0 and albedo.max() <= 1


def test_a_baked_coat_has_each_face_s_albedo(teapot: ObjectClass) -> None:
    model = teapot.shape_model
    coat = draw_coat(np.random.default_rng(1), len(model.part_names), 1.0, 0.0)
    assert coat.paint is not None
    image, uv = bake_texture(coat, model.mean, model)
    height, width = image.shape[:2]
    middle = uv.mean(1)
    found = image[
        np.clip(((1 - middle[:, 1]) * height).astype(int), 0, height - 1),
        np.clip((middle[:, 0] * width).astype(int), 0, width - 1),
    ]
    points = model.mean[model.faces].mean(1)
    truth = albedo_of(coat, points, model.parts[model.faces[:, 0]], float(model.mean[:, 2].max()))
    assert np.median(np.abs(found - truth).max(1)) < 0.02
    assert (np.abs(found - truth).max(1) < 0.1).mean() > 0.8


def test_a_mirror_shows_the_panorama_s_lamp_where_it_is() -> None:
    radiance = np.full((32, 64, 3), 0.1)
    radiance[8, 16] = 50.0  # 45 degrees up, towards +Y
    show = mirror(radiance, 0.0, 0.5)
    up = (8.5 / 32) * np.pi
    lamp = np.array([[np.cos(2 * np.pi * 16.5 / 64) * np.sin(up), np.sin(up), np.cos(up)]])
    lamp /= np.linalg.norm(lamp)
    assert show(lamp, 0.05)[0, 0] > 10 * show(lamp * [-1, -1, 1], 0.05)[0, 0]
    assert show(lamp, 0.4)[0, 0] < show(lamp, 0.05)[0, 0], "a rough one shows it softer"
    turned = mirror(radiance, np.pi / 2, 0.5)
    quarter = np.array([[-lamp[0, 1], lamp[0, 0], lamp[0, 2]]])
    assert turned(quarter, 0.05)[0, 0] > 10


def test_latents_hold_the_mean_albedo(specs: list[SceneSpec], teapot: ObjectClass) -> None:

    for spec in specs[:4]:
        latents = Latents.from_vector(spec.latents()[None])
        np.testing.assert_allclose(latents.albedo[0], spec.albedo, rtol=1e-6)
        assert spec.coat is not None
        mean = mean_albedo(spec.coat, target_vertices(spec, teapot), teapot.shape_model)
        np.testing.assert_allclose(mean, spec.albedo, rtol=1e-5)
