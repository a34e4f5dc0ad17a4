"""Views of the very object of a mesh file, as `vig fit --mesh` finds them in scenes of it.

    python -m benchmarks.one_mesh MESH... [--count 50] [--seed 77]

Scenes are `vig dataset make --class PACK --seed SEED`, with up to 0.9 of the object hidden; the mask is what
is seen of it, the box is round the whole of it. With the mask it is told that the object stands, which a
box alone means.
"""

import argparse
import io
import math
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path

import numpy as np

import vig
from vig.photo.masks import box_of
from vig.scene import Latents
from vig_app.cli.main import main as run_vig
from vig_train.building.single import pack_of_mesh
from vig_world.dataset import Dataset, read_dataset

LEAD = 1000.0
"""Nats by which a view that stands alone leads."""


def main() -> None:
    """Print a line for each mesh, with a box alone and with a mask beside it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=77)
    arguments = parser.parse_args()
    print(
        "mesh  told  azimuth: median, within 15 / 30 degrees  elevation, median  "
        f"right of those that lead by {LEAD:g} nats"
    )
    for mesh in arguments.meshes:
        pack = pack_of_mesh(mesh, say=print)
        with tempfile.TemporaryDirectory() as folder:
            asked = ["--count", str(arguments.count), "--seed", str(arguments.seed), "--json"]
            with suppress(SystemExit), redirect_stdout(io.StringIO()):
                run_vig(["dataset", "make", "--out", f"{folder}/scenes", "--class", str(pack), *asked])
            dataset = read_dataset(Path(folder) / "scenes", "train")
            for told in ("box", "mask"):
                errors = np.abs(list(_errors(vig.Explainer(pack), dataset, told == "mask")))
                azimuth, elevation, lead = errors.T
                near = " / ".join(f"{(azimuth < bound).mean():.2f}" for bound in (15, 30))
                line = f"{np.median(azimuth):.1f}, {near}  {np.median(elevation):.1f}"
                right = azimuth[lead >= LEAD] < 15
                line += f"  {np.mean(right) if len(right) else np.nan:.2f} of {len(right)}"
                print(f"{mesh.name}  {told}  {line}", flush=True)


def _errors(explainer: vig.Explainer, dataset: Dataset, mask: bool) -> Iterator[tuple[float, float, float]]:
    """Of each sample the errors of azimuth and elevation, degrees, and the nats by which its view leads."""
    truth = Latents.from_vector(dataset.latents)
    every = np.arange(len(dataset))
    photos, whole, seen = (dataset.read(name, every) for name in ("rgb", "mask", "mask_visib"))
    for index, photo in enumerate(photos):
        if (box := box_of(whole[index])) is None or not seen[index].any():
            continue
        hints = vig.Hints(mask=seen[index], roll_deg=0.0) if mask else None
        found = explainer.explain(photo, box=box, hints=hints)
        off = found.object_class.symmetry.difference(found.latents.azimuth, truth.azimuth[index : index + 1])
        elevation = found.latents.elevation - truth.elevation[index : index + 1]
        yield math.degrees(off[0]), math.degrees(elevation[0]), _lead(found)


def _lead(found: vig.Explanation) -> float:
    return min((view.score_gap for view in found.fit.alternatives), default=math.inf)


if __name__ == "__main__":
    main()
