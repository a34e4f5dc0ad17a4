"""The library's answer for a photo."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vig.hints import Hints
from vig.inference import Fit, Verdict
from vig.io.errors import UserError
from vig.outputs import output
from vig.parallel import on_one_core
from vig.photo import Window, outline_distance
from vig.photo.fit_geometry import FitGeometry
from vig.photo.images import linear_photo, png_bytes
from vig.photo.masks import box_of
from vig.photo.outline import REACH, SMALLEST_PICTURE, line_reach
from vig.photo.pinhole import covariance_at, project, sight_axes
from vig.record import Hints as HintsRecord
from vig.record import camera_from_mesh, record
from vig.renderer.drawing import draw_latents
from vig.scene import Camera, Latents, ObjectClass, latent_layout
from vig.scene.camera import FOCAL_OVER_WIDTH
from vig.scene.functions import numpy_of_tensor
from vig_renderer.defaults import with_default_settings


@dataclass(frozen=True)
class Alternative:
    """Another view of the object that may be the right one.

    Attributes:
        latents: Pose, shape, albedo and light (B = 1).
        camera: Camera of the whole photo.
        probability: Probability that it is the right view; NaN for a class without calibration.
    """

    latents: Latents
    camera: Camera
    probability: float

    @property
    def azimuth_deg(self) -> float:
        """Return the view's azimuth, as `Explanation.azimuth_deg`."""
        return math.degrees(float(self.latents.azimuth[0])) % 360

    @property
    def elevation_deg(self) -> float:
        """Return the view's elevation, as `Explanation.elevation_deg`."""
        return math.degrees(float(self.latents.elevation[0]))

    @property
    def camera_from_object(self) -> np.ndarray:
        """Return the view's pose, as `Explanation.camera_from_object`."""
        return self.camera.camera_from_object(self.latents)


