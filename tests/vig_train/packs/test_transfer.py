"""Transfer vectors: rays, what is blocked, bounces, and the packaged table."""

import numpy as np
import pytest
import trimesh
from safetensors.numpy import load_file

from tests.support import TEAPOT
from vig.parallel import thread_limit
from vig.scene import ObjectClass, irradiance
from vig.scene.light import Y00, sh_basis
from vig.scene.object_class import TRANSFER_FILE
from vig_train.packs import transfer
from vig_train.packs.transfer import (
    Occlusion,
    Rays,
    fill_from_neighbours,
    frames_of,
    neighbours_of,
    transfer_model,
    unoccluded_transfer,
)

RNG = np.random.default_rng(5)


def spheres(distance: float, radius: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Two balls whose centres are `distance` apart along X, as one mesh."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    pair = trimesh.util.concatenate([ball, ball.copy().apply_translation([distance, 0, 0])])
    return np.asarray(pair.vertices), np.asarray(pair.faces)


def directions(normals: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (N, R, 3) of the rays from points with unit normals (N, 3), as `Rays` defines them."""
    rays = Rays.draw(len(normals), side, rng)
    share, turn = rays.patterns[np.arange(len(normals)) // 1024].transpose(2, 0, 1)
    angle = 2 * np.pi * (turn + rays.turns[:, None])
    local = np.stack([np.sqrt(share) * np.cos(angle), np.sqrt(share) * np.sin(angle), np.sqrt(1 - share)], -1)
    return np.einsum("nrk,nkd->nrd", local, frames_of(normals))


def test_directions_are_cosine_weighted_about_their_normals() -> None:
    normals = RNG.normal(size=(1100, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    away = directions(normals, 24, RNG)
    assert np.allclose(np.linalg.norm(away, axis=2), 1)
    cosine = np.einsum("nrc,nc->nr", away, normals)
    assert cosine.min() >= 0
    # Under the density cosine / pi the mean cosine is 2 / 3, of its square 1 / 2.
    assert np.allclose(cosine.mean(1), 2 / 3, atol=1e-3)
    assert np.allclose((cosine**2).mean(1), 1 / 2, atol=1e-3)
    assert np.allclose(away.mean(1), 2 / 3 * normals, atol=5e-3)


def test_a_hollow_blocks_every_direction() -> None:
    """So that what is blocked is the mean of the basis over all rays."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)[:, ::-1]
    assert len(vertices) > 1024, "of several chunks"
    occlusion = Occlusion.of(vertices, faces, 6, np.random.default_rng(3))
    away = directions(occlusion.normals, 6, np.random.default_rng(3))
    assert np.abs(occlusion.blocked - sh_basis(away).mean(1)).max() < 1e-12
    assert occlusion.seen.sum(1) == pytest.approx(1)


def test_unoccluded_is_the_irradiance_of_the_model() -> None:
    normals = np.array([[0, 0, 1.0], [0.6, 0.8, 0], [0, -0.6, 0.8]])
    light = np.array([3.0, 0.2, 0.3, -0.1, 0.2, 0.1, -0.2, 0.3, 0.1])
    expected = irradiance(light, normals)
    assert np.allclose(unoccluded_transfer(normals) @ light, expected)


def test_a_ball_shadows_nothing_of_itself() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    occlusion = Occlusion.of(np.asarray(ball.vertices), np.asarray(ball.faces), 12, RNG)
    assert not occlusion.inside.any()
    assert np.abs(occlusion.blocked).max() == 0
    assert occlusion.seen.nnz == 0


def test_a_ball_blocks_its_form_factor() -> None:
    vertices, faces = spheres(0.1)
    occlusion = Occlusion.of(vertices, faces, 40, RNG)
    facing = int(np.argmin(np.linalg.norm(vertices - [0.03, 0, 0], axis=1)))
    # A ball of radius r straight ahead at distance d fills (r / d)^2 of the cosine-weighted directions.
    expected = (0.03 / np.linalg.norm(vertices[facing] - [0.1, 0, 0])) ** 2
    assert occlusion.blocked[facing, 0] / Y00 == pytest.approx(expected, rel=0.03)
    assert occlusion.seen[facing].sum() == pytest.approx(expected, rel=0.03)
    back = int(np.argmin(np.linalg.norm(vertices - [-0.03, 0, 0], axis=1)))
    assert occlusion.blocked[back, 0] == 0


def test_white_object_in_even_light_is_white_everywhere() -> None:
    vertices, faces = spheres(0.065)
    occlusion = Occlusion.of(vertices, faces, 20, RNG)
    neighbours = neighbours_of(faces, len(vertices))
    shadowed = occlusion.change(0.0, 0, neighbours)[:, 0] / Y00
    assert shadowed.min() < -0.5
    furnace = occlusion.change(1.0, 60, neighbours)[:, 0] / Y00
    assert np.abs(furnace).max() < 1e-3


def test_vertices_inside_another_part_are_found_and_filled() -> None:
    vertices, faces = spheres(0.04)
    occlusion = Occlusion.of(vertices, faces, 12, RNG)
    left = np.arange(len(vertices)) < len(vertices) // 2
    within = np.linalg.norm(vertices - np.where(left[:, None], [0.04, 0, 0], 0.0), axis=1) < 0.0285
    assert occlusion.inside[within].all()
    assert not occlusion.inside[np.abs(vertices[:, 0] - 0.02) > 0.03].any()
    change = occlusion.change(0.0, 0, neighbours_of(faces, len(vertices)))
    assert change[within, 0].min() > -0.95 * Y00


def test_spread_goes_ring_by_ring() -> None:
    strip = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]])
    values = np.array([[6.0], [2.0], [0.0], [0.0], [9.0]])
    missing = np.array([False, False, True, True, True])
    filled = fill_from_neighbours(values, missing, neighbours_of(strip, 5))
    # Vertex 2 has the known neighbours 0 and 1, vertex 3 only 1; then 4 has 2 and 3.
    assert filled.ravel().tolist() == [6.0, 2.0, 4.0, 2.0, 3.0]


