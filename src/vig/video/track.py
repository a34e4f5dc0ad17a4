"""The frames of a video explained together: one object that moves and turns smoothly."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, Photo, lens_of
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference.settings import UNIFORM_TURN
from vig.io.errors import UserError
from vig.scene import Camera, ObjectClass
from vig.scene.functions import numpy_of_tensor
from vig.video.following import Follower, Sighting
from vig.video.tracker import TrackedPose, Tracker
from vig.video.trajectory import FramePose, Trajectory, camera_before, views_of
from vig_renderer.defaults import with_default_settings

ALIKE = 2.0, 3.0
"""Factors of the smoothed deviations of azimuth and elevation, as neighbouring frames err alike: so that 90 %
intervals held on videos of the validation split."""


@dataclass(frozen=True)
class TrackedFrame(FramePose):
    """A frame's pose by the whole video: smoothed numbers; the focal length is the same in all frames.

    Attributes:
        alone_azimuth_deg: Azimuth of the frame's own fit.
        alone_elevation_deg: Elevation of the frame's own fit.
        refitted: Whether its neighbours gave another view or place, so that it was fitted again.
    """

    alone_azimuth_deg: float
    alone_elevation_deg: float
    refitted: bool


@dataclass(frozen=True)
class Track:
    """A video's explanation of its object.

    Attributes:
        frames: Poses of all frames.
        shape: (K,) coefficients, the mean of the frames', weighted by visible share and confidence.
        albedo: (3,) linear RGB, the same mean.
    """

    frames: tuple[TrackedFrame, ...]
    shape: np.ndarray
    albedo: np.ndarray


def _list_frames(frames: Iterable[Photo]) -> Sequence[Photo]:
    """Return frames as a sequence; UserError where there are fewer than two, or something else."""
    frames = numpy_of_tensor(frames)
    one = isinstance(frames, Photo) and not (getattr(frames, "ndim", None) == 4)
    if not one and not isinstance(frames, Iterable):
        raise UserError(f"expected the frames of a video; got {str(frames)[:60]}. Pass a list of them.")
    listed: Sequence[Any] = [frames] if one else frames if isinstance(frames, Sequence) else list(frames)
    if len(listed) < 2:
        raise UserError(
            f"expected two or more frames of a video; got {'one' if listed else 'none'}. Explain one as a"
            " photo, and pass a list of the frames of a folder or video."
        )
    return listed


@with_default_settings
def track(
    frames: Iterable[Photo],
    explainer: Explainer | str | Path | ObjectClass,
    box: Box | None = None,
    focal: float | None = None,
    hints: Hints | None = None,
    on_frame: Callable[[int, Explanation], None] | None = None,
    K: Any = None,
) -> Track:
    """Explain the frames of a video as one object that moves and turns smoothly.

    Each frame is explained where the object is expected; things elsewhere, of another size or colour are not
    the object. Its view and the others that fit are then chosen together for all frames, frames that had
    chosen otherwise are fitted again, and angles and place are smoothed. A mesh with colours is followed by
    its surface as by `Tracker`, and back to the first frame from the one in which it is found.

    Args:
        frames: Two or more of one size, in order. Those of a list are read one at a time, some of them twice;
            an iterator is exhausted first, and an array (T, H, W, 3) is T frames.
        explainer: Explainer of the object's class, or the class, as `Explainer` takes it.
        box: x, y, width, height in pixels round the whole object in the first frame; else it is sought.
        focal: Focal length in pixels of all frames; see `Explainer.explain`.
        hints: Prior knowledge in all frames.
        on_frame: Called with the number and the explanation of each frame, and of those fitted again.
        K: Intrinsics of all frames in place of a focal length, see `Explainer.explain`; poses are then
            in the frame of this camera.

    Raises:
        UserError: There are fewer than two frames, one cannot be read or is of another size, the object is
            seen in none; see also `Explainer.explain`.
    """
    frames = _list_frames(frames)
    if not isinstance(explainer, Explainer):
        explainer = Explainer(explainer)
    if explainer.known is not None and explainer.known.is_followed(hints or Hints()):
        known = lens_of(frames[0], focal, K)
        return _track_known(frames, explainer, box, None if known is None else known[0], hints, on_frame)
    follower = Follower(explainer, focal, hints, K)
    alone: list[Sighting] = []
    for number, frame in enumerate(frames):
        explanation, sighting = follower.explain(frame, box if number == 0 else None)
        size, first = (
            (each.camera.width, each.camera.height) for each in (sighting, alone[0] if alone else sighting)
        )
        if size != first:
            name = f"{number}, '{frame}'" if isinstance(frame, str | Path) else str(number)
            raise UserError(
                f"expected frames of one size, {first[0]} x {first[1]}; got {size[0]} x {size[1]} in frame"
                f" {name}. Track one video at a time."
            )
        alone.append(sighting)
        if on_frame is not None:
            on_frame(number, explanation)
    _check_seen(alone, explainer, box)
    fold = max(explainer.object_class.symmetry.fold, 1)
    path = views_of(alone, fold)
    trajectory, again = Trajectory.of(alone, path, fold), list(alone)
    for number, sighting in enumerate(alone):
        if trajectory.contradicts(number, sighting, fold):
            window, frame_hints = trajectory.expected_window(number, hints)
            explanation = explainer.explain_frame(frames[number], window, focal, frame_hints, K)
            again[number] = Sighting.of(explanation)
            if on_frame is not None:
                on_frame(number, explanation)
    _check_seen(again, explainer, box)
    weight = [0.0 if each.lost else each.visible_share**2 * each.probabilities[0] for each in alone]
    shape, albedo = (
        np.average([getattr(each, name) for each in alone], axis=0, weights=np.array(weight) + 1e-9)
        for name in ("shape", "albedo")
    )
    lens = alone[0].window.lens  # None but where a camera is given
    smooth, matrix = Trajectory.of(again, path, fold), None if lens is None else lens.K
    return Track(tuple(_frames(alone, again, smooth, fold, matrix)), shape, albedo)


def _track_known(
    frames: Sequence[Photo],
    explainer: Explainer,
    box: Box | None,
    K: Any,
    hints: Hints | None,
    on_frame: Callable[[int, Explanation], None] | None,
) -> Track:
    """Return the track of a known object, from the frame in which it is given or found, both ways."""
    poses: dict[int, TrackedPose] = {}

    def take(number: int, pose: TrackedPose) -> None:
        poses[number] = replace(pose, number=number)
        if on_frame is not None:
            on_frame(number, pose.explanation)

    forth = Tracker(explainer, K)
    for number, frame in enumerate(frames):
        if poses:
            take(number, forth.step(frame))
        elif (pose := forth.start(frame, box=box, hints=hints)) is not None:
            take(number, pose)
    _check_seen(poses.values(), explainer, box)
    if first := min(poses):
        back = Tracker(explainer, K)
        back.start(frames[first], box=box, hints=hints)
        for number in reversed(range(first)):
            take(number, back.step(frames[number]))
    tracked = [
        TrackedFrame(
            **{field.name: getattr(pose, field.name) for field in fields(FramePose)},
            alone_azimuth_deg=pose.azimuth_deg,
            alone_elevation_deg=pose.elevation_deg,
            refitted=False,
        )
        for _, pose in sorted(poses.items())
    ]
    seen = [pose.explanation.fit.latents for pose in poses.values() if not pose.lost]
    return Track(tuple(tracked), seen[0].shape[0], np.mean([each.albedo[0] for each in seen], axis=0))


def _check_seen(sightings: Iterable[Sighting | TrackedPose], explainer: Explainer, box: Box | None) -> None:
    """Raise UserError where the object is lost in all frames, or seen in none."""
    if all(sighting.lost for sighting in sightings):
        given = "Give its box" if box is None else f"Check that the box {tuple(box)} is round it"
        raise UserError(
            f"expected a {explainer.object_class.name} in the frames; found none. {given} in the first frame."
        )


def _frames(
    alone: Sequence[Sighting],
    again: Sequence[Sighting],
    trajectory: Trajectory,
    fold: int,
    matrix: np.ndarray | None,
) -> list[TrackedFrame]:
    """Return a pose for each frame; matrix: K (3, 3) of the camera that took them, where it is known."""
    focal = float(np.median([each.camera.focal for each in again if not each.lost]))
    azimuth, elevation = np.degrees(trajectory.azimuth), np.degrees(trajectory.elevation)
    cx, cy, scale, roll = trajectory.numbers[0, 2:6].tolist()

    def camera_of(number: int, straight: Camera) -> Camera:
        if matrix is not None:
            size, height = (straight.width, straight.height), straight.target_height
            return camera_before(matrix, size, height, trajectory.numbers[0, :6, number])[0]
        return replace(
            straight,
            focal=focal,
            cx=cx[number],
            cy=cy[number],
            distance=focal / math.exp(scale[number]),
            roll=roll[number],
        )

    return [
        TrackedFrame(
            number=number,
            azimuth_deg=float(azimuth[0, number]) % (360 / fold),
            azimuth_deviation_deg=min(
                ALIKE[0] * float(azimuth[1, number]), math.degrees(UNIFORM_TURN) / fold
            ),
            elevation_deg=float(elevation[0, number]),
            elevation_deviation_deg=ALIKE[1] * float(elevation[1, number]),
            alone_azimuth_deg=math.degrees(first.azimuths[0]),
            alone_elevation_deg=math.degrees(first.elevation),
            camera=camera_of(number, second.camera),
            hidden_fraction=second.hidden,
            lost=first.lost or second.lost,
            refitted=second is not first,
        )
        for number, (first, second) in enumerate(zip(alone, again, strict=True))
    ]
