"""Cut-outs of solid things, to put pictures together from: packaged props, and models in files."""

import functools
import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from vig.io.errors import UserError
from vig.known_object.packs import SUFFIXES
from vig.scene import Camera, srgb_from_linear
from vig_world import SPLITS, Split
from vig_world.asset_cache import asset_cache
from vig_world.assets import own
from vig_world.assets.models import packaged_props, vary
from vig_world.assets.own.catalogue import mesh_folder
from vig_world.assets.own.folder import files_of
from vig_world.assets.own.load import load
from vig_world.assets.own.props import standing_parts
from vig_world.assets.own.settings import settings_of
from vig_world.assets.own.standing import SizedKind
from vig_world.assets.things import Prop, is_of_class, prop
from vig_world.mesh import stack_meshes, vertex_normals
from vig_world.raster.rasterize import rasterize

CUTOUTS_PER_SPLIT = 1600
"""Cut-outs of each kind, any and lookalike, that a split has."""
SUPERSAMPLING = 2
"""Rendered points across each pixel."""
FREQUENT = {"animal": 0.2, "model_car": 0.1}
"""Shares of cut-outs that are of these families; all others are as frequent as each other."""
LOOKALIKES = (
    "basket", "bottle", "bowl", "coffee_press", "creamer", "cup", "glass", "jar", "kettle", "mug", "sugar",
    "teapot", "tumbler", "utensils", "vase",
)  # fmt: skip
"""Families of props that share something with vessels that pour, where a split has them."""
VIEWS = 8
"""Cut-outs of each model, each in another pose and light."""
SPLIT_SHARES: dict[Split, float] = {"train": 0.7, "validation": 0.1, "test": 0.2}
"""Shares of the models, by a hash of their names."""
_ANY_SIZE = SizedKind("thing", 1e-3, 100.0, furniture=False)
_MAX_FAILURES = 50
"""Models in a row that give no cut-out before a drawing is given up."""


def draw_cutout(
    rng: np.random.Generator, split: Split, unlike: str = "", lookalike: bool = False
) -> Image.Image:
    """Draw one of a split's packaged things: RGBA, sRGB, as large as its outline.

    Args:
        rng: Source of all randomness.
        split: Split of the things.
        unlike: Name of a class of which it is not.
        lookalike: Whether it is one of the `LOOKALIKES`.
    """
    first, number = CUTOUTS_PER_SPLIT * SPLITS.index(split), int(rng.integers(CUTOUTS_PER_SPLIT))
    while unlike and is_of_class(_family_of(first + number, lookalike), unlike):
        number = (number + 1) % CUTOUTS_PER_SPLIT
    return _numbered_cutout(first + number, lookalike)


@functools.lru_cache(maxsize=2 * CUTOUTS_PER_SPLIT)
def _numbered_cutout(number: int, lookalike: bool) -> Image.Image:
    """Return the cut-out of a number: it takes a hundredth of a second."""
    name = f"{'lookalike' if lookalike else 'any'}/{number}"
    return _make_once(name, lambda: [_make_cutout(number, lookalike)])[0]


def _make_once(name: str, make: Callable[[], list[Image.Image]]) -> tuple[Image.Image, ...]:
    """Return the cut-outs of a name, made at most once on a machine."""
    made = asset_cache().arrays(
        f"{_code()}/{name}", lambda: {str(n): np.asarray(image) for n, image in enumerate(make())}
    )
    return tuple(Image.fromarray(made[str(n)]) for n in range(len(made)))


@functools.cache
def _code() -> str:
    """Return the name under which the cut-outs of this code are kept."""
    files = [Path(__file__), *sorted(Path(own.__file__).parent.rglob("*.py"))]
    code = b"".join(file.read_bytes() for file in files)
    return f"cutouts-{hashlib.sha256(code).hexdigest()[:8]}"


