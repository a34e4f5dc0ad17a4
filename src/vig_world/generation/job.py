"""The recipe of a split, and the maker that turns it into the files of any sample."""

import hashlib
import json
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vig.io.errors import UserError
from vig.io.files import write_bytes
from vig.photo.images import png_bytes
from vig.scene import ObjectClass, linear_from_srgb
from vig_world import World
from vig_world.composition.sampling import CompositionError, sample
from vig_world.dataset.format import STANDARD_SIZE, Size, image_paths
from vig_world.dataset.spec import SampleError, SceneSpec, Split
from vig_world.generation.describe import depth_units, describe, normal_units
from vig_world.generation.files import sidecar_path, write_picture
from vig_world.library import Library, OwnAssets
from vig_world.raster.picture import Picture
from vig_world.raster.view import View
from vig_world.renderers.photo import PhotoSettings, photograph
from vig_world.renderers.rasterized import render, with_surroundings
from vig_world.streams import stream
from vig_world.studio import StudioScenes
from vig_world.threads import one_thread

if TYPE_CHECKING:
    from vig_world.renderers.cycles import CyclesRenderer

TIERS = ("raster", "cycles")


@dataclass(frozen=True)
class Job:
    """The recipe of a split: sample `index` is a pure function of it. Plain data, sent to every worker.

    Its fields are arguments of `vig_world.generation.write.make_dataset`.
    """

    seed: int
    split: Split
    tier: str
    object_class: ObjectClass
    options: Mapping[str, Any] = field(default_factory=dict)
    own: OwnAssets = OwnAssets()
    photo: bool = False
    world: World = "photo"
    size: Size = STANDARD_SIZE
    normals: bool = False


@dataclass(frozen=True)
class Failure:
    """Why a draw of a sample gave no files.

    Attributes:
        reason: Reason, which names the sample.
        traceback: Traceback of an exception.
        expected: Whether it is expected: the scene could not be composed.
    """

    reason: str
    traceback: str = ""
    expected: bool = False


class Maker:
    """Makes samples of a job in this process; a path tracer is started when first needed."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.library = Library(job.split, job.own)
        self._tracer: CyclesRenderer | None = None
        self._studio = StudioScenes(job.object_class, job.split) if job.world == "studio" else None

    def make(self, index: int, draw: int = 0) -> dict[str, bytes] | Failure:
        """Return the files of a draw of sample `index` by their names in the split's folder; see `encode`.

        Raises UserError for errors that no other draw would avoid.
        """
        try:
            return self.files(self.sample(index, draw))
        except SampleError as error:
            return Failure(str(error), expected=isinstance(error, CompositionError))
        except UserError:
            raise
        except Exception as error:
            self.close()
            return Failure(f"sample {index}: {type(error).__name__}: {error}", traceback.format_exc())

    @one_thread()
    def sample(self, index: int, draw: int = 0) -> SceneSpec:
        """Return a draw of the scene of sample `index`."""
        job = self.job
        if self._studio is not None:
            return self._studio.sample(job.seed, index, draw)
        return sample(self.library, job.object_class, job.seed, index, job.world, draw=draw)

    @one_thread()
    def files(self, spec: SceneSpec) -> dict[str, bytes]:
        """Return the files of a scene. Raises UserError when the renderer cannot run here."""
        picture, settings = self._draw(spec), None
        if self.job.photo:
            picture, settings = take_photo(picture, spec)
        return encode(spec, picture, self.job.object_class, settings)

    def _draw(self, spec: SceneSpec) -> Picture:
        """Return the picture of a scene: a pure function of it."""
        job = self.job
        if self._studio is not None:
            return self._studio.render(spec)
        if job.tier == "cycles":
            if self._tracer is None:
                from vig_world.renderers.cycles import CyclesRenderer

                options = {**job.options, "size": job.size, "normals": job.normals}
                self._tracer = CyclesRenderer(self.library, job.object_class, **options)
            return self._tracer.render(spec)
        view = View.of_scene(spec, job.object_class, job.size)
        picture = render(self.library, spec, job.object_class, view, job.normals)
        if job.size == STANDARD_SIZE:
            return picture
        return with_surroundings(picture, self.library, spec, view)

    def close(self) -> None:
        """Close the path tracer's process."""
        if self._tracer is not None:
            self._tracer.close()
            self._tracer = None


def take_photo(picture: Picture, spec: SceneSpec) -> tuple[Picture, PhotoSettings]:
    """Return a picture passed through the camera model, its labels kept, and the camera's settings."""
    linear = getattr(picture, "linear", None)
    if linear is None:
        linear = linear_from_srgb(picture.image.astype("float32") / 255)
    rng = stream(spec.seed, spec.index, spec.split, 2**20)  # far from those of attempts at a scene
    image, settings = photograph(linear, rng)
    return replace(picture, image=image), settings


def encode(
    spec: SceneSpec, picture: Picture, object_class: ObjectClass, photo: PhotoSettings | None = None
) -> dict[str, bytes]:
    """Return a sample's files by name in the split's folder; the sidecar, marking it complete, comes last."""
    root, depth = Path(), depth_units(picture.depth)
    pictures = {
        "rgb": picture.image,
        "depth": depth[0],
        "mask": picture.amodal.astype("uint8") * 255,
        "mask_visib": picture.visible.astype("uint8") * 255,
    }
    if picture.normals is not None:
        pictures["normal"] = normal_units(picture.normals)
    files = {}
    for kind, path in image_paths(root, spec.index, picture.normals is not None).items():
        files[path.as_posix()] = png_bytes(pictures[kind])
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    described = describe(spec, picture, depth, object_class, photo) | {"sha256": hashes}
    files[sidecar_path(root, spec.index).as_posix()] = json.dumps(described).encode()
    return files


def store(folder: Path, files: dict[str, bytes] | Failure) -> Failure | None:
    """Write the files of a sample into the split's folder, in their order; a failure is returned."""
    if isinstance(files, Failure):
        return files
    *pictures, sidecar = files.items()
    for name, data in pictures:
        write_picture(folder / name, data)
    write_bytes(folder / sidecar[0], sidecar[1])
    return None
