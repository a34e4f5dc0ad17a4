"""Videos of a turning pot with something passing before it: each frame explained alone, and tracked.

    python -m benchmarks.tracking [--videos 12] [--frames 48] [--split test] [--seed 7]

The generator makes the frames (`benchmarks.turning`). Alone, the pot is sought in every frame; to
track it, in the first. `followed` is the frames' own fits where the track expects the pot; `causal` is what
`vig.Tracker` says of each frame from those before it. A jump is by how much the error of azimuth changes from
one frame to the next; of each video the worst counts. Steps of the tracker are timed on frames of 640 x 480
in which the pictures are shown three times as large.
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from benchmarks.measuring import metric, report, write
from benchmarks.turning import Turning, draw_turning
from vig import Explainer, Explanation, TrackedPose, Tracker, track
from vig.parallel import thread_count
from vig.photo.images import write_png
from vig.photo.masks import box_of
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.picture import Picture
from vig_world.raster.view import View
from vig_world.renderers.rasterized import render

WAYS = ("alone", "followed", "tracked", "causal")
FRAME = 480, 640
"""Height and width of the frames in which steps are timed."""
WITHIN_90 = 1.6449
"""Standard deviations on either side of 90 % of a Gaussian."""
MUCH = 0.5
"""Share hidden of the frames that are also counted apart."""


@dataclass(frozen=True)
class Errors:
    """Of the T frames of a video: the share hidden (T,), and by way azimuth (T,), signed, and elevation (T,),
    degrees, and the IoU (T,) of the mask of visible pixels. Of the tracker the errors of its poses (T, 8) in
    standard deviations: azimuth, elevation, place; turns; and its steps' milliseconds (T - 1,).
    """

    hidden: np.ndarray
    azimuth: dict[str, np.ndarray]
    elevation: dict[str, np.ndarray]
    iou: dict[str, np.ndarray]
    standard: np.ndarray
    step_ms: np.ndarray

    def jump(self, way: str) -> float:
        """The worst, degrees."""
        return float(np.abs(wrapped(np.diff(self.azimuth[way]))).max())


def measure(video: Turning, library: Library, explainer: Explainer, count: int, show: Path | None) -> Errors:
    """Errors of one video; `show`: where its frames are drawn side by side."""
    scenes = list(video.frames(count))
    pictures = [render(library, scene, explainer.object_class) for scene in scenes]
    if show is not None:
        every = max(1, count // 12)
        write_png(show, np.concatenate([picture.image for picture in pictures[::every]], axis=1))
    iou: dict[str, np.ndarray] = {way: np.zeros(count) for way in WAYS}
    alone = []
    for number, picture in enumerate(pictures):
        alone.append(explainer.explain(picture.image))
        iou["alone"][number] = overlap(alone[-1], picture)
    first: set[int] = set()

    def seen(number: int, found: Explanation) -> None:
        iou["tracked"][number] = overlap(found, pictures[number])
        if number not in first:
            iou["followed"][number] = iou["tracked"][number]
        first.add(number)

    frames = track([picture.image for picture in pictures], explainer, on_frame=seen).frames
    poses, standard = tracked_poses(pictures, scenes, explainer)
    iou["causal"] = np.array([overlap(*pair) for pair in zip(poses, pictures, strict=True)])
    azimuths = {
        "alone": [each.azimuth_deg for each in alone],
        "followed": [frame.alone_azimuth_deg for frame in frames],
        "tracked": [frame.azimuth_deg for frame in frames],
        "causal": [pose.azimuth_deg for pose in poses],
    }
    elevations = {
        "alone": [each.elevation_deg for each in alone],
        "followed": [frame.alone_elevation_deg for frame in frames],
        "tracked": [frame.elevation_deg for frame in frames],
        "causal": [pose.elevation_deg for pose in poses],
    }
    truth = np.degrees([scene.azimuth for scene in scenes])
    elevation = math.degrees(video.scene.elevation)
    return Errors(
        np.array([picture.occlusion for picture in pictures]),
        {way: wrapped(np.array(azimuths[way]) - truth) for way in WAYS},
        {way: np.abs(np.array(elevations[way]) - elevation) for way in WAYS},
        iou,
        standard,
        1000 * np.array(step_seconds(pictures, explainer)),
    )


def tracked_poses(
    pictures: list[Picture], scenes: list[SceneSpec], explainer: Explainer
) -> tuple[list[TrackedPose], np.ndarray]:
    """The tracker's poses, whose camera is known, and their errors (T, 8) in standard deviations."""
    views = [View.of_scene(scene, explainer.object_class) for scene in scenes]
    x, y, w, h = box_of(pictures[0].amodal) or (0, 0, 1, 1)
    tracker = Tracker(explainer, K=views[0].camera.K)
    poses = [tracker(pictures[0].image) or tracker.start(pictures[0].image, box=(x, y, w, h))]
    poses += [tracker.step(picture.image) for picture in pictures[1:]]
    found, errors = [pose for pose in poses if pose is not None], []
    for pose, view, scene in zip(found, views, scenes, strict=True):
        matrix = pose.camera_from_object
        turn = Rotation.from_matrix(matrix[:3, :3] @ view.rotation.T).as_rotvec()
        angles = [
            float(wrapped(np.array(pose.azimuth_deg - math.degrees(scene.azimuth))))
            / pose.azimuth_deviation_deg,
            (pose.elevation_deg - math.degrees(scene.elevation)) / pose.elevation_deviation_deg,
        ]
        off = np.concatenate([matrix[:3, 3] - view.translation, turn])
        errors.append([*angles, *(off / np.sqrt(np.diag(pose.covariance)))])
    return found, np.array(errors)