@with_default_settings
@dataclass(frozen=True, eq=False)
class Explanation:
    """An explanation of the object in one photo of H x W pixels.

    Attributes:
        picture: (H, W, 3) uint8 sRGB or float32 linear RGB; `photo` is linear in any case.
        window: The square of the photo that was fitted.
        fit: The fit in that window: latents, deviations, masks of the window, evidence.
        object_class: Class as which the photo was explained.
        camera_distance_ratio: Distance of the camera and focal length of the fit, of the standard camera's.
        focal_from: Source of the focal length: "given", the photo's "exif" data, or "assumed".
        hints: Prior knowledge of the object.
        others: (H, W) bool, pixels in which other objects are visible, where these were explained, too.
    """

    picture: np.ndarray
    window: Window
    fit: Fit
    object_class: ObjectClass
    camera_distance_ratio: float = 1.0
    focal_from: str = "assumed"
    hints: Hints | None = None
    others: np.ndarray | None = None

    @property
    def photo(self) -> np.ndarray:
        """Return the photo (H, W, 3) float32, linear RGB."""
        return linear_photo(self.picture)

    @property
    def verdict(self) -> Verdict:
        """Return the reliability of the explanation."""
        return self.fit.verdict

    @property
    def reason(self) -> str:
        """Return one sentence on the verdict."""
        return self.fit.reason

    @property
    def confidence(self) -> float:
        """Return the probability that the view is right, NaN for a class without calibration."""
        return self.fit.confidence

    @property
    def mask_confidence(self) -> float:
        """Return the probability that the mask's IoU is .8 or more, NaN for a class without calibration."""
        return self.fit.mask_confidence

    @property
    def present(self) -> float:
        """Return the probability that the photo shows the object at all; NaN where its place was given."""
        return self.fit.present

    @property
    def trusted(self) -> tuple[str, ...]:
        """Return the trusted parts of the answer: "view" where the verdict is "trusted", "mask" where its
        confidence reaches the threshold.

        The two are independent: even with the right view a textured occluder may be taken for the object, and
        a mask may be right with a wrong view.
        """
        view = ("view",) if self.verdict is Verdict.TRUSTED else ()
        return view + (("mask",) if self.fit.mask_trusted else ())

    @property
    def latents(self) -> Latents:
        """Return pose, shape, albedo and light (B = 1)."""
        return self.fit.latents

    @cached_property
    def alternatives(self) -> tuple[Alternative, ...]:
        """Return the other views that the search tried, two at most.

        Where one makes the verdict `AMBIGUOUS` it comes first.
        """
        return tuple(
            Alternative(view.latents, self._camera(view.latents, view.framing), view.probability)
            for view in self.fit.alternatives
        )

    @property
    def azimuth_deg(self) -> float:
        """Return the camera's azimuth about the object's vertical axis, degrees in [0, 360).

        Among views that look the same the smallest: in [0, 180) if half a turn does, 0 if any turn does.
        """
        return math.degrees(float(self.latents.azimuth[0])) % 360

    @property
    def elevation_deg(self) -> float:
        """Return the camera's elevation above the object's horizon, degrees."""
        return math.degrees(float(self.latents.elevation[0]))

    @property
    def roll_deg(self) -> float:
        """Return the photo's clockwise roll about the object, degrees."""
        return math.degrees(self.camera.roll)

    @cached_property
    def camera(self) -> Camera:
        """Return the camera of the whole photo; `camera.K` is its intrinsic matrix.

        A camera given to `Explainer.explain` is returned as it is. Else it looks straight at the
        object, as if the photo had been cut from a larger one about it (see `pinhole_pose`), and a focal
        length that the photo does not state is a guess; distance follows from it, as an object's size and
        distance are only known as their ratio.
        """
        return self._camera(self.latents, self.fit.framing)

    @property
    def window_camera(self) -> Camera:
        """Return the fit's camera, which looks straight at the object, in pixels of the window."""
        return self._geometry.window_camera(self.fit.framing)

    @cached_property
    def _geometry(self) -> FitGeometry:
        height, width = self.picture.shape[:2]
        return FitGeometry(self.object_class, self.window, self.camera_distance_ratio, (width, height))

    def _camera(self, latents: Latents, framing: np.ndarray) -> Camera:
        height, width = self.picture.shape[:2]
        window, lens = self._geometry.window_camera(framing), self.window.lens
        if lens is None:
            return self.window.camera(window, width, height)
        looks_at_it = window.camera_from_object(latents)
        pose = self._geometry.pose_before(lens.K, latents, framing)
        return replace(
            window,
            width=width,
            height=height,
            focal=lens.fx,
            focal_y=lens.fy,
            cx=lens.cx,
            cy=lens.cy,
            mount=tuple(map(tuple, (pose @ np.linalg.inv(looks_at_it)).tolist())),
            roll=window.roll,
        )

    @cached_property
    def camera_from_object(self) -> np.ndarray:
        """Return the pose (4, 4) float64, metres: OpenCV camera axes from the object's (Z up, +X `front`)."""
        return self.camera.camera_from_object(self.latents)

    @property
    def camera_from_mesh(self) -> np.ndarray | None:
        """Return the pose (4, 4) of the mesh, in the axes and units of its file, in the frame of the photo's
        camera (OpenCV axes); None for classes that are not of one mesh.
        """
        described = camera_from_mesh(self._pinhole[1], self.object_class)
        return np.array(described["camera_from_mesh"]) if described else None

    @property
    def camera_from_mesh_covariance(self) -> np.ndarray | None:
        """Return the covariance (6, 6) of `camera_from_mesh`: x, y, z of the mesh's origin in units of its
        file, then turns about the camera's axes in radians; None for other classes.
        """
        mesh, (_, pose, covariance) = self.camera_from_mesh, self.pinhole_pose()
        if mesh is None or self.object_class.object_from_mesh is None:
            return None
        unit = float(np.cbrt(np.linalg.det(self.object_class.object_from_mesh[:3, :3])))  # metres
        return covariance_at(covariance, unit * mesh[:3, 3] - pose[:3, 3], unit)

    @property
    def amodal(self) -> np.ndarray:
        """Return all pixels (H, W) bool that the object covers, hidden ones included."""
        return self._masks[0]

    @property
    def mask(self) -> np.ndarray:
        """Return the pixels (H, W) bool in which the object is visible."""
        return self._masks[1]

    @cached_property
    def _masks(self) -> tuple[np.ndarray, np.ndarray]:
        covered, visible = self.outlines
        amodal, seen = np.zeros((2, *self.picture.shape[:2]), bool)
        height, width = amodal.shape
        for tile in self.window.tiles(width, height, covered < covered.max()):
            amodal[tile] = self.window.paste(covered, *tile, outside=1.0) < 0
            seen[tile] = amodal[tile] & (self.window.paste(visible, *tile, outside=1.0) < 0)
        return amodal, seen if self.others is None else seen & ~self.others

    @cached_property
    def outlines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return distances to the outlines of the object's covered pixels and of its visible ones.

        See `outline_distance`; up to the lines' reach in pictures of `SMALLEST_PICTURE` pixels or more.
        """
        height, width = self.picture.shape[:2]
        scale = min(1.0, SMALLEST_PICTURE / max(height, width))
        pixel = len(self.fit.coverage) / (self.window.side * scale)
        outside, inside = (  # and half a pixel, as values between two points are drawn
            min(REACH, pixel * number + 0.5) for number in (line_reach(scale * height, scale * width), 1.0)
        )
        return (
            outline_distance(self.fit.coverage, outside, inside),
            outline_distance(self.fit.visible, inside, inside),
        )

    @cached_property
    def box(self) -> tuple[int, int, int, int] | None:
        """Return x, y, width, height in pixels of the object's covered pixels in the photo; None for none."""
        return box_of(self.amodal)

    @property
    def hidden_fraction(self) -> float | None:
        """Return the share of the object's pixels within the photo that are hidden; None if it has none."""
        covered = int(self.amodal.sum())
        return 1 - int(self.mask.sum()) / covered if covered else None

    @property
    def vertices(self) -> np.ndarray:
        """Return the object's vertices (V, 3) float32, metres, in its own frame; faces are the class's."""
        return self._vertices.copy()

    @cached_property
    def _vertices(self) -> np.ndarray:
        return np.asarray(self.object_class.shape_model.vertices(self.latents.shape)[0])

    @cached_property
    def points(self) -> dict[str, list[float]]:
        """Return x, y in pixels of the photo of each point that the class names, and 1 where seen, else 0.

        It is seen where the object is visible within a pixel of the window and no other part is nearer.
        """
        vertices, ids = self.vertices, [*self.object_class.points.values()]
        if not ids:
            return {}
        places = project(self.camera.K, self.camera_from_object, vertices[ids])[:, :2]
        seen_by = self.window_camera
        in_window = project(seen_by.K, seen_by.camera_from_object(self.latents), vertices[ids])
        depth = on_one_core(partial(draw_latents, self.latents, self.object_class, seen_by)).depth
        # 0.1: of the object's length, by which a point may lie within its part, such as behind a handle
        behind = in_window[:, 2] - 0.1 * np.ptp(vertices, axis=0).max()
        reach = math.ceil(self.window.side / len(depth))
        rows, columns = in_window[:, 1::-1].astype(int).clip(0, len(depth) - 1).T
        seen = depth[rows, columns] > behind
        for number, (x, y) in enumerate(places.astype(int).tolist()):
            near = [slice(max(at - reach, 0), max(at + reach + 1, 0)) for at in (y, x)]
            seen[number] &= bool(self.mask[near[0], near[1]].any())
        found = np.c_[places, seen].round(2).tolist()
        return dict(zip(self.object_class.points, found, strict=True))

    def render(
        self,
        light: np.ndarray | None = None,
        albedo: np.ndarray | None = None,
        camera: Camera | None = None,
        azimuth_deg: float | None = None,
        elevation_deg: float | None = None,
    ) -> np.ndarray:
        """Render the object on a transparent background: as in the photo, or relit, repainted, turned.

        Args:
            light: (9,) SH coefficients of incident radiance in the world frame.
            albedo: (3,) linear RGB in [0, 1].
            camera: Camera in place of the photo's; its width and height are those of the picture.
            azimuth_deg: Azimuth in place of the explained one, degrees.
            elevation_deg: Elevation in place of the explained one, degrees.

        Returns:
            (H, W, 4) float32: linear RGB, and the share of each pixel that the object covers.

        Raises:
            UserError: An argument has another shape or is not finite, or the albedo is not in [0, 1].
        """
        if camera is not None and not isinstance(camera, Camera):
            raise UserError(f"camera must be a vig.Camera; got a {type(camera).__name__}. Pass a Camera.")
        changed: dict[str, np.ndarray] = {}
        for name, size, numbers in (("light", 9, light), ("albedo", 3, albedo)):
            if numbers is not None:
                changed[name] = _check_numbers(name, size, numbers, 1.0 if name == "albedo" else math.inf)
        for name, angle in (("azimuth", azimuth_deg), ("elevation", elevation_deg)):
            if angle is not None:
                changed[name] = np.deg2rad(_check_numbers(f"{name}_deg", 1, [angle], math.inf)[0])
        latents, seen_by = replace(self.latents, **changed), camera or self.camera
        drawn = on_one_core(partial(draw_latents, latents, self.object_class, seen_by, samples=2))
        return np.concatenate([drawn.rgb, drawn.coverage[:, :, None]], axis=-1)

    def overlay(self) -> np.ndarray:
        """Return the photo (H, W, 3) uint8 with the object's outline in yellow, its hidden pixels in pink."""
        return np.asarray(output("overlay")(self))

    def panels(self) -> np.ndarray:
        """Return photo, re-rendering, residual, normals and mask of the window side by side, (H, W, 3)."""
        return np.array(output("panels")(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `explanation.json`, see `vig.record`."""
        described = record(
            self.fit,
            self.object_class,
            self.window,
            [self.camera, *(view.camera for view in self.alternatives)],
            self.focal_from,
            self.pinhole_pose(),
            box=self.box and list(self.box),
            hidden_fraction=None if self.hidden_fraction is None else round(self.hidden_fraction, 5),
            trusted=list(self.trusted),
            points=self.points,
            bounds=[side.tolist() for side in (self.vertices.min(0), self.vertices.max(0))],
            hints=HintsRecord(**(self.hints.to_plain() if self.hints else {})),
        )
        # Numbers of numpy are among a window's and a camera's.
        return dict(msgspec.to_builtins(described, enc_hook=float))

    def save(
        self,
        folder: str | Path,
        photo: str = "photo",
        files: Sequence[str] | None = None,
        full_size: bool = False,
    ) -> Path:
        """Write the files of docs/explanation.md into a folder, and return it.

        Exports of an earlier result in the folder, see `export`, are removed.

        Args:
            folder: Folder, made when it is missing.
            photo: Name of the photo in the report.
            files: Files besides explanation.json, such as ["mask.png"]; by default all.
            full_size: Whether overlay.png is as large as the photo; else it has 2,048 pixels a side at most.

        Raises:
            UserError: The folder cannot be written, or there is no such file.
        """
        return Path(output("save")(self, folder, photo, files, full_size))

    def report(self, photo: str = "photo") -> str:
        """Return a page of HTML that shows the explanation in any browser, in one file, without the network.

        Args:
            photo: Name of the photo in the page.
        """
        return str(output("report")(self, photo))

    def export(self, folder: str | Path, formats: Sequence[str], photo: str = "photo") -> Path:
        """Write the explanation in the formats of other tools, docs/explanation.md; returns the folder.

        No pose, scene or model of an absent object is written, and those in the folder are removed.

        Args:
            folder: Folder of `save`, as some formats name its mask.
            formats: Names of formats, which docs/explanation.md and `vig fit --help` list.
            photo: Name of the photo in the files.

        Raises:
            UserError: There is no such format, its library is not installed, or the folder cannot be written.
        """
        return Path(output("export")(self, folder, formats, photo))

    def pinhole_pose(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the pose in the frame of the camera that took the photo, as robots need it.

        Its intrinsics are those given to `Explainer.explain`; else its principal point is in the photo's
        middle and its focal length the one given, that of EXIF data, or a guess. The object is seen by it
        where the fit sees it, see `vig.photo.pinhole`.

        Returns:
            Intrinsics (3, 3); camera_from_object (4, 4), metres; its covariance (6, 6): x, y, z in metres,
            then turns about these axes in radians. The spread of the sizes of the class's shapes is in it;
            where the focal length or the class's size is a guess, the depth has a deviation as large as the
            distance itself.
        """
        matrix, pose, covariance = (part.copy() for part in (*self._pinhole, self._pinhole_covariance))
        return matrix, pose, covariance

    @cached_property
    def _pinhole_covariance(self) -> np.ndarray:
        matrix, pose = self._pinhole
        blocks = latent_layout(self.object_class.shape_model.modes).split(self.fit.deviation)
        deviation = np.concatenate([blocks["azimuth"], blocks["elevation"], self.fit.framing_deviation])
        covariance = self._geometry.covariance(matrix, self.latents, self.fit.framing, deviation)
        covariance[:3, :3] += self.position_covariance(pose, self.distance_known)
        return covariance

    def position_covariance(self, pose: np.ndarray, distance_known: bool) -> np.ndarray:
        """Return the covariance (3, 3) of the position in a pose (4, 4), metres, by `Fit.position_deviation`.

        Where the distance is a guess its standard deviation is as large as the distance.
        """
        axes, deviations = sight_axes(pose), self.fit.position_deviation.astype(np.float64)
        deviations[2] = deviations[2] if distance_known else 1.0
        return np.asarray((axes * (deviations * self.position_units) ** 2) @ axes.T)

    @property
    def position_units(self) -> np.ndarray:
        """Return units of `Fit.position_deviation`, (3,) metres: the object's length twice, its distance."""
        length = float(np.ptp(self.vertices, axis=0).max())
        return np.array([length, length, float(np.linalg.norm(self._pinhole[1][:3, 3]))])

    @cached_property
    def _pinhole(self) -> tuple[np.ndarray, np.ndarray]:
        """Return intrinsics (3, 3) and camera_from_object (4, 4) of the camera that took the photo."""
        if self.window.lens is not None:
            return self.window.lens.K, self.camera_from_object
        height, width = self.picture.shape[:2]
        focal = self.camera.focal
        if self.focal_from != "assumed" or self.others is not None:  # then all objects have it in common
            focal = self.camera_distance_ratio * FOCAL_OVER_WIDTH * self.window.side
        matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
        return matrix, self._geometry.pose_before(matrix, self.latents, self.fit.framing)

    @property
    def distance_known(self) -> bool:
        """Return whether the distance is metric: the focal length and the class's size are known.

        Even then distances are those of an object of the class's usual size.
        """
        return self.focal_from != "assumed" and self.object_class.size_known

    def __repr__(self) -> str:
        height, width = self.picture.shape[:2]
        hidden = "" if self.hidden_fraction is None else f", {self.hidden_fraction:.0%} hidden"
        return (
            f"Explanation({self.object_class.name} in {width} x {height}: {self.verdict.name.lower()},"
            f" azimuth {self.azimuth_deg:.1f}, elevation {self.elevation_deg:.1f} degrees{hidden})"
        )

    def _repr_png_(self) -> bytes:
        """Return the overlay, for notebooks."""
        return png_bytes(self.overlay())


def _check_numbers(name: str, size: int, value: Any, most: float) -> np.ndarray:
    """Return (1, size) float32 from an argument of `Explanation.render`."""
    try:
        array: np.ndarray = np.asarray(numpy_of_tensor(value), np.float32)
        received = f"shape {array.shape}, {str(value)[:60]}"
    except (TypeError, ValueError):
        array, received = np.empty(0), str(value)[:60]
    if array.shape != (size,) or not np.isfinite(array).all():
        numbers = f"{size} finite number{'s' * (size > 1)}"
        raise UserError(
            f"{name} must be {numbers}; got {received}. Pass {'an array' if size > 1 else 'one'}."
        )
    if most < math.inf and not ((array >= 0) & (array <= most)).all():
        remedy = "Are these 8-bit values? Divide by 255." if array.max() > most else "Clip it."
        received = f"{array.min():g} to {array.max():g}"
        raise UserError(f"{name} must be linear RGB in [0, 1]; got {received}. {remedy}")
    return array[None]
