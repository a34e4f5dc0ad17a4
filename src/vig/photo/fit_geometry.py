"""The object's pose before the camera that took a photo, from a fit in a window of it."""

from dataclasses import dataclass, replace

import numpy as np

from vig.photo.pinhole import fit_pose, outline_weights, pose_covariance, project, turned_pose
from vig.photo.window import Window
from vig.scene import Camera, Latents, ObjectClass


@dataclass(frozen=True)
class FitGeometry:
    """A fit's camera and the photo's.

    Attributes:
        object_class: Class of the object.
        window: Part of the photo that was fitted.
        camera_distance_ratio: Ratio of the fit, see `ExplainSettings`.
        size: Width and height of the photo, pixels.
    """

    object_class: ObjectClass
    window: Window
    camera_distance_ratio: float
    size: tuple[int, int]

    def window_camera(self, framing: np.ndarray) -> Camera:
        """Return the fit's camera, which looks straight at the object, in pixels of the window."""
        return self.object_class.camera(camera_distance_ratio=self.camera_distance_ratio).apply_framing(
            *framing.tolist()
        )

    def pose_before(self, matrix: np.ndarray, latents: Latents, framing: np.ndarray) -> np.ndarray:
        """Return pose (4, 4) before a camera with intrinsics (3, 3) that sees the object where the fit does.

        That camera took the photo; the pose is the one that projects vertices nearest to their places by the
        fit's camera, those of the outline above all.
        """
        window = self.window_camera(framing)
        fitted = window.camera_from_object(latents)
        model = self.object_class.shape_model
        vertices = model.vertices(latents.shape)[0].astype(np.float64)
        in_pixels = project(window.K, fitted, vertices)[:, :2]
        offsets = (in_pixels - window.width / 2) * self.window.side / window.width
        pixels = np.stack(self.window.to_photo(*offsets.T), axis=1)
        eye = -fitted[:3, :3].T @ fitted[:3, 3]
        start = self._nearly(matrix, latents, framing)
        return fit_pose(matrix, pixels, vertices, outline_weights(vertices, model.faces, eye), start)

    def _nearly(self, matrix: np.ndarray, latents: Latents, framing: np.ndarray) -> np.ndarray:
        """Approximate `pose_before` in closed form."""
        window = self.window_camera(framing)
        if self.window.focal is None:
            camera = self.window.camera(window, *self.size)
            return turned_pose(camera, camera.camera_from_object(latents), matrix)
        scale, middle = self.window.side / window.width, window.width / 2
        camera = replace(
            window,
            focal=window.focal * scale,
            cx=(window.cx - middle) * scale,
            cy=(window.cy - middle) * scale,
        )
        straight = np.diag([self.window.focal, self.window.focal, 1.0])
        undone = np.eye(4)
        undone[:3, :3] = self.window.turn.T
        return np.asarray(undone @ turned_pose(camera, camera.camera_from_object(latents), straight))

    def covariance(
        self, matrix: np.ndarray, latents: Latents, framing: np.ndarray, deviation: np.ndarray
    ) -> np.ndarray:
        """Return covariance (6, 6) of that pose from deviations (6,) of azimuth, elevation and framing.

        x, y, z in metres, then turns about these axes in radians; to first order, by differences.
        """
        at = np.concatenate([latents.azimuth, latents.elevation, framing]).astype(np.float64)

        def locate(at: np.ndarray) -> np.ndarray:
            angles = {"azimuth": at[:1], "elevation": at[1:2]}
            return self._nearly(matrix, replace(latents, **angles), at[2:])

        return pose_covariance(locate, at, deviation.astype(np.float64))
