from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from vig.scene import ObjectClass, linear_from_srgb
from vig.synthesis import assets
from vig.synthesis.build import build, export, target_vertices
from vig.synthesis.footprint import Footprint
from vig.synthesis.occlusion import world
from vig.synthesis.props import FAMILIES
from vig.synthesis.raster import render
from vig.synthesis.sampling import TOLERANCE, sample
from vig.synthesis.spec import SceneSpec
from vig.synthesis.view import View

COUNT = 16


@pytest.fixture(scope="module")
def teapot() -> ObjectClass:
    return ObjectClass.load("teapot")


@pytest.fixture(scope="module")
def specs(teapot: ObjectClass) -> list[SceneSpec]:
    return [sample(teapot, seed=11, index=index) for index in range(COUNT)]


def test_a_scene_is_a_pure_function_of_seed_index_and_split(
    teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    assert sample(teapot, 11, 3) == specs[3]
    assert sample(teapot, 12, 3).shape != specs[3].shape
    assert sample(teapot, 11, 3, "test").shape != specs[3].shape


def test_json_round_trip_is_exact(specs: list[SceneSpec]) -> None:
    for spec in specs:
        assert SceneSpec.from_json(spec.to_json()) == spec


def test_latents_are_in_their_ranges(specs: list[SceneSpec]) -> None:
    latents = np.stack([spec.latents() for spec in specs])
    assert latents.shape == (COUNT, 24)
    assert np.abs(latents[:, :10]).max() <= 3
    assert (0 <= latents[:, 10]).all() and (latents[:, 10] < 2 * np.pi).all()
    assert (0.05 <= latents[:, 11]).all() and (latents[:, 11] <= np.pi / 2).all()
    assert (0.2 <= latents[:, 12:15]).all() and (latents[:, 12:15] <= 0.8).all()
    np.testing.assert_allclose(latents[:, 15], 0.75 * np.pi, rtol=1e-6)


def test_the_asked_share_is_hidden(teapot: ObjectClass, specs: list[SceneSpec]) -> None:
    for spec in specs:
        assert 0 <= spec.target <= 0.9
        assert abs(spec.occlusion - spec.target) <= TOLERANCE
        assert abs(render(spec, teapot).occlusion - spec.target) <= 2 * TOLERANCE


def test_props_do_not_touch_the_object_each_other_or_the_eye(
    teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    """A prop and the arm or cord that holds it are meant to touch."""
    for spec in specs:
        view = View.of(teapot, spec.azimuth, spec.elevation)
        solids = [Footprint.of(target_vertices(spec, teapot), view.forward)]
        for placed in spec.props:
            vertices, _ = world(spec.split, placed)
            assert vertices[:, 2].min() > -1e-3
            assert ((vertices - view.eye) @ view.forward).min() > 0.08
            solid = Footprint.of(vertices, view.forward)
            others = solids[:-1] if placed.role == "holder" else solids
            assert all(solid.clear_of(other, 0.003) for other in others)
            solids.append(solid)


def test_what_stands_is_on_the_support_inside_the_room(specs: list[SceneSpec]) -> None:
    for spec in specs:
        assert all(table <= wall for table, wall in zip(spec.room.table, spec.room.walls, strict=False))
        for placed in spec.props:
            if placed.role == "clutter":
                vertices, _ = world(spec.split, placed)
                assert abs(vertices[:, 2].min()) < 1e-3
                assert (vertices[:, :2] @ spec.room.directions().T <= np.array(spec.room.extents())).all()


def test_the_eye_is_in_the_room_with_a_surface_behind_every_pixel(
    teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    for spec in specs:
        eye = View.of(teapot, spec.azimuth, spec.elevation).eye
        assert (eye[:2] @ spec.room.directions().T < np.array(spec.room.walls)).all()
        picture = render(spec, teapot)
        assert np.isfinite(picture.depth).all()
        assert picture.image.reshape(-1, 3).std(axis=0).max() > 8


def test_the_object_is_shaded_as_albedo_times_irradiance(teapot: ObjectClass, specs: list[SceneSpec]) -> None:
    """Where nothing is clipped, the object's linear colour has the ratios of its albedo."""
    spec = next(spec for spec in specs if spec.occlusion < 0.5)
    picture = render(spec, teapot)
    inside = picture.visible.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= np.roll(picture.visible, step, axis)
    colours = linear_from_srgb(picture.image[inside] / 255)
    colours = colours[(colours.max(axis=1) < 0.98) & (colours.min(axis=1) > 0.1)]
    ratios = colours / colours.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.median(ratios, axis=0), np.array(spec.albedo) / sum(spec.albedo), atol=0.01)


def test_splits_share_no_asset() -> None:
    train, test = assets.prop("train", "mug", 0), assets.prop("test", "mug", 0)
    assert not np.array_equal(train.parts[0][0].vertices, test.parts[0][0].vertices)
    assert not np.allclose(assets.light("train", 0, 0.0), assets.light("test", 0, 0.0))


def test_at_least_eight_families_are_used(specs: list[SceneSpec]) -> None:
    families = Counter(placed.family for spec in specs for placed in spec.props)
    assert len(set(families) & set(FAMILIES)) >= 8


def test_build_starts_with_the_object_and_export_holds_the_same(
    teapot: ObjectClass, specs: list[SceneSpec], tmp_path: Path
) -> None:
    instances = build(specs[0], teapot)
    assert [instance.is_target for instance in instances] == [True] + [False] * (len(instances) - 1)
    export(specs[0], teapot, tmp_path / "scene")
    with np.load(tmp_path / "scene.npz") as arrays:
        np.testing.assert_array_equal(arrays["0_vertices"], instances[0].mesh.vertices)
        assert arrays["panorama"].ndim == 3
