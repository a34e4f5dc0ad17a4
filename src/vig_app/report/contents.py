"""report.html: one file that shows an explanation in a browser, without a server or the network."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image

from vig.explanation import Explanation
from vig.photo.images import as_srgb
from vig.photo.outline import FINER, REACH, line_width
from vig.scene.light import srgb8_from_linear
from vig_app.pictures import LABEL, PANEL, others_in_window, panels, part_albedo
from vig_app.report import words
from vig_app.report.drawing import Pose, clip_matrix, mesh_data, pose_data, steps_of, views_of
from vig_app.report.html import fill_template, png_url

PAGE_SIDE = 768  # pixels of the longer side of a page's photo
COARSER = 2  # factor by which the distances to the outlines have fewer points a side on a page


def report(explanation: Explanation, photo: str) -> str:
    """Return the page of `Explanation.report`."""
    return page_of(explanation, photo, explanation.to_dict(), page_photo(as_srgb(explanation.picture)))


def page_of(explanation: Explanation, photo: str, described: dict[str, Any], reduced: np.ndarray) -> str:
    """Return HTML of an explanation's page.

    Args:
        explanation: Explanation to show.
        photo: Name of the photo in the page.
        described: Content of explanation.json.
        reduced: Its `page_photo`.
    """
    part_names = explanation.object_class.shape_model.part_names
    levels = srgb8_from_linear(part_albedo(explanation))
    views, steps = views_of(explanation), list(steps_of(explanation))
    data = drawing_data(explanation, views, steps, reduced.shape[1], reduced.shape[0])
    return fill_template(
        "page.html",
        name=photo,
        described=described,
        words=words,
        photo=reduced,
        outlines=data.pop("outlines"),
        panels=panels(explanation),
        colours=[
            (name, f"rgb({red}, {green}, {blue})")
            for name, (red, green, blue) in zip(part_names, levels.tolist(), strict=True)
        ],
        views=[view.words for view in views],
        data=data,
    )


def drawing_data(
    explanation: Explanation, views: Sequence[Pose], steps: Sequence[Pose], width: int, height: int
) -> dict[str, Any]:
    """Return data for templates/drawing.js: an object's poses and outlines on a photo of width x height."""
    poses = pose_data(explanation, [*views, *steps])
    window, size = explanation.window, len(explanation.outlines[0]) // COARSER
    across, down = width / explanation.picture.shape[1], height / explanation.picture.shape[0]
    to_map = np.array([[size / window.side, 0, size / 2], [0, size / window.side, size / 2], [0, 0, 1]])
    matrix = to_map @ np.linalg.inv(window.photo_from_window) @ np.diag([1 / across, 1 / down, 1])
    return {
        "mesh": mesh_data(explanation),
        "views": poses[: len(views)],
        "steps": poses[len(views) :],
        "clip": clip_matrix(explanation.camera, explanation.camera_from_object, explanation.vertices),
        "window": [0, LABEL, PANEL, PANEL],
        "outline": {
            "map": (matrix / matrix[2, 2]).tolist(),
            "size": size,
            "step": REACH / 127 * window.side * FINER / len(explanation.outlines[0]) * across,
            "line": line_width(height, width),
        },
        "outlines": png_url(_outline_maps(explanation)),
    }


def page_photo(photo: np.ndarray) -> np.ndarray:
    """Return a photo (H, W, 3) uint8 as the page shows it, `PAGE_SIDE` pixels at most."""
    height, width = photo.shape[:2]
    scale = min(1.0, PAGE_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if scale == 1:
        return photo
    return np.asarray(Image.fromarray(photo).resize(size, Image.Resampling.HAMMING))


def _outline_maps(explanation: Explanation) -> np.ndarray:
    """Return distances to the outlines of covered and of visible pixels, one above the other, (2 S, S) uint8.

    128 is on the outline and 1 to 255 are within `REACH` pixels of the fitted window, inside and outside.
    """
    size = len(explanation.outlines[0]) // COARSER
    maps = np.stack([(each[::2, ::2] + each[1::2, 1::2]) / 2 for each in explanation.outlines])
    if explanation.others is not None:  # seen there is something else
        maps[1] = np.where(others_in_window(explanation, size) > 0.5, np.maximum(maps[1], 1.0), maps[1])
    levels: np.ndarray = (128 + maps * (127 / REACH)).round().astype(np.uint8)
    return levels.reshape(2 * size, size)
