"""The answer for several objects of one photo, and its files."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.inference import Verdict
from vig.outputs import output
from vig.scene import rotate_z
from vig_renderer.defaults import with_default_settings


@with_default_settings
@dataclass(frozen=True, eq=False)
class SceneExplanation:
    """Explanations of several objects in one photo of H x W pixels.

    Attributes:
        objects: N of them, in the order in which they were given; their masks exclude each other.
        occludes: (N, N) bool, whether object i hides, or may hide, some of object j.
    """

    objects: tuple[Explanation, ...]
    occludes: np.ndarray

    @cached_property
    def masks(self) -> np.ndarray:
        """Return (N, H, W) bool, the pixels in which each is seen, of which each pixel has one at most."""
        return np.stack([each.mask for each in self.objects])

    @cached_property
    def light(self) -> np.ndarray:
        """Return (9,) SH of incident radiance in the heading frame of the camera, the mean of the
        objects'.
        """
        shown = [self.objects[number] for number in self.shown] or self.objects
        return np.asarray(np.mean([heading_light(each) for each in shown], axis=0))

    @property
    def shown(self) -> list[int]:
        """Return numbers of the objects that are not absent."""
        return [n for n, each in enumerate(self.objects) if each.verdict is not Verdict.ABSENT]

    @cached_property
    def poses(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each object K (3, 3) and camera_from_object (4, 4), metres, before the one camera
        that took the photo, its principal point in the middle; see `Explanation.pinhole_pose`.
        """
        return [each.pinhole_pose()[:2] for each in self.objects]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the objects' names, `1-teapot`, `2-mug` and so on: its folder within that of the photo."""
        plain = (re.sub(r"[^\w.-]+", "_", each.object_class.name) for each in self.objects)
        return tuple(f"{number}-{name}" for number, name in enumerate(plain, 1))

    def overlay(self) -> np.ndarray:
        """Return the photo (H, W, 3) uint8, each object's visible pixels tinted in a colour of its own and
        its whole outline drawn in it.
        """
        return np.asarray(output("scene_overlay")(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `scene.json`."""
        height, width = self.objects[0].picture.shape[:2]
        return {
            "format": 1,
            "objects": list(self.names),
            "before": [
                [self.names[i], self.names[j]]
                for i, j in np.argwhere(self.occludes)
                if {i, j} <= {*self.shown}
            ],
            "light": self.light.tolist(),
            "camera": {"K": self.poses[0][0].tolist(), "width": width, "height": height,
                       "focal_from": self.objects[0].focal_from},
            "camera_from_object": {
                self.names[number]: self.poses[number][1].tolist() for number in self.shown
            },
        }  # fmt: skip

    def __repr__(self) -> str:
        height, width = self.objects[0].picture.shape[:2]
        return f"SceneExplanation({', '.join(self.names)} in {width} x {height}: {self.order_note})"

    def save(
        self,
        folder: str | Path,
        photo: str = "photo",
        export: Sequence[str] = (),
        files: Sequence[str] | None = None,
        full_size: bool = False,
    ) -> Path:
        """Write each object's results into a folder of its `names`, and their common files.

        Args:
            folder: Folder, made when it is missing; docs/photographs.md describes its files.
            photo: Name of the photo in the reports.
            export: Formats that are written of each object, too; see `Explanation.export`.
            files: Files to write for each object; see `Explanation.save`, as for full_size.
            full_size: Whether pictures are as large as the photo.

        Raises:
            UserError: The folder cannot be written, or there is no such file.
        """
        return Path(output("scene_save")(self, folder, photo, export, files, full_size))

    @property
    def order_note(self) -> str:
        """Return the order of the objects in depth, in words."""
        pairs = [f"{self.names[i]} is before {self.names[j]}" for i, j in np.argwhere(self.occludes)]
        return ", ".join(pairs) or "none hides another"


def heading_light(each: Explanation) -> np.ndarray:
    """Return light (9,) in the frame that turns along with the camera."""
    return np.asarray(rotate_z(each.latents.light[0], -each.latents.azimuth[0]))
