"""Correspondence of registered meshes: designs whose true correspondence is known, remeshed at random.

    python -m benchmarks.correspondence --count 8

The template is made from one design, without its correspondence, and carried onto others. The error is the
distance of each vertex from where the designs have its place, in % of the size of the design, over vertices
that are seen from outside.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.spatial import cKDTree

from vig_train.building.registration import Registration
from vig_train.building.surface import sample_surface, visible_surface
from vig_train.building.template import closed_template, split_long_edges
from vig_world.assets.designs import TEAPOT_FACES, TRAINING_DESIGNS, teapot_vertices
from vig_world.assets.mugs import MUG_FACES, TRAINING_MUGS, mug_vertices
from vig_world.mesh import face_normals, vertex_normals

SAMPLES = 400_000
SEEN = 0.02
"""Sizes: a place farther from what is seen from outside is inside."""


def errors(designs: list[np.ndarray], faces: np.ndarray, seed: int) -> tuple[list[float], list[float], float]:
    """Mean and 95th percentile in % of the size for each design but the first, and seconds for each."""
    rng = np.random.default_rng(seed)
    first = designs[0]
    remade = split_long_edges(first, faces, rng.uniform(0.04, 0.1) * np.ptp(first, axis=0).max())
    template, triangles = closed_template(*remade, visible_surface(*remade))
    face, weights = sample_surface(first, faces, SAMPLES)
    normals = face_normals(first, faces)[face]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    unit = SEEN * np.ptp(first, axis=0).max()
    places = np.concatenate([np.einsum("nk,nkd->nd", weights, first[faces[face]]), unit * normals], axis=1)
    own = np.concatenate([template, unit * vertex_normals(template, triangles)], axis=1)
    nearest = cKDTree(places).query(own)[1]
    registration, mean, most, started = Registration(template, triangles), [], [], time.perf_counter()
    for other in designs[1:]:
        remade = split_long_edges(other, faces, rng.uniform(0.04, 0.1) * np.ptp(other, axis=0).max())
        surface, size = visible_surface(*remade), np.ptp(other, axis=0).max()
        truth = np.einsum("nk,nkd->nd", weights[nearest], other[faces[face[nearest]]])
        seen = cKDTree(surface.points).query(truth)[0] < SEEN * size
        off = 100 * np.linalg.norm(registration.onto(surface) - truth, axis=1)[seen] / size
        mean.append(float(off.mean()))
        most.append(float(np.quantile(off, 0.95)))
    return mean, most, (time.perf_counter() - started) / (len(designs) - 1)


def main() -> None:
    """Print a row for each kind of design."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=8, help="pairs of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the pairs and the remeshing")
    told = parser.parse_args()
    pots = [design for design in TRAINING_DESIGNS if design.handle == "behind"]
    kinds = {
        "mugs": ([mug_vertices(design) for design in TRAINING_MUGS], MUG_FACES),
        "teapots": ([teapot_vertices(design) for design in pots], TEAPOT_FACES),
    }
    print("kind      pairs  mean (median, worst pair)  95th percentile  seconds")
    for name, (vertices, faces) in kinds.items():
        chosen = np.random.default_rng(told.seed).choice(len(vertices), told.count + 1, replace=False)
        mean, most, seconds = errors([vertices[n].astype(float) for n in chosen], faces, told.seed)
        print(
            f"{name:9} {told.count:5}  {np.mean(mean):.2f} % ({np.median(mean):.2f}, {max(mean):.2f})"
            f"{np.mean(most):14.2f} % {seconds:13.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
