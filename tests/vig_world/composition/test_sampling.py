from collections import Counter
from typing import Any

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.scene import EXPOSURE_L00, ObjectClass, linear_from_srgb
from vig_world.assets.footprint import Footprint
from vig_world.assets.target import target_vertices
from vig_world.composition import sampling
from vig_world.composition.sampling import TOLERANCE, sample, target_occlusion
from vig_world.dataset.spec import Placed, SceneSpec
from vig_world.library import Library
from vig_world.raster.draw import depth
from vig_world.raster.items import Item
from vig_world.raster.view import View
from vig_world.renderers.build import build
from vig_world.renderers.rasterized import render

COUNT = 16


@pytest.fixture(scope="module")
def library() -> Library:
    return Library("train")


@pytest.fixture(scope="module")
def specs(library: Library, teapot: ObjectClass) -> list[SceneSpec]:
    return [sample(library, teapot, seed=11, index=index, world="paper") for index in range(COUNT)]


def vertices_of(library: Library, placed: Placed) -> np.ndarray:
    parts = library.prop(placed.family, placed.asset).parts
    points = np.concatenate([mesh.vertices for mesh, _ in parts])
    return points @ placed.matrix().T + placed.position


def support_of(library: Library, spec: SceneSpec) -> np.ndarray:
    """Corners (4, 3) in the world of what the object stands on."""
    support = library.layout(spec.room.layout).supports[spec.room.support]
    c, s = np.cos(support.turn), np.sin(support.turn)
    a, b = support.half
    corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) @ np.array([[c, s], [-s, c]])
    return spec.room.to_world(np.column_stack([corners, np.zeros(4)]) + support.centre)


def within(points: np.ndarray, corners: np.ndarray, margin: float = 0.0) -> bool:
    """Whether points (N, 2) lie in a convex polygon (M, 2), counter-clockwise."""
    way = np.roll(corners, -1, axis=0) - corners
    offset = points[:, None] - corners
    left = (way[:, 0] * offset[..., 1] - way[:, 1] * offset[..., 0]) / np.linalg.norm(way, axis=1)
    return bool((left >= margin).all())


