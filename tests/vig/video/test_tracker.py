"""Each frame's pose from those before it: behind a globe, lost and found again, before a known camera."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vig
from tests.vig.video.conftest import Video
from tests.vig.video.test_track import off, sighting
from vig.io.errors import UserError
from vig.photo.masks import box_of
from vig.video.following import Follower
from vig.video.tracker import GIVEN_UP, MEMORY, TrackedPose
from vig.video.trajectory import view_evidence

pytestmark = pytest.mark.usefixtures("remembered_networks")

K = np.array([[400.0, 0, 75], [0, 400.0, 75], [0, 0, 1]])
"""Of a camera that may have taken the frames."""


@pytest.fixture(scope="module")
def poses(quick_video: Video, explainer: vig.Explainer) -> list[TrackedPose]:
    tracker = vig.Tracker(explainer, K=K)
    first = tracker.start(quick_video.frames[0], box=quick_video.box)
    assert first is not None
    return [first, *(tracker.step(frame) for frame in quick_video.frames[1:])]


def test_a_pot_that_turns_by_ten_degrees_a_frame_is_followed(
    poses: list[TrackedPose], quick_video: Video
) -> None:
    assert [pose.number for pose in poses] == list(range(len(quick_video.frames)))
    errors = off(np.array([pose.azimuth_deg for pose in poses]), quick_video.azimuths)
    assert np.median(errors) < 12 and errors[:4].max() < 35, "9.6 when this was written"
    assert errors[4:].max() < 18, "14 when this was written"
    for pose in poses:
        assert 0 <= pose.azimuth_deg < 360 and pose.azimuth_deviation_deg > 0 and pose.seconds > 0
        assert pose.covariance.shape == (6, 6) and (np.linalg.eigvalsh(pose.covariance) > 0).all()
        turn = pose.camera_from_object[:3, :3]
        assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)


def test_the_network_sees_each_frame_once_and_every_second_one_mirrored(
    quick_video: Video, explainer: vig.Explainer, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker, seen = vig.Tracker(explainer, K=K), []
    tracker.start(quick_video.frames[0], box=quick_video.box)
    plain = explainer.recognizer._predict
    monkeypatch.setattr(
        explainer.recognizer, "_predict", lambda photos, sides: (seen.append(sides), plain(photos, sides))[1]
    )
    assert not any(tracker.step(frame).lost for frame in quick_video.frames[1:5])
    assert seen == [(True,), (False,)] * 2


def test_views_that_no_fit_tried_count_by_the_network() -> None:
    ahead, away = 30, 120  # bins
    network = np.full(72, 1e-4)
    network[away * 72 // 180] = 1.0
    with_it = view_evidence(sighting(61, network=network / network.sum()))
    without = view_evidence(sighting(61))
    assert abs(with_it[ahead] - without[ahead]) < 0.1
    assert with_it[away] > without[away] + 1
    assert with_it[away + 30] < without[away + 30]


def test_poses_are_before_the_camera_that_was_given(
    poses: list[TrackedPose], explainer: vig.Explainer
) -> None:
    model, pose = explainer.object_class.shape_model, poses[0]
    assert np.array_equal(pose.camera.K, K)
    matrix = pose.camera_from_object
    points = (model.mean @ matrix[:3, :3].T + matrix[:3, 3]) @ K.T
    pixels = points[:, :2] / points[:, 2:]
    left, top, width, height = box_of(pose.amodal) or (0, 0, 0, 0)
    least, most = pixels.min(0), pixels.max(0)  # of the mean shape: the fitted one differs a little
    assert np.abs(least - [left, top]).max() < 12
    assert np.abs(most - [left + width, top + height]).max() < 12


def test_a_pose_before_a_camera_that_looks_aside_is_that_of_the_fit(
    quick_video: Video, explainer: vig.Explainer
) -> None:
    aside = np.array([[300.0, 0, -150], [0, 320.0, 60], [0, 0, 1]])
    pose = vig.Tracker(explainer, K=aside).start(quick_video.frames[0], box=quick_video.box)
    assert pose is not None and np.array_equal(pose.camera.K, aside)
    here, fitted = pose.camera_from_object, pose.explanation.camera_from_object
    assert np.abs(here[:3, 3] - fitted[:3, 3]).max() < 0.02 * fitted[2, 3]
    assert np.linalg.norm(here[:3, :3] - fitted[:3, :3]) < math.sqrt(2) * math.radians(2)
    assert fitted[0, 3] > 0.4 * fitted[2, 3]


def test_masks_are_made_when_they_are_asked_for(poses: list[TrackedPose], quick_video: Video) -> None:
    pose = poses[0]
    x, y, w, h = quick_video.box
    assert pose.mask.shape == (150, 150) and pose.mask.dtype == bool
    assert not (pose.mask & ~pose.amodal).any()
    assert abs(pose.amodal.sum() / (w * h) - 0.6) < 0.25
    assert pose.amodal[round(y + h / 2), round(x + w / 2)]


def test_an_object_is_lost_and_found_again(video: Video, explainer: vig.Explainer) -> None:
    tracker = vig.Tracker(explainer)
    blank = np.full((150, 150, 3), (40, 90, 60), np.uint8)
    moved = np.pad(video.frames[1], ((0, 0), (25, 0), (0, 0)), mode="edge")[:, :150]
    before = tracker.start(video.frames[0], box=video.box)
    after = [tracker(frame) for frame in (video.frames[1], blank, blank, moved, moved)]
    assert before is not None and not before.lost
    assert [pose.lost for pose in after] == [False, True, True, False, False]
    assert after[2].covariance.trace() > after[0].covariance.trace()
    step = after[-1].camera_from_object[:3, 3] - after[0].camera_from_object[:3, 3]
    assert step[0] > 0.02


def test_an_object_that_stays_lost_stays_within_its_deviations(
    video: Video, explainer: vig.Explainer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long, and whatever the fits of frames without it say."""
    tracker = vig.Tracker(explainer, K=K)
    tracker.start(video.frames[0], box=video.box)
    before = [tracker.step(video.frames[0]) for _ in range(3)][-1]
    fit = before.explanation.fit
    wrong = replace(before.explanation, fit=replace(fit, position_deviation=0.01 * fit.position_deviation))
    sighting_lost = sighting(10, lost=True, place=np.zeros(3))

    def explain(follower: Follower, frame: Any) -> Any:
        follower.missed += 1
        return wrong, sighting_lost

    monkeypatch.setattr(Follower, "explain", explain)
    monkeypatch.setattr(tracker, "_begin", lambda picture: None)
    after = [tracker.step(video.frames[0]) for _ in range(MEMORY + 6)]
    depths, deviations = np.array([(p.camera_from_object[2, 3], p.covariance[2, 2] ** 0.5) for p in after]).T
    depth, deviation = before.camera_from_object[2, 3], before.covariance[2, 2] ** 0.5
    assert (np.abs(depths - depth) < deviations).all() and (np.diff([deviation, *deviations]) >= 0).all()
    assert deviations[-1] < depth