def step_seconds(pictures: list[Picture], explainer: Explainer) -> list[float]:
    """Of the tracker's steps on frames of `FRAME`, poses included."""
    frames = []
    for picture in pictures:
        large = np.full((*FRAME, 3), 127, np.uint8)
        shown = np.asarray(Image.fromarray(picture.image).resize((450, 450), Image.Resampling.BICUBIC))
        large[15:465, 95:545] = shown
        frames.append(large)
    tracker = Tracker(explainer)
    x, y, w, h = box_of(pictures[0].amodal) or (0, 0, 150, 150)
    tracker.start(frames[0], box=(95 + 3 * x, 15 + 3 * y, 3 * w, 3 * h))
    return [tracker.step(frame).seconds for frame in frames[1:]]


def overlap(found: Explanation | TrackedPose, picture: Picture) -> float:
    """Intersection over union of the visible pixels, 1 where there are none in either."""
    either = int((found.mask | picture.visible).sum())
    return int((found.mask & picture.visible).sum()) / either if either else 1.0


def wrapped(degrees: np.ndarray) -> np.ndarray:
    """Differences of angles in [-180, 180)."""
    return (degrees + 180) % 360 - 180


def table(found: list[Errors]) -> list[dict[str, Any]]:
    """Metrics of all videos, printed as a table."""
    hidden, metrics = np.concatenate([each.hidden for each in found]), []
    print(
        "          azimuth error, degrees            elevation    IoU of    worst jump, degrees\n"
        "          median  within 15  within 30      median      masks     median  most  above 90"
    )
    for title, chosen in (("all frames", hidden >= 0), (f"hidden > {MUCH:.0%}", hidden > MUCH)):
        print(f"{title}: {chosen.sum()}")
        for way in WAYS:
            azimuth = np.abs(np.concatenate([each.azimuth[way] for each in found]))[chosen]
            elevation = np.concatenate([each.elevation[way] for each in found])[chosen]
            iou = np.concatenate([each.iou[way] for each in found])[chosen]
            jumps = np.array([each.jump(way) for each in found])
            line = (
                f"{way:9s} {np.median(azimuth):6.1f}  {(azimuth < 15).mean():9.1%}"
                f"  {(azimuth < 30).mean():9.1%}"
                f"   {np.median(elevation):9.1f}    {np.median(iou):7.3f}"
            )
            everything = len(azimuth) == len(hidden)
            if everything:
                line += (
                    f"   {np.median(jumps):9.1f}  {jumps.max():4.0f}  {(jumps > 90).sum()} of {len(jumps)}"
                )
                metrics.append(metric(f"{way}_worst_jump_deg", jumps, "degrees"))
            print(line)
            if way == "causal" and everything:
                metrics += of_tracker(found)
            name = way if everything else f"{way}_hidden"
            metrics += [
                metric(f"{name}_azimuth_deg", azimuth, "degrees"),
                metric(f"{name}_within_15", [100 * (azimuth < 15).mean()], "%", "higher"),
                metric(f"{name}_elevation_deg", elevation, "degrees"),
                metric(f"{name}_iou", iou, "", "higher"),
            ]
    return metrics


def of_tracker(found: list[Errors]) -> list[dict[str, Any]]:
    """Metrics of a tracker's intervals and time, printed."""
    within = (np.abs(np.concatenate([each.standard for each in found])) < WITHIN_90).mean(0)
    names = ("azimuth", "elevation", "x", "y", "z", "turn x", "turn y", "turn z")
    print("  90 % intervals hold: " + ", ".join(f"{n} {w:.0%}" for n, w in zip(names, within, strict=True)))
    steps = np.concatenate([each.step_ms for each in found])
    print(f"  a step takes {np.median(steps):.0f} ms (90th percentile {np.percentile(steps, 90):.0f})")
    holds = [metric(f"causal_holds_{n.replace(' ', '_')}", [100 * w], "%", "higher")
             for n, w in zip(names, within, strict=True)]  # fmt: skip
    return [*holds, metric("causal_step_ms", steps, "ms")]


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--videos", type=int, default=12)
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--split", choices=("train", "test", "validation"), default="test")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--show", type=Path, help="folder for the videos' frames, side by side")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.videos < 1 or arguments.frames < 2:
        parser.error("expected 1 or more videos of 2 or more frames")
    library, explainer, found = Library(arguments.split), Explainer("teapot"), []
    for number in range(arguments.videos):
        video = draw_turning(library, explainer.object_class, arguments.seed, number)
        show = None if arguments.show is None else arguments.show / f"{number}.png"
        found.append(measure(video, library, explainer, arguments.frames, show))
        words = ", ".join(
            f"{way} {np.median(np.abs(found[-1].azimuth[way])):.1f} (worst jump {found[-1].jump(way):.0f})"
            for way in WAYS
        )
        print(f"video {number}, median azimuth error in degrees: {words}", flush=True)
    metrics = table(found)
    if arguments.json:
        write(report(metrics, threads=thread_count()), arguments.json)


if __name__ == "__main__":
    main()
