"""The studio's images as samples of datasets: their scene as plain data, and all labels."""

from functools import lru_cache

import numpy as np

from vig.scene import IMAGE_SIZE, ObjectClass, latent_layout
from vig_world.assets.target import NO_DESIGN
from vig_world.dataset.spec import Room, SampleError, SceneSpec, Split
from vig_world.raster.picture import CANVAS, Picture
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View
from vig_world.studio.studio import Studio, StudioImage, StudioSettings

ROOM = Room(layout=-1, support=-1, zone="studio", origin=(0.0, 0.0, 0.0), turn=0.0, finishes=())
"""Placeholder of the room, which the studio's scenes do not have."""


class StudioScenes:
    """Samples of a dataset whose world is the studio; all of them show the object."""

    def __init__(self, object_class: ObjectClass, split: Split):
        self.object_class, self.split = object_class, split
        self._studio = Studio(object_class, StudioSettings(absent=0.0), split, refused=False)
        self._image = lru_cache(maxsize=1)(self._studio.draw)  # drawn for its scene, then for its picture

    def sample(self, seed: int, index: int, draw: int = 0) -> SceneSpec:
        """Return the scene of a draw of sample `index`.

        Its design and shape are those from which the object was warped and stretched by some per cent.
        """
        image = self._image(seed, index, draw)
        latents = image.latents.astype(float)
        block = latent_layout(self.object_class.shape_model.modes)
        alone, visible = _masks(image)
        hidden = 1 - float(visible.sum() / max(alone.sum(), 1))
        models = self._studio.models
        return SceneSpec(
            seed=seed,
            index=index,
            split=self.split,
            shape=tuple(latents[block["shape"]].tolist()),
            design=models[image.model].design if models else NO_DESIGN,
            azimuth=float(latents[block["azimuth"]][0]),
            elevation=float(latents[block["elevation"]][0]),
            albedo=tuple(latents[block["albedo"]].tolist()),
            light=tuple(latents[block["light"]].tolist()),
            panorama=-1,
            panorama_angle=0.0,
            target=hidden,
            occlusion=hidden,
            room=ROOM,
            props=(),
            rejected={"scene": draw} if draw else {},
            coat=image.coat,
            lens=image.lens,
        )

    def render(self, spec: SceneSpec) -> Picture:
        """Return the picture of a scene: a pure function of its seed, index and draw.

        Depth is known where the object is seen. Raises SampleError where the frame holds none of it.
        """
        image = self._image(spec.seed, spec.index, spec.rejected.get("scene", 0))
        alone, visible = _masks(image)
        if not alone.any():
            raise SampleError(f"sample {spec.index}: expected an object within the frame; got none")
        view = View.of_scene(spec, self.object_class)
        pose, cameras = (view.rotation, view.translation), (view.camera, view.widen(CANVAS).camera)
        depth, around = (rasterize(image.vertices, image.faces, *pose, each).depth for each in cameras)
        canvas, aside = np.isfinite(around), (CANVAS - 1) // 2 * IMAGE_SIZE
        canvas[aside : aside + IMAGE_SIZE, aside : aside + IMAGE_SIZE] = alone
        return Picture(
            image=image.image,
            depth=np.where(visible, depth, np.float32(np.inf)),
            amodal=alone,
            visible=visible,
            by_support=np.zeros_like(alone),
            canvas=canvas,
            light=np.array(spec.light, np.float32),
        )


def _masks(image: StudioImage) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels (H, W) bool of the object alone, and as seen: those of which at least half shows it."""
    alone = image.visible.astype(int) + image.hidden > 127
    return alone, (image.visible > 127) & alone
