"""What the world's binding refuses: arrays of another shape, type or order, and numbers beyond them."""

from typing import Any

import numpy as np
import pytest

from vig_native import engine


def asset(**changed: Any) -> Any:
    """A triangle with a texture of one texel."""
    arrays = {
        "vertices": np.eye(3, dtype=np.float32),
        "attributes": np.zeros((3, 5), np.float32),
        "faces": np.array([[0, 1, 2]], np.int32),
        "parts": np.array([[1, 0, 0, 0, -1]], np.int32),
        "materials": np.zeros((1, 4), np.float32),
        "texels": np.zeros(1, np.uint32),
        "points": np.zeros((0, 4), np.float32),
    }
    return engine.asset(**arrays | changed)


def camera(**changed: Any) -> Any:
    given = {"focal": 10.0, "cx": 4.0, "cy": 4.0, "near": 0.01, "width": 8, "height": 8}
    return engine.camera(np.eye(3), np.array([0.0, 0.0, 2.0]), **given | changed)


def item(**changed: Any) -> Any:
    given = {"rotation": np.eye(3), "translation": np.zeros(3), "owner": 0, "is_support": False}
    return engine.item(asset(), **given | {"finishes": []} | changed)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "vertices",
            np.zeros((3, 2), np.float32),
            r"vertices must be \(any, 3\) of float32 in C order; got \(3, 2\)",
        ),
        ("vertices", np.zeros((3, 3)), r"vertices must be \(any, 3\) .* got \(3, 3\) of float64"),
        ("vertices", np.zeros((3, 3), np.float32, "F"), r"got \(3, 3\) of float32 in another order"),
        ("vertices", [[0.0] * 3] * 3, "got <class 'list'>"),
        ("vertices", np.zeros((0, 3), np.float32), "must have vertices"),
        ("attributes", np.zeros((2, 5), np.float32), r"attributes must be \(3, 5\)"),
        ("faces", np.array([[0, 1, 3]], np.int32), "faces must be from 0 to 2; they are from 0 to 3"),
        ("faces", np.array([[0, 1, -1]], np.int32), "faces must be from 0 to 2; they are from -1"),
        ("faces", np.array([[0, 1, 2]]), "of int32 in C order; got .* of int64"),
        ("parts", np.array([[2, 0, 0, 0, -1]], np.int32), "parts must have ends"),
        ("parts", np.array([[1, 1, 0, 0, -1]], np.int32), "texels must hold all levels"),
        ("parts", np.array([[1, 0, 1, 1, -1]], np.int32), "texels must hold all levels"),
        ("parts", np.array([[1, 0, 31, 0, -1]], np.int32), "log_size of a texture must be 0 to 9"),
        ("materials", np.zeros((2, 4), np.float32), r"materials must be \(1, 4\)"),
        ("ambient", np.zeros((1, 2, 2, 4), np.int16), "two planes or more"),
    ],
)
def test_an_asset_of_other_arrays_is_refused(name: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message) as refused:
        asset(**{name: value}, ambient_frame=np.ones(5, np.float32))
    assert "\n" not in str(refused.value)


def test_poses_cameras_and_searches_of_other_arrays_are_refused() -> None:
    own = np.zeros(1, np.float32), np.zeros(1, bool)
    settle = [item()], camera(), np.zeros(3), (0.0, 1.0)
    steps, lost = np.zeros((12, 2), np.float32), np.zeros((12, 4), np.float32)
    cases = {
        "rotation must be": lambda: item(rotation=np.eye(4)),
        "translation must be": lambda: item(translation=np.zeros(3, np.float32)),
        "all levels": lambda: item(finishes=[(np.zeros(4, np.uint32), (1, 1), 1.0)]),
        "million pixels": lambda: camera(width=2**20, height=2**20),
        "positive": lambda: camera(near=0.0),
        "finite": lambda: camera(cx=np.nan),
        "indices must be pixels": lambda: engine.settle(*settle, np.array([64]), *own, 0.5, 0.1),
        "must have pixels": lambda: engine.settle(
            *settle, np.zeros(0, np.int64), own[0][:0], own[1][:0], 0.5, 0.1
        ),
        "hidden must be": lambda: engine.settle(*settle, np.array([3]), own[0], own[0], 0.5, 0.1),
        "multiple of 16": lambda: engine.sweep(np.zeros((2, 3, 8), np.float32), 0.1, steps, lost, 0.0),
        "weights must be": lambda: engine.sweep(np.zeros((2, 3, 16), np.float32), 0.1, steps, lost[1:], 0.0),
        "added must be": lambda: engine.lit_asset(
            np.array([[0, 1, 2]], np.int32), np.eye(3, dtype=np.float32), own[0], np.zeros(9, np.float32)
        ),
        "13 numbers": lambda: engine.stage(
            camera(), np.zeros((9, 9), np.int64), 1, False, *[np.zeros(3)] * 2, np.eye(3), np.zeros(3), [0.0]
        ),
    }
    for message, call in cases.items():
        with pytest.raises(ValueError, match=message) as refused:
            call()
        assert "\n" not in str(refused.value)


def test_any_numbers_in_arrays_are_drawn_within_memory() -> None:
    """Places, normals, texture coordinates, poses and light of any size, not numbers included."""
    rng = np.random.default_rng(0)
    values = np.array([0, 1, -1, 0.3, 1e-30, 1e30, -1e30, np.inf, -np.inf, np.nan], np.float32)

    def anything(*shape: int, share: float = 0.2) -> np.ndarray:
        wild = rng.random(shape) < share
        return np.where(wild, rng.choice(values, shape), rng.normal(0, 0.5, shape)).astype(np.float32)

    for _ in range(60):
        count, faces = int(rng.integers(3, 40)), int(rng.integers(0, 90))
        made = engine.asset(
            anything(count, 3), anything(count, 5), rng.integers(0, count, (faces, 3), np.int32),
            np.array([[faces // 2, 0, 1, 2, 0], [faces, 0, 0, 0, -1]], np.int32), anything(2, 4),
            rng.integers(0, 2**32, 10, np.uint32), anything(int(rng.integers(0, 9)), 4),
            rng.integers(-999, 999, (2, 3, 4, 4), np.int16), np.array([0, 0, 0, 0.1, 1e-4], np.float32),
        )  # fmt: skip
        pose = anything(3, 3, share=0.05).astype(float), anything(3, share=0.05).astype(float)
        placed = engine.item(made, *pose, 1, False, [(rng.integers(0, 9, 1, np.uint32), (0, 0), 1e30)])
        view = camera(width=int(rng.integers(1, 30)), height=int(rng.integers(1, 30)))
        far, owner = engine.draw_depth([placed], view)
        assert ((owner == 1) == (far < np.inf))[far > 0].all()
        light = anything(9), anything(9), anything(4), anything(3)
        steps, lost = anything(5, 2), anything(5, 4)
        drawn = engine.draw_picture(placed, [placed] * 2, view, light, steps, lost, 0.3, None, True)
        assert drawn[0].shape == (*far.shape, 3) and (drawn[2] <= 4).all()
        assert engine.silhouette(placed, view).shape == far.shape
