import numpy as np
import pytest

from vig.scene import srgb8_from_linear
from vig_native import engine
from vig_world.assets.things import Material
from vig_world.mesh import Mesh
from vig_world.raster.packed import PackedAsset, pack
from vig_world.raster.pyramid import TextureLevels
from vig_world.raster.shadows import BOUNCE, directions, sky_weights, slopes, surface_points


def decoded(pyramid: TextureLevels) -> list[np.ndarray]:
    """The levels (h, w, 3), linear."""
    width, height = (1 << n for n in pyramid.log_size)
    levels, start = [], 0
    while start < len(pyramid.texels):
        texels = pyramid.texels[start : start + width * height].reshape(height, width)
        levels.append(np.stack([texels & 255, texels >> 8 & 255, texels >> 16], -1) ** 2 / 255.0**2)
        start += width * height
        width, height = width // 2, height // 2
    return levels


def test_levels_halve_down_to_the_mean() -> None:
    texture = np.random.default_rng(0).uniform(size=(8, 16, 3)).astype(np.float32)
    pyramid = TextureLevels.of(texture)
    levels = decoded(pyramid)
    assert [level.shape[:2] for level in levels] == [(8, 16), (4, 8), (2, 4), (1, 2)]
    np.testing.assert_allclose(levels[0], texture, atol=0.005)
    np.testing.assert_allclose(levels[-1][0, 0], texture[:, :8].mean(axis=(0, 1)), atol=0.005)


@pytest.mark.parametrize("shape", [(3, 5), (100, 100), (1, 1), (1100, 700)])
def test_any_size_becomes_a_power_of_two_and_keeps_its_mean(shape: tuple[int, int]) -> None:
    """A linear slope round the edges has the same mean whatever the number of texels."""
    wave = 0.5 + 0.3 * np.sin(2 * np.pi * (np.arange(shape[1]) + 0.5) / shape[1])
    texture = np.broadcast_to(wave[None, :, None], (*shape, 3)).astype(np.float32)
    finest = decoded(TextureLevels.of(texture))[0]
    for size, wanted in zip(finest.shape, shape, strict=False):
        assert size & (size - 1) == 0 and size <= 512
        assert 0.7 < size / min(wanted, 512) < 1.42 or wanted > 512
    np.testing.assert_allclose(finest.mean(), texture.mean(), atol=0.01)


def test_surface_points_stand_for_the_whole_surface() -> None:
    rng = np.random.default_rng(0)
    vertices = rng.uniform(0, 0.3, (12, 3)).astype(np.float32)
    faces = rng.permuted(np.tile(np.arange(12, dtype=np.int32), (20, 1)), axis=1)[:, :3]
    points = surface_points(vertices, faces, 1e-4)
    a, b, c = (vertices[faces[:, i]].astype(float) for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert points[:, 3].sum() == pytest.approx(areas.sum(), rel=1e-5)
    assert points[:, 3].max() <= 1e-4
    centre = ((a + b + c) / 3 * areas[:, None]).sum(0) / areas.sum()
    np.testing.assert_allclose(np.average(points[:, :3], axis=0, weights=points[:, 3]), centre, atol=2e-3)


def test_an_asset_needs_parts_and_texture_coordinates() -> None:
    material = Material(np.ones((1, 1, 3), np.float32), "cloth", 1.0)
    bare = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(ValueError, match="one part or more"):
        PackedAsset.of([])
    with pytest.raises(ValueError, match="texture coordinates"):
        PackedAsset.of([(bare, material)])


def test_slots_and_shared_textures_are_kept_once() -> None:
    texture = np.ones((64, 64, 3), np.float32)
    points = 0.1 * np.eye(3, dtype=np.float32)
    mesh = Mesh(points, np.array([[0, 1, 2]], np.int32), np.zeros((3, 2), np.float32))
    wood, top = Material(texture, "wood", 0.5, "wood"), Material(texture, "wood", 0.5, "top")
    arrays = pack([(mesh, wood), (mesh, top), (mesh, wood)])
    packed = PackedAsset.from_arrays(arrays)
    assert packed.slots == ("wood", "top")
    assert (packed.native.vertices, packed.native.faces) == (9, 3)
    assert arrays["asset_parts"][:, 4].tolist() == [0, 1, 0]
    assert len(arrays["asset_texels"]) == len(TextureLevels.of(texture).texels)


def test_light_from_all_directions_is_what_a_level_surface_gets() -> None:
    """Under even light of radiance 1, L00 = 2 sqrt(pi), they are an irradiance of 1, less what comes back."""
    towards = directions()
    np.testing.assert_allclose(np.linalg.norm(towards, axis=1), 1, atol=1e-12)
    weights = sky_weights(np.array([2 * np.sqrt(np.pi), *[0.0] * 8]))
    assert (weights[:, 0] + weights[:, 3]).sum() == pytest.approx(1 - BOUNCE)
    np.testing.assert_allclose(weights[:, 1:3].sum(0), 0, atol=0.05)


def test_a_sweep_loses_the_light_that_is_blocked() -> None:
    """Under a plate wider than all shadows move all light is lost; above it none."""
    opacity = np.zeros((6, 48, 48), np.float32)
    opacity[3, 8:-8, 8:-8] = 1
    weights = np.full((len(directions()), 4), 0.1, np.float32)
    values, scale = engine.sweep(opacity, 0.1, slopes(), weights, 0.0)
    assert values.shape == (7, 48, 48, 4)
    lost = values * scale
    np.testing.assert_allclose(lost[:4, 21:27, 21:27], 0.1 * len(weights), rtol=1e-3)
    assert not values[4:].any() and not values[:, 0].any() and not values[:, :, -1].any()
    fading, _ = engine.sweep(opacity, 0.1, slopes(), weights, 0.1)
    ratio = fading[:4, 24, 24, 0] / fading[3, 24, 24, 0]
    np.testing.assert_allclose(ratio, np.exp([-3, -2, -1, 0]), rtol=2e-3)  # a plane is .1 m below the other


def test_linear_light_is_encoded_as_the_formula_does() -> None:
    values = np.random.default_rng(0).uniform(0, 1, 20000).astype(np.float32) ** 2
    assert (engine.encode_srgb(values) != srgb8_from_linear(values)).mean() < 1e-4
    ends = np.array([-1, 0, 1, 7, np.nan], np.float32)
    assert engine.encode_srgb(ends)[:4].tolist() == [0, 0, 255, 255]
