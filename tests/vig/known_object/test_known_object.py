"""The pose of a known textured object, in any rotation, against poses that pictures were drawn with."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from tests.support import run_vig
from tests.toys import toy
from vig import Explainer, Hints, Tracker, track
from vig.inference import PixelLabel, Verdict
from vig.io.errors import UserError
from vig.known_object import FILE, Keypoints, KnownObject, Surface
from vig.known_object.picture import WEIGHTS, Picture
from vig.known_object.search import Poses, Stage
from vig.scene.light import linear_from_srgb, srgb8_from_linear
from vig.several import explain_found, explain_together
from vig_native import engine

WIDTH, HEIGHT, FOCAL = 320, 240, 400.0
K = np.array([[FOCAL, 0, 150.0], [0, FOCAL, 125.0], [0, 0, 1]])
K2, K3 = (K * np.array([[scale], [scale], [1]]) for scale in (2, 3))  # of larger photos
SIDES = np.array([0.12, 0.08, 0.05])


def carton(seed: int = 5, cells: int = 4) -> Surface:
    """A box with another print on each side."""
    rng = np.random.default_rng(seed)
    vertices, faces, uv, texels = [], [], [], []
    for axis in range(3):
        for sign in (-1, 1):
            across = np.roll(np.eye(3), axis, axis=0)  # the axis comes first
            corners = [across[0] * sign + across[1] * a * sign + across[2] * b
                       for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]  # fmt: skip
            faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices) * 4)
            vertices.append(np.array(corners) * SIDES / 2 + [0, 0, SIDES[2] / 2])
            uv.append([[0, 0], [1, 0], [1, 1], [0, 1]])
            texels.append(
                np.kron(
                    rng.integers(20, 235, (cells, cells, 3)), np.ones((32 // cells, 32 // cells, 1))
                ).reshape(-1, 3)
            )
    return Surface(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(uv).astype(np.float32),
        np.repeat(np.arange(6), 2).astype(np.int32),
        np.full((6, 2), 32, np.int32),
        np.concatenate(texels).astype(np.uint8),
    )


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int, int], Path]:
    """Packs of cartons by seed and cells, each made once: it keeps the keypoints of its views."""

    @cache
    def made(seed: int, cells: int) -> Path:
        folder = tmp_path_factory.mktemp("carton")
        toy("fin").save(folder)
        carton(seed, cells).save(folder)
        return folder

    return made


@pytest.fixture(scope="module")
def pack(packed: Callable[[int, int], Path]) -> Path:
    return packed(5, 4)


@pytest.fixture(scope="module")
def explainer(pack: Path) -> Explainer:
    return Explainer(pack)


def photo_of(
    pose: np.ndarray, surface: Surface | None = None, scale: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """A photo (H, W, 3) uint8 with noise behind the object, and the pixels that it covers."""
    surface = surface or carton()
    nothing = np.zeros((scale * HEIGHT, scale * WIDTH, 3), np.float32)
    per_pixel = pose[2, 3] / FOCAL / scale
    camera = scale * FOCAL, scale * K[0, 2], scale * K[1, 2]
    weights = WEIGHTS.of_box(1.0, 1.0)
    given = engine.pose_photo(nothing, nothing[..., 0], camera, None, None, False, per_pixel, weights)
    middle = pose[:3, :3] @ surface.middle + pose[:3, 3]
    arrays = (np.ascontiguousarray(part, np.float32) for part in (pose[:3, :3], middle))
    coverage, colour, normal, *_ = engine.draw_pose(surface.mesh, given, *arrays)
    lit = colour * np.exp(-0.2 + normal @ [0.3, 0.4, -0.2])[..., None]
    side = 8 * scale
    behind = np.random.default_rng(1).random((HEIGHT // 8, WIDTH // 8, 3)).repeat(side, 0).repeat(side, 1)
    mixed = lit * coverage[..., None] + 0.6 * behind * (1 - coverage[..., None])
    return srgb8_from_linear(mixed), coverage > 0.5


def pose_at(seed: int) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    pose[:3, 3] = [0.02, -0.03, 0.55] - pose[:3, :3] @ [0, 0, SIDES[2] / 2]
    return pose


def box_round(mask: np.ndarray) -> tuple[float, float, float, float]:
    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
    return columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1


def off(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Degrees between two poses, and metres between the carton's middles."""
    turn = Rotation.from_matrix(found[:3, :3] @ true[:3, :3].T).magnitude()
    middle = [0, 0, SIDES[2] / 2, 1]
    return float(np.degrees(turn)), float(np.linalg.norm((found - true)[:3] @ middle))


