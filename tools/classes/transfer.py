"""A class pack's table of self-shadow and bounce light, and how well it predicts.

`python -m tools.classes.transfer FOLDER`
"""

import argparse
from pathlib import Path

import numpy as np

from vig.scene import ObjectClass, ShapeModel
from vig.scene.object_class import TRANSFER_FILE
from vig_train.packs.transfer import RAY_GRID, SampledChanges, write_transfer


def relative_error(table: np.ndarray, model: ShapeModel, shapes: int = 12, seed: int = 1) -> float:
    """Return the root mean square error of the table's changes over theirs, on shapes of its own.

    Only vertices outside other parts count.
    """
    samples = SampledChanges.draw(model, shapes, RAY_GRID, seed)
    predicted = np.tensordot(np.column_stack([np.ones(shapes), samples.coefficients]), table, axes=1)
    outside, exact = ~samples.inside, samples.changes
    return float(np.sqrt(((predicted - exact)[outside] ** 2).sum() / (exact[outside] ** 2).sum()))


def main() -> None:
    """Compute and save a class pack's table; print how well it predicts."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="of the class pack, whose table is replaced")
    folder = parser.parse_args().folder
    object_class = ObjectClass.load(folder)
    table = write_transfer(object_class, folder)
    mean_only = np.concatenate([table[:1], np.zeros_like(table[1:])])
    errors = [relative_error(candidate, object_class.shape_model) for candidate in (table, mean_only)]
    print(f"relative error on other shapes: {errors[0]:.3f}; of the mean alone: {errors[1]:.3f}")
    print(f"{table.shape}, {(folder / TRANSFER_FILE).stat().st_size} bytes: {folder / TRANSFER_FILE}")


if __name__ == "__main__":
    main()
