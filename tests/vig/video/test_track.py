"""A teapot through the frames of a video: no other pot, no view from the other side."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vig
from tests.vig.video.conftest import Video
from vig.explainer import Box
from vig.io.errors import UserError
from vig.photo import Window
from vig.scene import Camera
from vig.video.following import Follower, Sighting, window_at
from vig.video.trajectory import FAR, Trajectory, views_of

pytestmark = pytest.mark.usefixtures("remembered_networks")


def sighting(azimuth: float, probability: float = 0.8, **changed: Any) -> Sighting:
    """Of a pot in the middle of a frame of 150 x 150; azimuth in degrees; the other side is another view."""
    given = math.radians(azimuth)
    fields: dict[str, Any] = {
        "window": Window(0, 0, 150),
        "camera": Camera.standard(),
        "azimuths": np.array([given, given + math.pi]),
        "probabilities": np.array([probability, 0.9 - probability]),
        "azimuth_deviation": 0.2,
        "elevation": 0.3,
        "elevation_deviation": 0.1,
        "place": np.array([75.0, 75.0, math.log(100)]),
        "hidden": 0.0,
        "albedo": np.full(3, 0.5),
        "shape": np.zeros(4),
        "lost": False,
    }
    return Sighting(**fields | changed)


def off(a: Any, b: Any) -> Any:
    return np.abs((np.asarray(a) - np.asarray(b) + 180) % 360 - 180)


def test_a_view_from_the_other_side_is_taken_back() -> None:
    truth = 5.0 * np.arange(20)
    seen = [sighting(angle) for angle in truth]
    seen[7] = sighting(truth[7] + 180)
    assert off(np.degrees(views_of(seen)), truth).max() < 5
    trajectory = Trajectory.of(seen, views_of(seen))
    assert off(np.degrees(trajectory.azimuth[0]), truth).max() < 3
    assert [number for number, each in enumerate(seen) if trajectory.contradicts(number, each, 1)] == [7]


def test_sure_frames_outvote_unsure_ones() -> None:
    truth = 5.0 * np.arange(20)
    seen = [
        sighting(angle + 180, 0.5) if number < 12 else sighting(angle, 0.9)
        for number, angle in enumerate(truth)
    ]
    assert off(np.degrees(views_of(seen)), truth).max() < 6


def test_lost_frames_and_outliers_do_not_move_the_place() -> None:
    seen = [sighting(5.0 * number, place=np.array([50.0 + 2 * number, 70.0, 4.6])) for number in range(20)]
    seen[9] = sighting(45.0, lost=True, place=np.array([140.0, 10.0, 3.0]))
    seen[14] = sighting(70.0, place=np.array([120.0, 70.0, 4.6]))
    place = Trajectory.of(seen, views_of(seen)).place
    assert np.abs(place[:, 0] - (50 + 2 * np.arange(20))).max() < 2
    assert np.abs(place[:, 2] - 4.6).max() < 0.01


@pytest.mark.parametrize("goes_on", [False, True])
def test_a_lost_object_that_goes_on_or_stands_is_within_two_deviations(goes_on: bool) -> None:
    """It came nearer for ten frames."""
    near = 0.03 * np.arange(10)
    seen = [sighting(0, camera=replace(Camera.standard(), distance=math.exp(-each))) for each in near]
    numbers = Trajectory.of([*seen, *[sighting(0, lost=True)] * 20], np.zeros(30)).numbers[:, 4]
    truth = math.log(Camera.standard().focal) + 0.03 * (np.arange(10, 30) if goes_on else np.full(20, 9.0))
    assert (np.abs(numbers[0, 10:] - truth) < 2 * numbers[1, 10:]).all()


def test_views_that_look_the_same_are_one() -> None:
    """Of a class that is the same after half a turn."""
    truth = 5.0 * np.arange(40)
    seen = [sighting(angle % 180, 0.9) for angle in truth]
    path = np.degrees(views_of(seen, 2))
    assert np.abs((path - truth + 90) % 180 - 90).max() < 5
    assert np.abs(np.diff(path)).max() < 30
    assert FAR < math.pi / 2


def test_a_sure_view_in_the_place_is_the_object_whatever_its_colour(explainer: vig.Explainer) -> None:
    place = np.array([75.0, 75.0, math.log(100)])
    follower = Follower(explainer, place=place, albedo=np.array([0.2, 0.02, 0.01]))
    assert follower._is_object(sighting(10.0, 0.9))
    assert not follower._is_object(sighting(10.0, 0.6))
    assert follower._is_object(sighting(10.0, 0.6, albedo=np.array([0.25, 0.02, 0.01])))
    assert not follower._is_object(sighting(10.0, 0.9, place=place + [50, 0, 0]))
    follower._update(sighting(10.0, 0.9))
    assert follower._is_object(sighting(10.0, 0.6))  # its colour is known now


def test_the_share_that_is_hidden_is_that_of_the_explanation(video: Video, explainer: vig.Explainer) -> None:
    explanation = explainer.explain(video.frames[1])
    hidden = Sighting.of(explanation).hidden
    assert explanation.hidden_fraction is not None and hidden is not None
    assert 0.05 < hidden < 0.95 and abs(hidden - explanation.hidden_fraction) < 0.02


def test_the_window_of_a_place_is_that_of_its_box() -> None:
    assert window_at(np.array([60.0, 50.0, math.log(40)]), 0.0) == Window.round_box((40, 30, 40, 40))


def test_a_pot_that_turns_behind_another_object(video: Video, explainer: vig.Explainer) -> None:
    calls: list[int] = []
    found = vig.track(video.frames, explainer, video.box, on_frame=lambda number, _: calls.append(number))
    frames = found.frames
    assert found.shape.shape == (explainer.object_class.shape_model.modes,)
    assert found.albedo.shape == (3,) and (found.albedo > 0).all()
    azimuth = np.array([frame.azimuth_deg for frame in frames])
    alone = np.array([frame.alone_azimuth_deg for frame in frames])
    assert video.hidden.max() > 0.7
    assert off(alone, video.azimuths).max() > 90  # what tracking is for
    assert off(azimuth, video.azimuths).max() < 25
    assert [frame.number for frame in frames] == list(range(len(video.frames)))
    refitted = [frame.number for frame in frames if frame.refitted]
    assert calls == list(range(len(frames))) + refitted and refitted
    for frame in frames:
        assert 0 <= frame.azimuth_deg < 360 and frame.azimuth_deviation_deg > 0
        pose = frame.camera_from_object
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6)
        assert frame.camera.focal == frames[0].camera.focal


def test_the_track_does_not_jump_to_another_pot(video: Video, explainer: vig.Explainer) -> None:
    """Two pots move apart slowly; a board hides the tracked one wholly, and the other is in plain sight."""
    other = np.flip(video.frames[0][:, :120], axis=1)
    frames = []
    for number in range(8):
        wide = np.full((150, 330, 3), 128, np.uint8)
        at, other_at = 20 - 2 * number, 190 + 2 * number
        wide[:, other_at : other_at + 120] = other
        wide[:, at : at + 120] = video.frames[number % 2][:, :120]
        if number in (3, 4, 5):
            wide[:, at : at + 130] = (40, 90, 60)
        frames.append(wide)
    x, y, w, h = video.box
    found = vig.track(frames, explainer, (x + 20, y, w, h)).frames
    middle = np.array([frame.camera.cx for frame in found])
    expected = x + w / 2 + 20 - 2 * np.arange(8)
    assert np.abs(middle - expected).max() < 0.25 * w
    assert [frame.lost for frame in found][3:6] == [True] * 3
    assert not any(frame.lost for frame in found[:3] + found[6:])
    alone = explainer.explain(frames[4])
    assert abs(alone.camera.cx - expected[4]) > w  # by itself this frame shows the other pot


def test_an_object_that_is_hidden_at_first_is_awaited_in_its_box(
    video: Video, explainer: vig.Explainer
) -> None:
    hidden = np.full((150, 150, 3), (40, 90, 60), np.uint8)
    x, y, w, h = video.box
    follower = Follower(explainer)
    follower.explain(hidden, video.box)
    assert follower.place is not None and follower.albedo is None
    assert follower.place.tolist() == [x + w / 2, y + h / 2, math.log(max(w, h))]
    assert not follower.explain(video.frames[0])[1].lost


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([], "two or more frames of a video; got none"),
        (iter([]), "got none"),
        (np.zeros((50, 50, 3), np.uint8), "got one"),
        (np.zeros((1, 50, 50, 3), np.uint8), "got one"),
        ("video.mp4", "got one"),
        (12, "expected the frames of a video; got 12"),
    ],
)
def test_too_few_frames_are_refused(frames: Any, words: str, explainer: vig.Explainer) -> None:
    with pytest.raises(UserError, match=words):
        vig.track(frames, explainer)


def test_frames_are_taken_from_an_iterator_or_an_array_as_from_a_list(
    video: Video, explainer: vig.Explainer
) -> None:
    several = video.frames[:2]
    tracks = [vig.track(given, explainer, video.box) for given in (several, iter(several), np.stack(several))]
    azimuths = [[frame.azimuth_deg for frame in track.frames] for track in tracks]
    assert len(azimuths[0]) == 2 and azimuths.count(azimuths[0]) == len(tracks)


@pytest.mark.parametrize(
    ("box", "remedy"),
    [(None, "Give its box"), ((10, 10, 40, 40), r"Check that the box \(10, 10, 40, 40\) is round it")],
)
def test_frames_without_the_object_are_refused(
    box: Box | None, remedy: str, explainer: vig.Explainer
) -> None:
    grey = np.full((60, 60, 3), 120, np.uint8)
    with pytest.raises(UserError, match=f"a teapot in the frames; found none. {remedy}"):
        vig.track([grey, grey], explainer, box)
    with pytest.raises(UserError, match="frames of one size, 60 x 60; got 50 x 60 in frame 1"):
        vig.track([grey, grey[:, :50]], explainer, box)


def test_a_camera_that_is_given_is_that_of_the_poses(video: Video, explainer: vig.Explainer) -> None:
    aside = np.array([[300.0, 0, -150], [0, 320.0, 60], [0, 0, 1]])
    found = vig.track(video.frames[:2], explainer, video.box, K=aside).frames
    fitted = explainer.explain(video.frames[0], video.box, K=aside).camera_from_object
    for frame in found:
        assert np.array_equal(frame.camera.K, aside)
        assert np.abs(frame.camera_from_object[:3, 3] - fitted[:3, 3]).max() < 0.1 * fitted[2, 3]
    assert found[0].camera_from_object[0, 3] > 0.4 * fitted[2, 3]