@pytest.mark.parametrize("seed", range(4))
def test_any_rotation_is_found(explainer: Explainer, seed: int) -> None:
    pose = pose_at(seed)
    photo, mask = photo_of(pose)
    found = explainer.explain(photo, box_round(mask), K=K, mask=mask)
    turned, moved = off(found.camera_from_object, pose)
    assert turned < 4 and moved < 0.01
    assert (found.mask & mask).sum() > 0.9 * (found.mask | mask).sum()
    boxed = explainer.explain(photo, box_round(mask), K=K)
    assert off(boxed.camera_from_object, pose)[0] < 6 and boxed.verdict is Verdict.AMBIGUOUS
    matrix, pinhole, covariance = found.pinhole_pose()
    np.testing.assert_allclose(matrix, K)
    np.testing.assert_allclose(pinhole, found.camera_from_object, atol=1e-6)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert moved < 6 * np.sqrt(np.trace(covariance[:3, :3])) < 0.1
    assert np.radians(turned) < 6 * np.sqrt(np.trace(covariance[3:, 3:]))
    # The pose is that of its angles, too, which reports and exports read.
    camera = found.camera.camera_from_world(np.radians(found.azimuth_deg), np.radians(found.elevation_deg))
    np.testing.assert_allclose(camera, found.camera_from_object, atol=1e-5)


def test_a_covered_object_is_found(explainer: Explainer) -> None:
    pose = pose_at(7)
    photo, mask = photo_of(pose)
    box, seen = box_round(mask), mask.copy()
    x, width = int(box[0]), int(box[2])
    photo[:, x + int(0.6 * width) :] = (90, 140, 60)
    seen[:, x + int(0.6 * width) :] = False
    with_mask = explainer.explain(photo, box, K=K, hints=Hints(mask=seen))
    assert off(with_mask.camera_from_object, pose)[0] < 6
    assert with_mask.hidden_fraction == pytest.approx(1 - seen.sum() / mask.sum(), abs=0.08)


