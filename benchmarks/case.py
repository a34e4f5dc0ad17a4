"""The problem of all renderers, and our two sides of the comparison.

A mesh before a camera, guesses a little apart, and a photo to explain.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch

from vig.likelihood import ROBUST, Evaluation, Likelihood, Photos
from vig.likelihood.geometry import Geometry
from vig.parallel import set_thread_count
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render, render_latents
from vig.scene import EXPOSURE_L00, Camera, Latents, ObjectClass, ShapeModel, latent_layout
from vig_world.mesh import face_edges
from vig_world.raster.rasterize import rasterize

SIZES = (75, 150, 300)
STANDARD_SIZE = 150
MODES = 10
GUESSES = 8
MAGNIFICATION = 1.16
"""Focal length over the paper's: the object then covers about 7 k of 150 x 150 pixels."""

AZIMUTH, ELEVATION = 0.9, 0.4
BACKDROP_CELLS = 15


@dataclass(frozen=True)
class Case:
    """One mesh at one image size."""

    model: ShapeModel
    camera: Camera
    truth: Latents
    """Of the photo (B = 1)."""
    guesses: tuple[Latents, ...]
    """`GUESSES` latents that are evaluated in turn, float32."""
    photo: np.ndarray
    """(H, W, 3) float64 linear RGB, the teapot in front of clutter and behind an occluder."""

    @property
    def label(self) -> str:
        """Such as "5252 faces, 150 x 150"."""
        return f"{len(self.model.faces)} faces, {self.camera.width} x {self.camera.height}"

    def points(self) -> list[np.ndarray]:
        """Vertices (V, 3) of each guess in the camera's frame, metres, float64, as peers get them."""
        placed = []
        for guess in self.guesses:
            rotation, translation = self.camera.pose(
                guess.azimuth.astype(np.float64), guess.elevation.astype(np.float64)
            )
            vertices = self.model.vertices(guess.shape.astype(np.float64))
            placed.append(vertices[0] @ rotation[0].T + translation[0])
        return placed

    def covered(self) -> int:
        """Pixels whose centre the object covers at the first guess."""
        still, origin = np.eye(3), np.zeros(3)
        fragments = rasterize(self.points()[0], self.model.faces, still, origin, self.camera, cull=True)
        return int((fragments.face >= 0).sum())


def make_case(size: int, subdivisions: int = 0, seed: int = 0) -> Case:
    """The packaged teapot, each face split in four `subdivisions` times, in an image of `size` pixels."""
    teapot = ObjectClass.load("teapot")
    whole = teapot.shape_model
    # Ten components, as earlier versions had them: 27 columns, so that numbers can be compared.
    model = replace(
        whole,
        basis=whole.basis[:MODES],
        explained_variance_ratio=whole.explained_variance_ratio[:MODES],
    )
    for _ in range(subdivisions):
        model = subdivided(model)
    camera = teapot.camera(size)
    camera = replace(camera, focal=camera.focal * MAGNIFICATION)
    rng = np.random.default_rng(seed)
    light = np.concatenate([[EXPOSURE_L00, 0.0, 1.0, 0.0], np.zeros(5)]) + rng.normal(0, 0.2, 9)
    shape = rng.normal(0, 0.5, model.modes)
    layout = latent_layout(model.modes)
    values = {"shape": shape, "azimuth": [AZIMUTH], "elevation": [ELEVATION], "albedo": [0.6, 0.4, 0.3]}
    parts = {name: np.array(each, np.float64) for name, each in (values | {"light": light}).items()}
    truth = layout.join(parts)[None]
    spread = np.full(layout.size, 0.02)
    spread[layout["shape"]], spread[layout["light"]] = 0.2, 0.05
    guesses = truth + rng.normal(size=(GUESSES, truth.shape[1])) * spread
    return Case(
        model,
        camera,
        Latents.from_vector(truth),
        tuple(Latents.from_vector(guess[None].astype(np.float32)) for guess in guesses),
        _photo(
            replace(teapot, shape_model=model, transfer=None, families=()),
            camera,
            Latents.from_vector(truth),
            rng,
        ),
    )


