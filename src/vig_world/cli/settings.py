"""Settings of `vig dataset`'s verbs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vig_world import Split, World


@dataclass(frozen=True)
class Make:
    """Generate pictures of scenes with full ground truth; can be interrupted and run again."""

    count: int
    """Number of samples."""
    out: Path = Path("vig-dataset")
    """Folder of the dataset."""
    seed: int = 0
    """The dataset's seed: sample i is a pure function of it and i."""
    tier: Literal["raster", "cycles"] = "raster"
    """Renderer: the built-in rasteriser, or Blender's path tracer (the [cycles] extra)."""
    split: Split = "train"
    """Which assets and object designs the scenes are made of; no two splits share any."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    world: World = "photo"
    """photo: scenes as wide as photographs, with objects of any surface, on seamless grounds too, through any
    lens; paper: the paper's, with matt objects in pastel colours before one camera; studio: images put
    together in layers, on which classes are trained, of 150x150 pixels."""
    size: str = "150x150"
    """Width x height of the pictures, pixels. Scenes are the same at any size: the square that they are
    composed for lies in the middle; a wide picture shows more at its sides, a tall one above and below."""
    normals: bool = False
    """Write pictures of surface normals, too."""
    photo: bool = False
    """Pass the pictures through a camera model: exposure, white balance, blur, noise, JPEG."""
    envmaps: Path | None = None
    """Folder of custom panoramas (.hdr, .exr) in place of the built-in ones."""
    props: Path | None = None
    """Folder of custom props (.glb, .gltf, .obj, .ply, .off, .stl) in place of the built-in ones; or a
    furniture catalogue of Sweet Home 3D, with words that pick models: catalogue.sh3f:fruit,toy."""
    furniture: Path | None = None
    """Folder of custom furniture, or a catalogue as for --props, in place of built-in furniture of the same
    family; see docs/world.md."""
    workers: int | None = None
    """Number of processes; by default one per core."""
    ray: str | None = None
    """Make the samples on the Ray cluster at this address (`auto`: the one this machine belongs to) instead
    of in processes here; needs the [cluster] extra."""
    json: bool = False
    """Print one JSON object at the end, and no progress."""


@dataclass(frozen=True)
class Check:
    """Verify a dataset: every file, and renderings with their labels against files. Exits 1 when it has
    problems."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    split: Split | None = None
    """Which split; all complete ones by default."""
    render: int = 0
    """Number of samples of each split that are rendered again from their specs and compared, labels too."""
    object_class: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """The folder of the class pack it was made with, when that is not a packaged class."""
    envmaps: Path | None = None
    """Folder of the custom panoramas (.hdr, .exr) that it was made with."""
    props: Path | None = None
    """Folder or catalogue of the custom props that it was made with."""
    furniture: Path | None = None
    """Folder or catalogue of the custom furniture that it was made with."""
    json: bool = False
    """Print one JSON object with every problem."""


@dataclass(frozen=True)
class Show:
    """Write a contact sheet, with outlines, boxes and keypoints, and histograms of a dataset."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    split: Split | None = None
    """Which split; by default the only one, or train."""
    count: int = 48
    """Number of samples on the sheet, evenly spaced from unoccluded to hidden."""
    plain: bool = False
    """Show the photos alone, without labels."""
    object_class: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """The folder of the class pack it was made with, when that is not a packaged class: for keypoints."""
    out: Path | None = None
    """Folder for the pictures; the dataset's by default."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class ExportDataset:
    """Write a dataset in another format: COCO annotations, visible and amodal, or with keypoints; labels of
    Ultralytics' pose networks; WebDataset shards."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    to: Literal["coco", "coco-keypoints", "yolo-pose", "webdataset"]
    """Which format; docs/dataset.md describes them."""
    out: Path | None = None
    """Folder for the result; by default the dataset's name with that of the format, such as D-coco."""
    split: Split | None = None
    """Which split; by default the only one, or train."""
    object_class: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """Of keypoints: the folder of the class pack it was made with, when that is not a packaged class."""
    shard: int = 1000
    """webdataset: samples in a tar file."""
    json: bool = False
    """Print one JSON object."""