@pytest.mark.parametrize("seed", [0, 3])
def test_the_outline_tells_any_rotation_of_one_colour(tmp_path: Path, seed: int) -> None:
    toy("fin").save(tmp_path)
    surface = carton()
    replace(surface, texels=np.full_like(surface.texels, 128)).save(tmp_path)
    pose = pose_at(seed)
    photo, mask = photo_of(pose)
    found = Explainer(tmp_path).explain(photo, box_round(mask), K=K, hints=Hints(mask=mask))
    # Half a turn about each of its axes leaves a carton's shape as it is.
    symmetries = [np.diag(signs) for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
    turned = [pose[:3, :3] @ symmetry @ found.camera_from_object[:3, :3].T for symmetry in symmetries]
    assert min(np.degrees(Rotation.from_matrix(turn).magnitude()) for turn in turned) < 6
    assert off(found.camera_from_object, pose)[1] < 0.015
    assert found.verdict is Verdict.AMBIGUOUS


def test_a_dark_photo_is_as_good(explainer: Explainer) -> None:
    pose = pose_at(2)
    photo, mask = photo_of(pose)
    dark = np.rint(photo * 0.12).astype(np.uint8)
    found = explainer.explain(dark, box_round(mask), K=K, hints=Hints(mask=mask))
    assert off(found.camera_from_object, pose)[0] < 4


def test_a_pose_that_is_the_best_at_last_is_refined(pack: Path) -> None:
    true, surface = pose_at(0), carton()
    photo, mask = photo_of(true)
    colour = linear_from_srgb(photo[:, 30:270] / 255).astype(np.float32)
    picture = Picture(colour, mask[:, 30:270].astype(np.float32), True, FOCAL, None)
    turns = np.stack([Rotation.from_rotvec([0, 0, turn]).as_matrix() for turn in (2.5, 1.6, -1.6, 0.1)])
    middle = true[:3, :3] @ surface.middle + true[:3, 3]
    poses = Poses((turns @ true[:3, :3]).astype(np.float32), np.tile(middle, (4, 1)).astype(np.float32),
                  np.array([-30.0, -30.0, -30.0, -9.0]))  # fmt: skip
    refined = poses.refine(surface, picture, Stage(2, 80, 60, (0.06, 0.008, 0.012), 1.5))
    assert len(refined.scores) == 4 and refined.scores[0] == refined.scores.max() > -9
    assert np.degrees(Rotation.from_matrix(refined.rotations[0] @ true[:3, :3].T).magnitude()) < 4


def test_known_surroundings_are_what_a_pose_must_explain_better() -> None:
    """The score with surroundings, from the one without them, which is of a pixel in the mean."""
    true, surface, rng = pose_at(1), carton(), np.random.default_rng(0)
    photo, mask = photo_of(true)
    colour = linear_from_srgb(photo[:, 30:270] / 255).astype(np.float32)
    seen = (rng.random(colour.shape[:2]) < 0.8).astype(np.float32)
    beside = rng.normal(-3, 1, seen.shape).astype(np.float32)
    pose = [
        part[None].astype(np.float32) for part in (true[:3, :3], true[:3, :3] @ surface.middle + true[:3, 3])
    ]
    weights, camera = WEIGHTS.of_box(50.0, 40.0), (FOCAL, 120.0, 125.0)
    without, given = (
        engine.pose_photo(colour, seen, camera, None, densities, False, 0.001, weights)
        for densities in (None, beside)
    )
    scores = [
        engine.refine_poses(surface.mesh, each, *pose, 0, (0.0, 0.0, 0.0), 1)[2][0]
        for each in (without, given)
    ]
    coverage, *_, light = engine.draw_pose(surface.mesh, given, pose[0][0], pose[1][0])
    gains = (light[:3] - light[:3].mean()) / WEIGHTS.gain_deviation
    prior = ((gains**2).sum() + ((light[3:] / WEIGHTS.slope_deviation) ** 2).sum()) / 2 / WEIGHTS.pixels
    weight = coverage * seen
    # The score leaves out the normaliser of the inliers' share of the density.
    normaliser = np.log(WEIGHTS.share / WEIGHTS.sigma**3) - 1.5 * np.log(2 * np.pi)
    better = (scores[0] + prior + normaliser) * weight.sum() - (weight * beside).sum()
    assert scores[1] == pytest.approx(WEIGHTS.surroundings / 2000 * better - prior, rel=1e-3)


def test_numbers_beyond_a_level_of_a_texture_are_refused() -> None:
    nothing, weights = np.zeros((8, 8, 3), np.float32), WEIGHTS.of_box(1.0, 1.0)
    for per_pixel in (0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="metres_per_pixel"):
            engine.pose_photo(
                nothing, nothing[..., 0], (8.0, 4.0, 4.0), None, None, False, per_pixel, weights
            )


def test_hints_narrow_the_search(explainer: Explainer) -> None:
    pose = pose_at(0)  # at an elevation of -28 degrees: near a pole a small turn changes the azimuth by much
    photo, mask = photo_of(pose)
    turned = pose.copy()
    turned[:3, :3] = Rotation.from_rotvec([0.1, -0.1, 0.1]).as_matrix() @ pose[:3, :3]
    from_pose = explainer.explain(photo, box_round(mask), K=K, hints=Hints(pose=turned, mask=mask))
    assert off(from_pose.camera_from_object, pose)[0] < 4
    assert from_pose.verdict is Verdict.AMBIGUOUS and "only the pose" in from_pose.reason
    elsewhere = from_pose.azimuth_deg + 180
    held = explainer.explain(photo, box_round(mask), K=K, hints=Hints(azimuth_deg=elsewhere, mask=mask))
    assert abs((held.azimuth_deg - elsewhere + 180) % 360 - 180) < 60
    assert held.verdict is not Verdict.TRUSTED
    standing = explainer.explain(photo, box_round(mask), K=K, hints=Hints(roll_deg=0, mask=mask))
    assert from_pose.elevation_deg < -20 and standing.elevation_deg >= 0
    marks = np.where(mask, PixelLabel.SEEN, PixelLabel.UNKNOWN).astype(np.uint8)
    marked = explainer.explain(photo, K=K, hints=Hints(pose=turned, marks=marks, visible=True))
    assert off(marked.camera_from_object, pose)[0] < 4 and marked.hidden_fraction == 0


def test_without_a_place_or_with_a_damaged_surface(
    explainer, pack: Path, tmp_path: Path, monkeypatch
) -> None:
    photo, _ = photo_of(pose_at(0))
    with monkeypatch.context() as patch, pytest.raises(UserError, match="expected a box or a mask"):
        patch.setitem(sys.modules, "cv2", None)
        explainer.explain(photo)
    toy("fin").save(tmp_path)
    assert KnownObject.of(Explainer(tmp_path).object_class) is None
    (tmp_path / FILE).write_bytes((pack / FILE).read_bytes()[:-100])
    with pytest.raises(UserError, match="the surface of an object"):
        Explainer(tmp_path)


def test_a_known_object_is_followed_and_found_again_after_it_was_hidden(pack: Path) -> None:
    start, turn = pose_at(1), Rotation.from_rotvec([0.02, -0.03, 0.02]).as_matrix()
    tracker, errors, lost = Tracker(pack, K=K), [], []
    pose, middle = start.copy(), start[:3, :3] @ [0, 0, SIDES[2] / 2] + start[:3, 3]
    for number in range(14):
        photo, mask = photo_of(pose)
        if 6 <= number < 9:
            photo[:, 60:240] = (90, 140, 60)
        seen = tracker.start(photo, box=box_round(mask)) if number == 0 else tracker(photo)
        assert seen is not None and seen.number == number and seen.covariance.shape == (6, 6)
        errors.append(off(seen.camera_from_object, pose))
        lost.append(seen.lost)
        pose[:3, :3] = turn @ pose[:3, :3]
        middle = middle + [0.002, 0.001, 0.003]
        pose[:3, 3] = middle - pose[:3, :3] @ [0, 0, SIDES[2] / 2]
    assert lost == [False] * 6 + [True] * 3 + [False] * 5
    turned, moved = np.array(errors).T
    followed = [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13]
    assert turned[followed].max() < 6 and moved[followed].max() < 0.02
    with pytest.raises(UserError, match="frames of one size"):
        tracker(photo[:100])


@pytest.mark.parametrize("seed", range(3))
def test_a_mask_alone_tells_the_place(explainer: Explainer, seed: int) -> None:
    """At any roll, which turns the window of the fit."""
    pose = pose_at(seed)
    photo, mask = photo_of(pose)
    found = explainer.explain(photo, K=K, hints=Hints(mask=mask))
    assert off(found.camera_from_object, pose)[0] < 4


@pytest.mark.parametrize("cover", ["black", "painted over"])
def test_what_has_no_print_is_lost_and_found_again_at_once(pack: Path, cover: str) -> None:
    pose = pose_at(1)
    photo, mask = photo_of(pose)
    hidden = (
        np.zeros_like(photo) if cover == "black" else np.where(mask[..., None], 120, photo).astype(np.uint8)
    )
    tracker = Tracker(pack, K=K)
    tracker.start(photo, box=box_round(mask))
    poses = [tracker(frame) for frame in [hidden] * 2 + [photo] * 2]
    assert [pose.lost for pose in poses] == [True] * 2 + [False] * 2
    for seen in poses:
        turned, moved = off(seen.camera_from_object, pose)
        assert turned < 6 and moved < 0.02


def test_a_place_that_the_lens_does_not_see_is_lost(pack: Path) -> None:
    pose = pose_at(1)
    photo, mask = photo_of(pose)
    tracker = Tracker(pack, K=K)
    tracker.start(photo, box=box_round(mask))
    assert tracker._known is not None
    tracker._known.pose = pose
    tracker._known.pose[:3, 3] = [9.0, 0, 0.02]
    seen = tracker(photo)
    assert seen.lost and np.isfinite(seen.camera_from_object).all() and seen.mask.shape == mask.shape


def test_a_video_is_tracked_both_ways_from_where_the_object_is_found(packed) -> None:
    pytest.importorskip("cv2")
    pack, surface, start = packed(3, 16), carton(3, 16), pose_at(3)
    frames, poses = [], []
    for number in range(4):
        pose = start.copy()
        pose[:3, 3] += [0.004 * number, 0, 0]
        frames.append(photo_of(pose, surface, 3)[0])
        poses.append(pose)
    frames[0] = np.full_like(frames[0], 90)
    told: list[int] = []
    followed = track(frames, pack, K=K3, on_frame=lambda number, _: told.append(number))
    assert [frame.lost for frame in followed.frames] == [True, False, False, False]
    assert told == [1, 2, 3, 0] and [frame.number for frame in followed.frames] == [0, 1, 2, 3]
    for frame, pose in list(zip(followed.frames, poses, strict=True))[1:]:
        assert off(frame.camera_from_object, pose)[0] < 5
    with pytest.raises(UserError, match="found none"):
        track([frames[0]] * 2, pack)


def test_keypoints_tell_how_likely_a_pose_is(explainer: Explainer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they cannot be had no probability is stated and nothing is trusted."""
    pytest.importorskip("cv2")
    pose = pose_at(2)
    photo, mask = photo_of(pose, None, 2)
    given = {"box": box_round(mask), "K": K2}
    found = explainer.explain(photo, **given, hints=Hints(mask=mask))
    boxed = explainer.explain(photo, **given)
    assert found.verdict is Verdict.TRUSTED and 0.91 <= found.confidence <= 1
    assert f"right with a probability of {found.confidence:.0%}" in found.report()
    assert 0 <= boxed.confidence <= 1 and boxed.to_dict()["trusted_from"]["view"] is None
    monkeypatch.setattr(Keypoints, "available", lambda: False)
    without = explainer.explain(photo, **given, hints=Hints(mask=mask))
    assert off(without.camera_from_object, pose)[0] < 4 and without.verdict is Verdict.AMBIGUOUS
    assert np.isnan(without.confidence) and "vig[match]" in without.reason


def test_the_covariance_is_that_of_the_meshs_own_origin(explainer: Explainer) -> None:
    """Against the spread of poses that are drawn by the pose's covariance; millimetres, another origin."""
    photo, mask = photo_of(pose_at(2))
    found = explainer.explain(photo, box_round(mask), K=K, mask=mask)
    object_from_mesh = np.eye(4)
    object_from_mesh[:3] = (
        0.001 * np.c_[Rotation.from_euler("y", 90, degrees=True).as_matrix(), [40, 70, -90]]
    )
    own = replace(found, object_class=replace(found.object_class, object_from_mesh=object_from_mesh))
    _, pose, covariance = own.pinhole_pose()
    moves = np.random.default_rng(3).multivariate_normal(np.zeros(6), covariance * 1e-4, 20_000)
    middle = (pose @ object_from_mesh)[:3, 3] - pose[:3, 3]
    drawn = moves[:, :3] + Rotation.from_rotvec(moves[:, 3:]).apply(middle)
    spread = np.cov(np.c_[1000 * drawn, moves[:, 3:]].T) * 1e4
    assert own.camera_from_mesh_covariance is not None and found.camera_from_mesh_covariance is None
    size = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(
        own.camera_from_mesh_covariance / np.outer(size, size), spread / np.outer(size, size), atol=0.05
    )


def test_a_camera_of_another_photo_is_not_trusted_and_none_is_named(packed) -> None:
    pytest.importorskip("cv2")
    photo, mask = photo_of(pose_at(2), carton(7, 8), 2)
    explain = partial(Explainer(packed(7, 8)).explain, photo, box_round(mask), mask=mask)
    known, aside, unknown = explain(K=(800, 800, 300, 250)), explain(K=(800, 800, 660, 250)), explain()
    assert known.verdict is unknown.verdict is Verdict.TRUSTED and "K" not in known.reason
    assert "without K its distance is a guess" in unknown.reason
    assert aside.verdict is Verdict.AMBIGUOUS and "is K of another size?" in aside.reason
    threshold = known.to_dict()["trusted_from"]["view"]
    assert aside.confidence < threshold == 0.91 <= known.confidence


def test_a_turn_that_looks_the_same_is_no_rival(tmp_path: Path) -> None:
    """A carton that half a turn about its vertical leaves as it is, print included."""
    pytest.importorskip("cv2")
    plain = carton(7, 8)
    back, front, bottom, top, left, right = (side.reshape(32, 32, 3) for side in np.split(plain.texels, 6))
    across = [np.concatenate([half, half[::-1, ::-1]]) for half in (bottom[:16], top[:16])]
    sides = [front, front, *across, right[::-1, ::-1], right]
    surface = replace(plain, texels=np.concatenate([side.reshape(-1, 3) for side in sides]))
    turns = {angles: Rotation.from_euler("xyz", angles, degrees=True) for angles in
             ((0, 0, 0), (0, 0, 180), (0, 0, 90), (180, 0, 0), (0, 180, 0))}  # fmt: skip
    same = [angles for angles, turn in turns.items() if surface.looks_same(turn.as_matrix())]
    assert same == [(0, 0, 0), (0, 0, 180)]
    assert not plain.looks_same(turns[0, 0, 180].as_matrix())
    logo = sides[1].copy()
    logo[8:24, 8:24] = 255 - logo[8:24, 8:24]  # a quarter of a side
    sides[1] = logo
    marked = replace(surface, texels=np.concatenate([side.reshape(-1, 3) for side in sides]))
    assert not marked.looks_same(turns[0, 0, 180].as_matrix())
    card = replace(surface, vertices=surface.vertices * np.float32([1, 1, 0.005]))  # .25 mm thick
    assert card.looks_same(turns[0, 0, 180].as_matrix()) and not card.looks_same(turns[180, 0, 0].as_matrix())
    assert not card.looks_same(turns[0, 0, 90].as_matrix())
    toy("fin").save(tmp_path)
    surface.save(tmp_path)
    pose = pose_at(2)
    photo, mask = photo_of(pose, surface, 2)
    found = Explainer(tmp_path).explain(photo, box_round(mask), K=K2, mask=mask)
    half = np.eye(4)
    half[:3, :3] = turns[0, 0, 180].as_matrix()
    assert min(off(found.camera_from_object @ turn, pose)[0] for turn in (np.eye(4), half)) < 3
    assert found.verdict is Verdict.TRUSTED
    others = [
        off(other.camera_from_object @ half, found.camera_from_object)[0] for other in found.alternatives
    ]
    assert min(others, default=180) > 20


def test_a_whole_photo_is_searched(packed) -> None:
    """Two cartons with fine print, one before the other and each found; with boxes, too."""
    pytest.importorskip("cv2")
    photo, explainers, poses, whole = np.zeros((0,)), [], [], []
    for number, (seed, shift) in enumerate(((3, (-0.02, 0, 0.5)), (8, (0.05, 0.02, 0.7)))):
        explainers.append(Explainer(folder := packed(seed, 16)))
        pose = pose_at(seed)
        pose[:3, 3] = np.array(shift) - pose[:3, :3] @ [0, 0, SIDES[2] / 2]
        drawn, mask = photo_of(pose, carton(seed, 16), 3)
        photo = drawn if number == 0 else np.where(whole[0][..., None], photo, drawn)
        poses.append(pose)
        whole.append(mask)
    assert (whole[0] & whole[1]).any()
    for scene in (
        explain_found(photo, explainers, 4, K=K3),
        explain_together(photo, explainers, [box_round(mask) for mask in whole], K=K3),
    ):
        assert len(scene.objects) == 2
        front, back = sorted(scene.objects, key=lambda each: each.camera_from_object[2, 3])
        assert off(front.camera_from_object, poses[0])[0] < 5
        assert off(back.camera_from_object, poses[1])[0] < 5
        assert scene.occludes.sum() == 1
        seen = whole[1] & ~whole[0]
        assert (back.mask & seen).sum() > 0.8 * (back.mask | seen).sum()
    alone = explainers[0].explain(photo, K=K3)
    assert off(alone.camera_from_object, poses[0])[0] < 5 and alone.present > 0.7
    tracked = Tracker(folder, K=K3)(photo)
    assert Tracker(folder, K=K3)(np.full_like(photo, 90)) is None
    assert tracked is not None and off(tracked.camera_from_object, poses[1])[0] < 5
    with pytest.raises(UserError, match="alone"):
        explain_found(photo, [*explainers, Explainer("mug")], 4)
    with pytest.raises(UserError, match="found none"):
        explain_found(photo[:40, :40], explainers, 4)


def test_meshes_of_a_folder_are_found(packed, tmp_path: Path, monkeypatch, capsys) -> None:
    """By the command line; copies, plain meshes and other files are left out."""
    pytest.importorskip("cv2")
    monkeypatch.chdir(tmp_path)
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    seeds = {"a.glb": 3, "b.glb": 8, "copy.glb": 3, "plain.glb": 1}
    for name, seed in seeds.items():
        (meshes / name).write_text(str(seed))
        folder = tmp_path / "packs" / name
        if name == "plain.glb":
            replace(carton(1, 16), texels=np.full_like(carton(1, 16).texels, 90)).save(folder)
        else:
            shutil.copytree(packed(seed, 16), folder)
        toy(Path(name).stem).save(folder)
    (meshes / "x.txt").touch()
    monkeypatch.setattr("vig_app.cli.boxes.pack_of_mesh", lambda file, *_: tmp_path / "packs" / file.name)
    pose = pose_at(3)
    photo, mask = photo_of(pose, carton(3, 16), 3)
    Image.fromarray(photo).save("photo.png")
    lens = "--K", "1200,1200,450,375"
    command = ["fit", "photo.png", "--meshes", "meshes", *lens, "--files", "mask.png", "--out", "found"]
    assert run_vig(*command) == 0
    said = capsys.readouterr()
    assert "'copy.glb' is left out: it is the same as 'a.glb'" in said.err
    assert "'plain.glb' is left out: it has one colour" in said.err and "x.txt" not in said.err
    assert [path.name for path in Path("found/photo").glob("*-*")] == ["1-a"]
    boxes = {"photo.png": [{"box": box_round(mask), "class": "a"}]}
    Path("boxes.json").write_text(json.dumps(boxes, default=float))
    assert run_vig(*command[:-1], "boxed", "--boxes", "boxes.json") == 0
    for out in ("found", "boxed"):
        written = json.loads(Path(out, "photo", "1-a", "explanation.json").read_text())
        assert off(np.array(written["pinhole"]["camera_from_object"]), pose)[0] < 5
    boxes["photo.png"][0]["class"] = "c"
    Path("boxes.json").write_text(json.dumps(boxes, default=float))
    assert run_vig(*command, "--boxes", "boxes.json") == 2
    assert "expected --boxes with the names of meshes, a, b; got 'c'" in capsys.readouterr().err
