"""An object's own colours from the photo: visible surface divided by the light on it.

Hidden parts take the colours of their mirror image, where the class has one and that is visible; others
have the colour of their part.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image, ImageFilter

from vig.explanation import Explanation
from vig.parallel import on_one_core
from vig.photo.masks import box_of
from vig.renderer.drawing import draw_latents
from vig.scene import Camera, ObjectClass
from vig.scene.light import srgb8_from_linear
from vig_app.glb.atlas import SIDE, Atlas, atlas_of
from vig_app.pictures import PANEL, close_up, others_in_window, part_albedo
from vig_renderer.edges import smooth_normals

SEEN, MIRRORED, INVENTED = 255, 128, 0  # values of the map of where a texel's colour is from
MIN_IRRADIANCE = 0.05, 0.15
"""Light of a white surface, of 1, from which a colour begins to count, and from which it counts in full;
`MIN_FACING` likewise."""
MIN_FACING = 0.15, 0.45  # cosine of normal and sight
BLEEDS = 2  # pixels of the window beside an outline that may show things beyond it, and do not count
BORDER = 7  # pixels beside an outline from which colours count in full
NEAR = 0.02
"""Distance of a texel from the surface in a pixel up to which it has its colour, over the object's length."""
MIRROR = np.array([1.0, -1.0, 1.0], np.float32)
LEVELS = srgb8_from_linear(np.linspace(0, 1, 1 << 12))  # 8-bit sRGB of linear values in steps


@dataclass(frozen=True, eq=False)
class Texture:
    """The surface of an explained object, as `atlas` lays it out.

    Attributes:
        atlas: Atlas of its class.
        colours: (T, 3) float32, linear RGB of each texel, in [0, 1].
        origin: (T,) uint8, source of each colour: SEEN, MIRRORED or INVENTED.
    """

    atlas: Atlas
    colours: np.ndarray
    origin: np.ndarray

    @property
    def shares(self) -> dict[str, float]:
        """Return the shares of the texels, by the origin of their colours."""
        names = {"seen": SEEN, "mirrored": MIRRORED, "invented": INVENTED}
        return {name: float((self.origin == value).mean()) for name, value in names.items()}

    @property
    def picture(self) -> np.ndarray:
        """Return (SIDE, SIDE, 3) uint8, sRGB."""
        levels = np.zeros((len(self.colours), 4), np.uint8)  # by words of four bytes: faster
        levels[:, :3] = LEVELS[(self.colours * (len(LEVELS) - 1) + 0.5).astype(np.uint16)]
        pixels = levels.view(np.uint32)[:, 0][self.atlas.texels]
        return pixels.view(np.uint8).reshape(SIDE, SIDE, 4)[..., :3]

    @property
    def origin_picture(self) -> np.ndarray:
        """Return (SIDE, SIDE) uint8, where each pixel's colour is from."""
        return self.origin[self.atlas.texels].reshape(SIDE, SIDE)


def bake(explanation: Explanation) -> Texture | None:
    """Return the texture of an explained object from its photo; None where its class has no atlas."""
    object_class, vertices = explanation.object_class, explanation.vertices
    model, atlas = object_class.shape_model, atlas_of(object_class)
    if atlas is None:
        return None
    colours = part_albedo(explanation)[model.parts[model.faces[atlas.face, 0]]]
    origin = np.full(len(colours), INVENTED, np.uint8)
    shown = _Shown.of(explanation)
    if shown is not None:
        normals = smooth_normals(vertices, model.faces)
        sides = [(SEEN, np.ones_like(MIRROR))] + [(MIRRORED, MIRROR)] * object_class.mirror
        placed = np.concatenate(
            [shown.place_vertices(vertices * flip, normals * flip) for _, flip in sides], axis=1
        )
        at = atlas.at_texels(placed)
        for number, (source, _) in reversed(list(enumerate(sides))):
            origin[shown.paint(colours, at[:, 4 * number :][:, :4])] = source
    return Texture(atlas, colours, origin)