def test_packaged_table_predicts_a_shape_it_was_not_made_of() -> None:
    teapot = ObjectClass.load(TEAPOT)
    model = teapot.shape_model
    assert teapot.folder is not None
    table = load_file(teapot.folder / TRANSFER_FILE)["transfer"].astype(np.float64)
    assert table.shape == (model.modes + 1, len(model.mean), 9)
    coefficients = np.random.default_rng(12).standard_normal(model.modes)
    vertices = model.vertices(coefficients[None])[0]
    occlusion = Occlusion.of(vertices, model.faces, 12, RNG)
    exact = occlusion.change(0.5, 4, neighbours_of(model.faces, len(vertices)))
    seen = ~occlusion.inside

    def off(change: np.ndarray) -> float:
        return float(np.sqrt(((change - exact)[seen] ** 2).sum() / (exact[seen] ** 2).sum()))

    linear, mean_only = off(np.tensordot([1.0, *coefficients], table, axes=1)), off(table[0])
    assert linear < 0.35
    assert linear < 0.9 * mean_only


def test_table_is_a_pure_function_of_its_seed(capsys: pytest.CaptureFixture[str]) -> None:
    """Its progress is shown where it is asked for."""
    model = ObjectClass.load(TEAPOT).shape_model
    small = transfer_model(model, shapes=2, side=2, progress=True)
    assert "2 of 2 shapes" in capsys.readouterr().err
    assert small.dtype == np.float32
    assert np.isfinite(small).all()
    assert np.array_equal(small, transfer_model(model, shapes=2, side=2))


def test_shapes_that_were_kept_are_not_computed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The table of a run that was stopped is that of one in one go, on several threads, too."""
    monkeypatch.setattr(transfer, "KEPT_SHAPES", 2)
    model = ObjectClass.load(TEAPOT).shape_model
    kept: dict[str, dict[str, np.ndarray]] = {}
    stopped = 3

    def keep(stage: str, inputs: list[str], compute: transfer.Compute) -> dict[str, np.ndarray]:
        key = " ".join([stage, *inputs])
        if key not in kept:
            if len(kept) == stopped:
                raise KeyboardInterrupt
            kept[key] = dict(compute())
        return kept[key]

    with pytest.raises(KeyboardInterrupt):
        transfer_model(model, shapes=9, side=2, keep=keep)
    assert len(kept) == stopped
    before, stopped = set(kept), 99
    resumed = transfer_model(model, shapes=9, side=2, keep=keep)
    assert len(kept) == 5 and before < set(kept)
    with thread_limit(2):
        assert np.array_equal(resumed, transfer_model(model, shapes=9, side=2))
    assert not np.array_equal(resumed, transfer_model(model, shapes=9, side=2, seed=1, keep=keep))