def _photo(object_class: ObjectClass, camera: Camera, truth: Latents, rng: np.random.Generator) -> np.ndarray:
    """The truth in front of coloured blocks, a fifth of the width hidden by others, with a little noise."""
    drawn = render_latents(truth, object_class, camera, self_shadow=False)
    coverage = drawn.coverage[0, ..., None].numpy()
    colour = drawn.rgb[0].numpy() / coverage.clip(1e-3)  # it was blended with black
    block = np.ones((camera.height // BACKDROP_CELLS, camera.width // BACKDROP_CELLS, 1))
    cells = rng.uniform(0.1, 0.9, (2, BACKDROP_CELLS, BACKDROP_CELLS, 3))
    behind, before = np.kron(cells[0], block), np.kron(cells[1], block)
    image = np.where(coverage > 0.5, colour, behind)
    hidden = slice(camera.width * 3 // 10, camera.width // 2)
    image[camera.height * 4 // 10 :, hidden] = before[camera.height * 4 // 10 :, hidden]
    return (image + rng.normal(0, 0.01, image.shape)).clip(0, 1)


def subdivided(model: ShapeModel) -> ShapeModel:
    """The same surface with every face split in four at its edges' midpoints; with its modes and parts."""
    corners = face_edges(model.faces)
    edges, place = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    count = len(model.mean)
    ab, bc, ca = (count + place.reshape(3, -1)).astype(np.int32)
    a, b, c = model.faces.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    stack = np.concatenate([model.mean[None], model.basis])
    stack = np.concatenate([stack, stack[:, edges].mean(2)], axis=1)
    return replace(
        model,
        mean=stack[0],
        basis=stack[1:],
        faces=np.concatenate([np.stack(quarter, axis=1) for quarter in quarters]),
        parts=np.concatenate([model.parts, model.parts[edges[:, 0]]]),
    )


def set_threads(count: int) -> None:
    """Set the number of threads that we use."""
    set_thread_count(count)


class Ours:
    """Eq. 4 of one photo on the CPU in float32: the value alone, or with gradient and normal matrix."""

    def __init__(self, case: Case):
        height, width = case.photo.shape[:2]
        photos = Photos(case.photo[None], ROBUST.log_prior(height, width)[None])
        self.case, self.likelihood = case, Likelihood(Geometry(case.model), case.camera, photos)
        latents = latent_layout(case.model.modes).blocks
        self._places = self.likelihood.layout.indices(*(block.name for block in latents))
        self._rest = np.zeros(1, np.int32), np.array([ROBUST.sigma])

    def forward(self, index: int) -> Evaluation:
        """The objective at a guess."""
        return self._evaluate(index, derivatives=False)

    def gradient(self, index: int) -> Evaluation:
        """Objective and gradient of all latents and 4 numbers of framing."""
        return self._evaluate(index, derivatives=True, curvature=False)

    def full(self, index: int) -> Evaluation:
        """Objective, gradient and normal matrix of all latents and 4 numbers of framing."""
        return self._evaluate(index, derivatives=True)

    def covered(self) -> int:
        """Area of the first guess's silhouette, in pixels, rounded."""
        coverage = self.images().coverage
        assert coverage is not None
        return round(float(coverage.sum()))

    def images(self) -> Evaluation:
        """The first guess with its posterior, coverage and irradiance."""
        return self._evaluate(0, derivatives=False, images=True)

    def _evaluate(
        self, index: int, derivatives: bool, curvature: bool = True, images: bool = False
    ) -> Evaluation:
        point = np.zeros((1, self.likelihood.layout.size))
        point[:, self._places] = self.case.guesses[index % len(self.case.guesses)].to_vector()
        return self.likelihood.at(point, *self._rest, derivatives, images, curvature)


class Rendered:
    """The public renderer as a user calls it: the squared error of one picture, on the CPU in float32."""

    def __init__(self, case: Case):
        camera, model = case.camera, case.model
        self.size, self.photo = (camera.width, camera.height), torch.from_numpy(case.photo).float()
        self.topology = Topology.of(model.faces, model.mean)
        self.points = [torch.from_numpy(points).float() for points in case.points()]
        self.inputs = {
            "albedo": torch.from_numpy(case.truth.albedo[0]).float().repeat(len(model.mean), 1),
            "light": torch.from_numpy(case.truth.light[0]).float(),
            "focal": torch.full((2,), camera.focal),
            "centre": torch.tensor([camera.cx, camera.cy]),
            "rotation": torch.eye(3),
            "translation": torch.zeros(3),
        }

    def forward(self, index: int) -> float:
        """The squared error of a guess."""
        return float(self._error(self.points[index % len(self.points)], self.inputs))

    def gradient(self, index: int) -> dict[str, np.ndarray]:
        """The squared error's gradient with respect to vertices, their colours, light and camera."""
        leaves = {"vertices": self.points[index % len(self.points)], **self.inputs}
        leaves = {name: value.clone().requires_grad_() for name, value in leaves.items()}
        self._error(leaves["vertices"], leaves).backward()
        return {name: value.grad.numpy() for name, value in leaves.items() if value.grad is not None}

    def covered(self) -> int:
        """Pixels that show the object at the first guess."""
        return int((render(self._scene(self.points[0], self.inputs)).object_id >= 0).sum())

    def _error(self, vertices: torch.Tensor, values: dict[str, torch.Tensor]) -> torch.Tensor:
        return (render(self._scene(vertices, values)).rgb[0] - self.photo).square().sum()

    def _scene(self, vertices: torch.Tensor, values: dict[str, torch.Tensor]) -> Scene:
        eye = Pinhole(*self.size, *(values[name] for name in ("focal", "centre", "rotation", "translation")))
        return Scene([MeshObject(vertices, self.topology, values["albedo"], light=values["light"])], eye)
