"""Videos of a turning pot with something passing before it: each frame explained alone, and tracked.

    python -m benchmarks.tracking [--videos 12] [--frames 48] [--split test] [--seed 7]

The generator makes the frames (`vig_world.composition.turning`). Alone, the pot is sought in every frame; to
track it, in the first. `followed` is the frames' own fits where the track expects the pot. A jump is by how
much the error of azimuth changes from one frame to the next; of each video the worst counts.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.measuring import metric, report, write
from vig import Explainer, Explanation, track
from vig.photo.images import write_png
from vig_world.composition.turning import Turning, draw_turning
from vig_world.library import Library
from vig_world.raster.picture import Picture
from vig_world.renderers.rasterized import render

WAYS = ("alone", "followed", "tracked")
MUCH = 0.5
"""Share hidden of the frames that are also counted apart."""


@dataclass(frozen=True)
class Errors:
    """Of the T frames of a video: the share hidden (T,), and by way azimuth (T,), signed, and elevation (T,),
    degrees, and the IoU (T,) of the mask of visible pixels.
    """

    hidden: np.ndarray
    azimuth: dict[str, np.ndarray]
    elevation: dict[str, np.ndarray]
    iou: dict[str, np.ndarray]

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
    azimuths = {
        "alone": [each.azimuth_deg for each in alone],
        "followed": [frame.alone_azimuth_deg for frame in frames],
        "tracked": [frame.azimuth_deg for frame in frames],
    }
    elevations = {
        "alone": [each.elevation_deg for each in alone],
        "followed": [frame.alone_elevation_deg for frame in frames],
        "tracked": [frame.elevation_deg for frame in frames],
    }
    truth = np.degrees([scene.azimuth for scene in scenes])
    elevation = math.degrees(video.scene.elevation)
    return Errors(
        np.array([picture.occlusion for picture in pictures]),
        {way: wrapped(np.array(azimuths[way]) - truth) for way in WAYS},
        {way: np.abs(np.array(elevations[way]) - elevation) for way in WAYS},
        iou,
    )


def overlap(found: Explanation, picture: Picture) -> float:
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
            name = way if everything else f"{way}_hidden"
            metrics += [
                metric(f"{name}_azimuth_deg", azimuth, "degrees"),
                metric(f"{name}_within_15", [100 * (azimuth < 15).mean()], "%", "higher"),
                metric(f"{name}_elevation_deg", elevation, "degrees"),
                metric(f"{name}_iou", iou, "", "higher"),
            ]
    return metrics


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
        write(report(metrics, threads=torch.get_num_threads()), arguments.json)


if __name__ == "__main__":
    main()
