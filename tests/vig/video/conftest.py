"""Frames of a turning teapot, small and with known views."""

from dataclasses import dataclass

import numpy as np
import pytest

import vig
from benchmarks.turning import draw_turning
from vig_world.library import Library
from vig_world.renderers.rasterized import render


@dataclass(frozen=True)
class Video:
    """Frames (H, W, 3) uint8, azimuths (T,) in degrees, shares hidden (T,), box in the first frame."""

    frames: list[np.ndarray]
    azimuths: np.ndarray
    hidden: np.ndarray
    box: tuple[float, float, float, float]


@pytest.fixture(scope="session")
def video(explainer: vig.Explainer) -> Video:
    """Twelve frames of a video in which another object passes before the pot, and hides it wholly in one."""
    return video_of(explainer, slice(None, None, 3), 4)


@pytest.fixture(scope="session")
def quick_video(explainer: vig.Explainer) -> Video:
    """Ten frames of another, in which the pot turns by some 10 degrees a frame, a third to a half hidden."""
    return video_of(explainer, slice(10), 20)


def video_of(explainer: vig.Explainer, chosen: slice, number: int) -> Video:
    """Some of the 36 frames of a video."""
    library = Library("validation")
    turning = draw_turning(library, explainer.object_class, 3, number)
    scenes = list(turning.frames(36))[chosen]
    pictures = [render(library, scene, explainer.object_class) for scene in scenes]
    rows, columns = np.nonzero(pictures[0].amodal)
    corner = float(columns.min()), float(rows.min())
    return Video(
        [picture.image for picture in pictures],
        np.degrees([scene.azimuth for scene in scenes]),
        np.array([picture.occlusion for picture in pictures]),
        (*corner, float(np.ptp(columns) + 1), float(np.ptp(rows) + 1)),
    )
