"""object.glb of an explanation, and scene.glb of several objects of one photo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.record import glb_from_object
from vig.scene import Camera
from vig.several.scene import SceneExplanation
from vig_app.glb.bake import Texture
from vig_app.glb.write import GlbObject, write_glb
from vig_app.pictures import part_albedo

MOST_SCALED = 1.5
"""Greatest scale of an object of a scene, so that it stands on the ground of the others."""


def write_object(path: Path, explanation: Explanation, texture: Texture | None) -> None:
    """Write an object as it was seen, and the camera that saw it.

    Stored positions are those of the object's own frame, so that `camera_from_object` applies to them; the
    node's matrix, `glb_from_object`, makes it upright in viewers.
    """
    node = glb_from_object(float(explanation.latents.azimuth[0]))
    name = explanation.object_class.name
    written = _object(explanation, name, node, texture)
    write_glb(path, [written], explanation.camera, node @ np.linalg.inv(explanation.camera_from_object))


def _object(
    explanation: Explanation,
    name: str,
    node: np.ndarray,
    texture: Texture | None,
    extras: dict[str, Any] | None = None,
) -> GlbObject:
    vertices, colours = explanation.vertices, part_albedo(explanation)
    return GlbObject(name, explanation.object_class, vertices, colours, node, texture, extras or {})


def write_scene(path: Path, scene: SceneExplanation, textures: Sequence[Texture | None]) -> None:
    """Write the objects of a photo on one ground, and the camera that took it, which all are seen by.

    The ground is y = 0. The photo gives size and distance of each object only as their ratio: each is moved
    along its sight until it stands there, and scaled along (`scale` of its node), which leaves the picture
    as it is; by `MOST_SCALED` at most, as something may stand on a shelf.
    """
    poses = [pose for _, pose in scene.poses]
    scales, world_from_camera = on_one_ground(poses)
    objects = []
    for name, each, pose, scale, texture in zip(
        scene.names, scene.objects, poses, scales, textures, strict=True
    ):
        node = world_from_camera @ np.diag([scale, scale, scale, 1.0]) @ pose
        objects.append(_object(each, name, node, texture, {"scale": scale}))
    height, width = scene.objects[0].picture.shape[:2]
    K = scene.poses[0][0]
    camera = Camera(width, height, K[0, 0], K[0, 2], K[1, 2], focal_y=K[1, 1])
    write_glb(path, objects, camera, world_from_camera)


def on_one_ground(poses: Sequence[np.ndarray]) -> tuple[list[float], np.ndarray]:
    """Return the scales with which objects before a camera stand on one ground without a change of the
    camera's picture.

    Args:
        poses: (4, 4) camera_from_object of each, metres; the object stands on its z = 0.

    Returns:
        Scale of each about the camera, about 1 in the mean, and world_from_camera (4, 4): Y up, the
        ground at y = 0, the camera above the origin and looking towards -Z.
    """
    up = np.mean([pose[:3, 2] for pose in poses], axis=0)
    up /= np.linalg.norm(up)
    heights = np.array([-up @ pose[:3, 3] for pose in poses])  # heights of the camera above the objects' feet
    # 0.05: height of the camera above an object's foot, over the distance, from which it shows where the
    # ground is
    above = heights > 0.05 * np.linalg.norm([pose[:3, 3] for pose in poses], axis=1)
    height = float(np.exp(np.log(heights[above]).mean())) if above.any() else float(heights.mean())
    scales = np.where(above, height / np.where(above, heights, 1.0), 1.0)
    scales = scales.clip(1 / MOST_SCALED, MOST_SCALED)
    back = np.array([0.0, 0.0, -1.0]) + up[2] * up
    if np.linalg.norm(back) < 1e-6:  # it looks straight down
        back = np.array([0.0, 1.0, 0.0]) - up[1] * up
    back /= np.linalg.norm(back)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.cross(up, back), up, back
    world_from_camera[1, 3] = height
    return scales.tolist(), world_from_camera