def test_a_scene_is_a_pure_function_of_seed_index_and_split(
    library: Library, teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    fresh = Library("train")
    assert sample(fresh, teapot, 11, 3, world="paper") == specs[3]  # whatever the library made before
    assert sample(library, teapot, 12, 3, world="paper").shape != specs[3].shape
    assert sample(Library("test"), teapot, 11, 3, world="paper").shape != specs[3].shape


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
    np.testing.assert_allclose(latents[:, 15], EXPOSURE_L00, rtol=1e-6)


def test_the_asked_share_is_hidden(library: Library, teapot: ObjectClass, specs: list[SceneSpec]) -> None:
    for spec in specs:
        assert 0 <= spec.target <= 0.9
        assert abs(spec.occlusion - spec.target) <= TOLERANCE
        assert abs(render(library, spec, teapot).occlusion - spec.target) <= 2 * TOLERANCE


def test_the_object_stands_on_its_support(
    library: Library, teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    """At the origin, wholly on the support's rectangle, which is level with it."""
    for spec in specs:
        corners = support_of(library, spec)
        np.testing.assert_allclose(corners[:, 2], 0.0, atol=1e-9)
        vertices = target_vertices(spec, teapot)
        assert vertices[:, 2].min() == pytest.approx(0.0, abs=2e-3)
        assert within(vertices[:, :2].astype(float), corners[:, :2], 0.005)


def test_props_do_not_touch_the_object_each_other_or_the_eye(
    library: Library, teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    """A prop and the arm that holds it are meant to touch."""
    for spec in specs:
        view = View.of(teapot, spec.azimuth, spec.elevation)
        solids = [Footprint.of(target_vertices(spec, teapot), view.forward)]
        for placed in spec.props:
            vertices = vertices_of(library, placed)
            assert ((vertices - view.eye) @ view.forward).min() > 0.08
            solid = Footprint.of(vertices, view.forward)
            others = solids[:-1] if placed.role == "holder" else solids
            assert all(solid.gap(other) >= 0.001 for other in others)
            solids.append(solid)


def test_clutter_stands_on_supports(library: Library, specs: list[SceneSpec]) -> None:
    """Its lowest point is level with some support of the room, and above that support's rectangle."""
    seen = 0
    for spec in specs:
        supports = library.layout(spec.room.layout).supports
        for placed in spec.props:
            if placed.role != "clutter":
                continue
            vertices = vertices_of(library, placed)
            local = (vertices - np.array(spec.room.origin)) @ spec.room.rotation()
            level = [s for s in supports if abs(local[:, 2].min() - s.centre[2]) < 1e-3]
            turned = []
            for support in level:
                c, s = np.cos(support.turn), np.sin(support.turn)
                own = (local[:, :2] - support.centre[:2]) @ np.array([[c, -s], [s, c]])
                turned.append(bool((np.abs(own) <= np.array(support.half) + 1e-3).all()))
            assert any(turned)
            seen += 1
    assert seen > COUNT


def test_the_room_leaves_the_object_in_view(
    library: Library, teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    """A surface behind every pixel, and what the room hides is no more than what was asked for."""
    for spec in specs:
        view = View.of(teapot, spec.azimuth, spec.elevation)
        packed = library.plan(spec.room.layout).packed
        room, _ = depth([Item(packed, spec.room.rotation(), np.array(spec.room.origin))], view)
        assert np.isfinite(room).mean() > 0.999
        alone = view.depth(target_vertices(spec, teapot), teapot.shape_model.faces)
        assert (room < alone)[np.isfinite(alone)].mean() <= spec.target + 2 * TOLERANCE


def test_the_object_is_shaded_as_albedo_times_irradiance(
    library: Library, teapot: ObjectClass, specs: list[SceneSpec]
) -> None:
    """Where nothing is clipped, the object's linear colour has the ratios of its albedo."""
    spec = next(spec for spec in specs if spec.occlusion < 0.5)
    picture = render(library, spec, teapot)
    inside = picture.visible.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= np.roll(picture.visible, step, axis)
    colours = linear_from_srgb(picture.image[inside] / 255)
    colours = colours[(colours.max(axis=1) < 0.98) & (colours.min(axis=1) > 0.1)]
    ratios = colours / colours.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.median(ratios, axis=0), np.array(spec.albedo) / sum(spec.albedo), atol=0.01)


def test_many_families_zones_and_rooms_are_used(specs: list[SceneSpec]) -> None:
    families = Counter(placed.family for spec in specs for placed in spec.props)
    assert len(families) >= 20
    assert len({spec.room.layout for spec in specs}) >= 10
    assert len({spec.room.zone for spec in specs}) >= 4


def test_build_starts_with_the_object(library: Library, teapot: ObjectClass, specs: list[SceneSpec]) -> None:
    instances = build(library, specs[0], teapot)
    assert [instance.is_target for instance in instances] == [True] + [False] * (len(instances) - 1)
    assert {"wall", "floor", "ceiling"} <= {instance.name for instance in instances}
    np.testing.assert_array_equal(instances[0].mesh.vertices, target_vertices(specs[0], teapot))


def test_what_no_room_hides_as_asked_stands_on_a_plain_ground_half_as_hidden(
    library: Library, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = sampling.find_place

    def in_no_room(library: Library, layouts: range, *rest: Any) -> Any:
        return find(library, layouts, *rest) if layouts == library.sweeps else None

    monkeypatch.setattr(sampling, "find_place", in_no_room)
    monkeypatch.setattr(sampling, "ATTEMPTS", 2)
    for index in range(4):
        asked = target_occlusion(3, index, "train")
        spec = sample(library, teapot, 3, index, "photo")
        assert spec.room.layout in library.sweeps
        assert spec.target in (asked, asked / 2) and abs(spec.occlusion - spec.target) <= TOLERANCE
    with pytest.raises(UserError, match="2 rooms gave none"):
        sample(library, teapot, 3, 0, "paper")


def test_targets_are_spread_evenly_in_any_run_of_samples() -> None:
    for seed, first, count, bins in ((0, 0, 100, 10), (7, 350, 100, 10), (3, 0, 1000, 10), (7, 5000, 90, 9)):
        targets = [target_occlusion(seed, index, "train") for index in range(first, first + count)]
        counts, _ = np.histogram(targets, bins, (0, 0.9))
        assert counts.sum() == count and np.abs(counts - count / bins).max() <= 2