def test_a_box_with_nothing_in_it_is_lost_and_does_not_count(video: Video, explainer: vig.Explainer) -> None:
    tracker, empty = vig.Tracker(explainer, K=K), np.full((150, 150, 3), (40, 90, 60), np.uint8)
    x, y, w, h = video.box
    first = tracker.start(empty, box=(x + w / 4, y + h / 4, w / 2, h / 2))
    assert first is not None and first.lost
    pose, known = tracker.start(video.frames[0], box=video.box), tracker._sightings
    tracker.start(empty, box=video.box)
    found = tracker.step(video.frames[0])
    assert pose is not None and not found.lost and len(tracker._sightings) == len(known) == 1
    assert abs(found.camera_from_object[2, 3] / pose.camera_from_object[2, 3] - 1) < 0.1


def test_an_object_that_went_away_is_sought_everywhere(video: Video, explainer: vig.Explainer) -> None:
    tracker = vig.Tracker(explainer, K=K)
    wide = np.full((150, 400, 3), (40, 90, 60), np.uint8)
    here, there = wide.copy(), wide.copy()
    here[:, :150], there[:, -150:] = video.frames[0], video.frames[0]
    assert tracker.start(here, box=video.box) is not None
    away = [tracker.step(wide) for _ in range(GIVEN_UP)]
    assert all(pose.lost for pose in away)
    pose = tracker.step(there)
    assert not pose.lost and pose.number == GIVEN_UP + 1
    assert pose.camera_from_object[0, 3] > away[-1].camera_from_object[0, 3] + 0.1


def test_it_is_sought_until_it_is_found_and_a_mask_starts_it_anew(
    poses: list[TrackedPose], quick_video: Video, explainer: vig.Explainer
) -> None:
    tracker = vig.Tracker(explainer)
    assert tracker(np.full((150, 150, 3), 120, np.uint8)) is None
    pose = tracker(quick_video.frames[0])
    assert pose is not None and pose.number == 1 and not pose.lost
    pose = tracker.start(quick_video.frames[0], mask=poses[0].mask)
    assert pose is not None and off(pose.azimuth_deg, poses[0].azimuth_deg) < 10


def test_what_cannot_be_tracked_is_refused(video: Video, explainer: vig.Explainer) -> None:
    tracker = vig.Tracker(explainer)
    with pytest.raises(UserError, match="expected a tracker that was started"):
        tracker.step(video.frames[0])
    tracker.start(video.frames[0], box=video.box)
    with pytest.raises(UserError, match="frames of one size, 150 x 150; got one of 140 x 150"):
        tracker.step(video.frames[0][:, :140])
    for camera, words in (
        (np.zeros((3, 3)), "K as"),
        ("abc", "fx, fy, cx, cy or K .*; got 'abc'"),
        (math.nan, "finite numbers, focal lengths above 0"),
    ):
        with pytest.raises(UserError, match=words):
            vig.Tracker(explainer, K=camera)
    wrong: Any = 12
    with pytest.raises(UserError):
        vig.Tracker(wrong)