@dataclass(frozen=True, eq=False)
class _Shown:
    """The object's surface in the part of the window that it covers.

    Attributes:
        layers: (5, h, w) float32: colour without the light, linear RGB; its weight, in [0, 1]; one
            over the depth of the surface, 0 where nothing is.
        place_from_object: (3, 4), from a point to its place in the layers, from -1 to 1 each way.
        eye: (3,) camera's position in the object's frame.
        near: Distance of a point from the surface in a pixel up to which it has its colour, over its depth.
    """

    layers: np.ndarray
    place_from_object: np.ndarray
    eye: np.ndarray
    near: float

    @staticmethod
    def of(explanation: Explanation) -> "_Shown | None":
        """Return the surface in an explanation's window; None where it shows nothing of the object."""
        shown, latents = close_up(explanation), explanation.latents
        camera = shown.camera
        box = box_of(shown.visible & (shown.part >= 0))
        if box is None:
            return None
        x, y, width, height = box
        part = slice(y, y + height), slice(x, x + width)
        pose = camera.camera_from_object(latents)
        eye, length = -pose[:3, :3].T @ pose[:3, 3], float(np.ptp(explanation.vertices, axis=0).max())
        light, depth = _light(explanation)[part], shown.depth[part]
        layers = np.empty((5, height, width), np.float32)
        layers[:3] = np.moveaxis(shown.photo[part] / np.maximum(light, MIN_IRRADIANCE[0])[..., None], 2, 0)
        visible = shown.visible[part]
        if explanation.others is not None:
            visible = visible & (others_in_window(explanation, PANEL)[part] < 0.5)
        layers[3] = _inside(visible, depth, 0.03 * length)  # depth jumps at outlines within the object
        layers[3] *= _ramp(_facing(shown.normals[part], camera, part), MIN_FACING)
        layers[3] *= _ramp(light, MIN_IRRADIANCE)
        layers[4] = 1 / depth
        layers[:3] /= np.maximum(layers[:3].max(0), 1)  # colours that are too bright keep their hue
        across, down = -1 - 2 * x / width, -1 - 2 * y / height
        to_place = np.array([[2 / width, 0, across], [0, 2 / height, down], [0, 0, 1]])
        return _Shown(layers, to_place @ camera.K @ pose[:3], eye, NEAR * length / float(np.linalg.norm(eye)))

    def place_vertices(self, vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the places of vertices with normals, (V, 4) float32: x, y and 1, times their depth; above 0
        where they face the camera. All are linear in the place on a face.
        """
        places = vertices @ self.place_from_object[:, :3].T + self.place_from_object[:, 3]
        facing = ((self.eye - vertices) * normals).sum(1)
        return np.column_stack([places, facing]).astype(np.float32)

    def paint(self, colours: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Give texels (T, 3) at `placed` (T, 4) the colours of the photo there; returns which have one."""
        texels = np.flatnonzero(at[:, 3] > 0)
        x, y, depth, _ = at[texels].T
        where = np.stack([x / depth, y / depth], axis=1)
        counts, nearness = self._sample_layers(slice(3, 5), where)
        here = np.flatnonzero((counts > 0) & (np.abs(nearness * depth - 1) < self.near))
        texels, weight = texels[here], counts[here, None]
        before = colours[texels]
        colours[texels] = before + weight * (self._sample_layers(slice(3), where[here]).T - before)
        return texels[weight[:, 0] > 0.5]

    def _sample_layers(self, layers: slice, where: np.ndarray) -> np.ndarray:
        """Return layers at places (N, 2), between the middles of four pixels: (layers, N)."""
        chosen = self.layers[layers]
        height, width = chosen.shape[1:]
        x = (where[:, 0] + 1) * np.float32(width / 2) - np.float32(0.5)
        y = (where[:, 1] + 1) * np.float32(height / 2) - np.float32(0.5)
        left, top = np.floor(x), np.floor(y)
        across, down = x - left, y - top
        bordered = np.pad(chosen, ((0, 0), (2, 2), (2, 2))).reshape(len(chosen), -1)
        row, column = (at.clip(-2, size).astype(np.int64) + 2 for at, size in ((top, height), (left, width)))
        first = row * (width + 4) + column
        found = np.zeros((len(chosen), len(where)), np.float32)
        for i, weight_down in ((0, 1 - down), (1, down)):
            for j, weight_across in ((0, 1 - across), (1, across)):
                found += bordered.take(first + (i * (width + 4) + j), axis=1) * (weight_down * weight_across)
        return found


def _light(explanation: Explanation) -> np.ndarray:
    """Return the light that a white surface in the object's place would reflect, (S, S) of the window."""
    latents, object_class, shown = explanation.latents, explanation.object_class, close_up(explanation)
    albedo = latents.albedo[0]
    channel = int(albedo.argmax())
    if object_class.part_reflectance is None and albedo[channel] > 0.01:
        return shown.rendering[..., channel] / albedo[channel]
    # Where dark parts meet bright ones the rendering mixes their reflectances.
    white = replace(latents, albedo=np.ones_like(latents.albedo))
    drawn = on_one_core(functools.partial(draw_latents, white, _uniform(object_class), shown.camera))
    return drawn.rgb[:, :, 0]


@functools.lru_cache(maxsize=8)
def _uniform(object_class: ObjectClass) -> ObjectClass:
    """Return the class with parts of the same reflectance."""
    return replace(object_class, part_reflectance=None)


def _facing(normals: np.ndarray, camera: Camera, part: tuple[slice, slice]) -> np.ndarray:
    """Return cosine (h, w) between normals (h, w, 3), camera axes, and the sight of a part of its picture."""
    rows, columns = (np.arange(each.start, each.stop, dtype=np.float32) + 0.5 for each in part)
    x = (columns - camera.cx) / camera.focal
    y = ((rows - camera.cy) / (camera.focal_y or camera.focal))[:, None]
    along = normals[..., 0] * x + normals[..., 1] * y + normals[..., 2]
    return -along / np.sqrt(x * x + y * y + 1)


def _inside(visible: np.ndarray, depth: np.ndarray, jump: float) -> np.ndarray:
    """Return distances (h, w) to the outlines of visible pixels and of nearer things: 0 to 1 at `BORDER`."""
    inside = np.zeros(np.add(visible.shape, 2 * BORDER), np.uint8)
    here = inside[BORDER:-BORDER, BORDER:-BORDER]
    here[visible & np.isfinite(depth)] = 255
    with np.errstate(invalid="ignore"):
        for a, b, near, far in (
            (depth[1:], depth[:-1], here[1:], here[:-1]),
            (depth[:, 1:], depth[:, :-1], here[:, 1:], here[:, :-1]),
        ):
            jumps = np.abs(a - b) > jump
            near[jumps] = far[jumps] = 0
    for _ in range(BLEEDS):  # smaller by a pixel
        inside[1:-1] = np.minimum(np.minimum(inside[2:], inside[:-2]), inside[1:-1])
        inside[:, 1:-1] = np.minimum(np.minimum(inside[:, 2:], inside[:, :-2]), inside[:, 1:-1])
    soft = Image.fromarray(inside).filter(ImageFilter.BoxBlur(BORDER - BLEEDS))
    blurred = np.asarray(soft)[BORDER:-BORDER, BORDER:-BORDER]
    return _ramp(blurred, (127.5, 255.0))


def _ramp(values: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    """Rise from 0 at the lower bound to 1 at the upper one."""
    low, high = bounds
    return ((values - np.float32(low)) / np.float32(high - low)).clip(0, 1)