def _make_cutout(number: int, lookalike: bool) -> Image.Image:
    """Make a prop in random proportions, colours, pose and light."""
    rng, family = _stream(number, lookalike), _family_of(number, lookalike)
    models = packaged_props(SPLITS[number // CUTOUTS_PER_SPLIT])[family]
    model = models[int(rng.integers(len(models)))]
    shown = Prop(family, vary(model.read(), rng))
    fallen = rng.random() < 0.12 and not lookalike
    return render_cutout(rng, shown, rng.uniform(0, 2 * math.pi) if fallen else 0.0)


def _stream(number: int, lookalike: bool, purpose: int = 0) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([number, 33, int(lookalike), purpose]))


def _family_of(number: int, lookalike: bool = False) -> str:
    """Return the family of the thing of a number."""
    families = tuple(packaged_props(SPLITS[number // CUTOUTS_PER_SPLIT]))
    if lookalike:
        families = tuple(family for family in LOOKALIKES if family in families)
    else:
        kind = float(_stream(number, False, 1).random())
        for family, share in FREQUENT.items():
            if kind < share:
                return family
            kind -= share
    return families[number % len(families)]


@dataclass(frozen=True)
class ModelCutouts:
    """The models of one split, in the order of their names.

    Attributes:
        root: Folder of the files.
        files: Names of the files, relative to it.
    """

    root: Path
    files: tuple[str, ...]

    @property
    def fingerprint(self) -> str:
        """Return a hash of names and sizes of the files."""
        sizes = [f"{name} {(self.root / name).stat().st_size}" for name in self.files]
        return hashlib.sha256("\n".join(sizes).encode()).hexdigest()[:16]

    def draw(self, rng: np.random.Generator) -> Image.Image:
        """Draw one of the models in one of its poses: RGBA, sRGB, as large as its outline."""
        for _ in range(_MAX_FAILURES):
            name, number = self.files[int(rng.integers(len(self.files)))], int(rng.integers(VIEWS))
            if cutouts := _cutouts(self.root, name):
                return cutouts[number]
        raise UserError(f"{self.root}: expected models that can be drawn; {_MAX_FAILURES} could not.")

    def thing(self, name: str) -> Prop | None:
        """Return the model of a file, of the catalogue's size; None where it cannot be read."""
        return _model(self.root, name)


@functools.cache
def model_cutouts(source: str, split: Split, class_name: str) -> ModelCutouts:
    """Return the models of a folder or of catalogues that fall into a split and are not of a class.

    Args:
        source: Argument of `mesh_folder`.
        split: The same model always falls into the same split.
        class_name: Models with a name like this class's are left out: before a car no cars.

    Raises:
        UserError: There is no such folder, or no model in it that falls into the split.
    """
    root = mesh_folder(source)
    listed = [each for each in files_of(root, SUFFIXES) if not is_of_class(Path(each[0]).stem, class_name)]
    files = tuple(path.relative_to(root).as_posix() for name, path in listed if _split_of(name) == split)
    if not files:
        raise UserError(
            f"{source}: expected models for the {split} split; got none of {len(listed)}. Give more."
        )
    return ModelCutouts(root, files)


def _split_of(name: str) -> Split:
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4]) / 2**32
    for split, share in SPLIT_SHARES.items():
        if place < share:
            return split
        place -= share
    return "test"


@functools.lru_cache(maxsize=2048)
def _cutouts(root: Path, name: str) -> tuple[Image.Image, ...]:
    """Return all cut-outs of a model; none where it cannot be read."""
    seed = hashlib.sha256(name.encode() + (root / name).read_bytes()).digest()

    def make() -> list[Image.Image]:
        shown = _model(root, name)
        if shown is None:
            return []
        rng = np.random.default_rng(list(seed[:16]))
        # Some lie, at any angle.
        rolls = [rng.uniform(0, 2 * math.pi) * (rng.random() < 0.15) for _ in range(VIEWS)]
        return [render_cutout(rng, shown, roll) for roll in rolls]

    return _make_once(f"model/{seed.hex()[:24]}", make)


def _model(root: Path, name: str) -> Prop | None:
    """Return a model as a thing; None where it cannot be read."""
    path = root / name
    try:
        settings = settings_of(root, path, {})
        parts, _ = standing_parts(path, load(root, path, settings.nodes).pieces, settings, _ANY_SIZE)
    except UserError:
        return None
    return prop("model", *parts)


def render_cutout(rng: np.random.Generator, shown_prop: Prop, roll: float) -> Image.Image:
    """Draw a thing, turned at random about the vertical: RGBA, sRGB, as large as its outline.

    roll: the camera's, radians.
    """
    from_above = rng.random() < 0.25
    azimuth = rng.uniform(0, 2 * math.pi)
    elevation = math.radians(rng.uniform(30, 85) if from_above else rng.uniform(-5, 30))
    # A cut-out is drawn in a picture of 112 pixels.
    mean = render_view(rng, shown_prop, (azimuth, elevation, roll), 112)
    display = srgb_from_linear((mean[..., :3] / np.maximum(mean[..., 3:], 1e-6)).clip(0, 1))
    image = Image.fromarray((np.concatenate([display, mean[..., 3:]], axis=2) * 255).round().astype(np.uint8))
    return image.crop(image.getchannel("A").getbbox() or (0, 0, 1, 1))


def render_view(
    rng: np.random.Generator, shown: Prop, view: tuple[float, float, float], side: int, distance: float = 4.0
) -> np.ndarray:
    """Draw a view of a thing in some light: (side, side, 4), linear RGB times coverage, and coverage.

    Args:
        rng: Source of the light.
        shown: The thing.
        view: Azimuth, elevation and roll of the camera, radians.
        side: Pixels.
        distance: The camera's, in reaches of the thing from the middle of its box.
    """
    meshes = [mesh for mesh, _ in shown.parts]
    points, faces = stack_meshes(meshes)
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    points = points - (points.min(0) + points.max(0)) / 2
    reach = float(np.linalg.norm(points, axis=1).max())
    size = side * SUPERSAMPLING
    azimuth, elevation, roll = view
    focal = 1.9 / 4 * distance * size
    camera = Camera(size, size, focal, size / 2, size / 2, distance * reach, roll=roll)
    matrix = camera.camera_from_world(azimuth, elevation)
    rotation = matrix[:3, :3]
    fragments = rasterize(points, faces, rotation, matrix[:3, 3], camera)
    covered = fragments.face >= 0
    face, weights = fragments.face[covered], fragments.barycentric[covered]
    normals = np.concatenate([vertex_normals(mesh.vertices, mesh.faces) for mesh in meshes])
    uv = np.concatenate([np.zeros((len(m.vertices), 2)) if m.uv is None else m.uv for m in meshes])
    attributes = np.concatenate([normals @ rotation.T, uv], axis=1)
    interpolated = np.add.reduce([weights[:, c, None] * attributes[faces[face, c]] for c in range(3)])
    normal = interpolated[:, :3] / (np.linalg.norm(interpolated[:, :3], axis=1, keepdims=True) + 1e-9)
    normal = np.where(normal[:, 2:] > 0, -normal, normal)
    colour = np.empty((len(face), 3), np.float32)
    shine = np.zeros((len(face), 1))
    for number, (_, surface) in enumerate(shown.parts):
        of_part = owner[face] == number
        height, width = surface.texture.shape[:2]
        u, v = interpolated[of_part, 3], 1 - interpolated[of_part, 4]
        colour[of_part] = surface.texture[(v * height).astype(int) % height, (u * width).astype(int) % width]
        shine[of_part] = 0.7 * (1 - surface.roughness) ** 2
    light = rng.normal(size=3) + [0, -0.9, -0.9]
    light /= np.linalg.norm(light)
    half_vector = light - [0, 0, 1]
    half_vector /= np.linalg.norm(half_vector)
    shading = (
        rng.uniform(0.2, 0.6) * (0.75 - 0.25 * normal[:, 1:2])
        + rng.uniform(0.3, 0.9) * (normal @ light).clip(0)[:, None]
    )
    specular = (normal @ half_vector).clip(0)[:, None] ** np.exp(rng.uniform(2, 5.5))
    picture = np.zeros((size, size, 4), np.float32)
    picture[covered] = np.concatenate([colour * shading + shine * specular, np.ones_like(specular)], axis=1)
    parts = [
        picture[i::SUPERSAMPLING, j::SUPERSAMPLING]
        for i in range(SUPERSAMPLING)
        for j in range(SUPERSAMPLING)
    ]
    return np.asarray(np.add.reduce(parts) / len(parts))
