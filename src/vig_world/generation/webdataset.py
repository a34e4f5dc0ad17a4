"""Datasets as WebDataset shards: tar files that are read from front to back."""

import io
import json
import tarfile
from pathlib import Path
from typing import Any

from vig.io.checks import reading
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig_world.dataset.format import REMEDY, SCENE, image_paths, read_info
from vig_world.dataset.read import image_bytes, read_dataset
from vig_world.generation.files import read_scene, refuse_used


def export_webdataset(root: str | Path, out: str | Path, split: str | None = None, shard: int = 1000) -> Path:
    """Write `out/<split>-000000.tar` and so on: `000000.rgb.png 000000.mask.png 000000.mask_visib.png
    000000.depth.png 000000.json` of each sample, `shard` samples in a file; 000000.normal.png if any.

    The JSON holds the sample's row of latents.parquet (key `row`) and its BOP entries (`camera`, `gt`,
    `gt_info`). The same dataset gives the same bytes. Returns `out`.

    Raises UserError when shard is below 1, there is no such dataset, `out` is the dataset or holds shards of
    that split, or a file cannot be read or written.
    """
    if shard < 1:
        raise UserError(f"shard must be at least 1 sample; got {shard}")
    root, out = Path(root), Path(out)
    dataset = read_dataset(root, split)
    split = dataset.folder.name
    refuse_used(root, out, sorted(out.glob(f"{split}-*.tar")))
    labels = _labels(root, split)
    for number, start in enumerate(range(0, len(dataset), shard)):
        indices = range(start, min(start + shard, len(dataset)))
        with (
            atomic_write(out / f"{split}-{number:06d}.tar") as temporary,
            tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as tar,
        ):
            for index in indices:
                for kind, path in image_paths(dataset.folder, index, dataset.normals).items():
                    _add(tar, f"{index:06d}.{kind}.png", image_bytes(dataset.folder, path, dataset.size))
                _add(tar, f"{index:06d}.json", json.dumps(labels[index]).encode())
    return out


def _labels(root: Path, split: str) -> list[dict[str, Any]]:
    from vig_world.dataset.table import read_table

    rows = read_table(root, split).to_pylist()
    settings = read_info(root)["splits"][split]
    origin = {name: settings[name] for name in ("class", "tier", "seed")} | {"split": split}
    with reading(root / split / SCENE, "the labels of a dataset", REMEDY):
        scene = read_scene(root / split, len(rows))
    return [{"dataset": origin, "row": row, **scene[index]} for index, row in enumerate(rows)]


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file; a new TarInfo has no time and no owner, so the bytes depend on nothing else."""
    member = tarfile.TarInfo(name)
    member.size = len(data)
    tar.addfile(member, io.BytesIO(data))
