"""Whether an object that was found is there: the regression behind `Explanation.present`, and its errors.

    python -m benchmarks.presence [--count 240] [--map-weight 0.5]
    python -m benchmarks.presence --class NAME PHOTO... [--labels labels.json]

Without photos: a logistic regression of `vig.recognition.find.presence_features` on images of the generator's
held-out designs, half of them without the object, and half as many of each other class; both kinds weigh the
same. `--map-weight` holds the weight of the map's log odds. Of each photo the window counts that is likeliest
to show the object; objects of which less than three tenths is visible are left out.

With photos: how many have the verdict `absent`, a trusted view and a trusted mask, where no box is given;
with labels of `vig class check` also how many views, and trusted views, are within 25 degrees.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from vig import Explainer, Verdict
from vig.photo.images import coded_photo
from vig.recognition import Prediction, Recognizer
from vig.recognition.find import find, presence_features
from vig.scene import ObjectClass
from vig_train.calibration.samples import AS_USERS_TAKE_THEM
from vig_world.studio.studio import Studio, StudioImage

CLASSES = "teapot", "mug", "car"
SEED = 4711
FEATURES = "1", "map", "presence head", "framed", "blur"


def main() -> None:
    """Fit the regression, or explain photos, and print a line for each number."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("photos", type=Path, nargs="*")
    parser.add_argument("--class", dest="object_class", default="teapot")
    parser.add_argument("--labels", type=Path)
    parser.add_argument("--count", type=int, default=240, help="images of each class")
    parser.add_argument("--map-weight", type=float, default=None)
    arguments = parser.parse_args()
    if arguments.photos:
        explain(arguments.photos, arguments.object_class, arguments.labels)
        return
    features, present = samples(arguments.count)
    weights = regression(features, present, arguments.map_weight)
    print(f"{len(present)} windows, {present.sum()} with the object")
    print("weights: " + ", ".join(f"{name} {w:.2f}" for name, w in zip(FEATURES, weights, strict=True)))
    there = features @ weights >= 0
    print(
        f"absent: {1 - there[present].mean():.3f} with the object, {1 - there[~present].mean():.3f} without"
    )


def samples(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return features (N, 5) of the likeliest window of each image, and whether it shows the class (N,)."""
    settings = replace(AS_USERS_TAKE_THEM, absent=0.5, boxed=0.7, small=0.2)
    classes = {name: ObjectClass.load(name) for name in CLASSES}
    images: dict[str, list[StudioImage]] = {}
    for name, object_class in classes.items():
        studio = Studio(object_class, settings, "validation", refused=False)
        images[name] = [studio.draw(SEED, index) for index in range(count)]
    features, present = [], []
    for name, object_class in classes.items():
        recognizer = Recognizer.of_class(object_class)
        for other, drawn in images.items():
            for image in drawn if other == name else drawn[::2]:
                seen, whole = (image.visible > 127).sum(), (image.visible + 1.0 * image.hidden > 127).sum()
                if (other == name and 0 < seen <= 0.3 * whole) or (other != name and not seen):
                    continue
                if (best := likeliest(image.image, recognizer)) is not None:
                    features.append(best)
                    present.append(other == name and seen > 0)
    return np.array(features), np.array(present)


def likeliest(image: np.ndarray, recognizer: Recognizer) -> np.ndarray | None:
    """Return the features (5,) of the window of an image that is likeliest to show the object."""
    looks: list[tuple[float, np.ndarray]] = []

    def look(at_place: float, prediction: Prediction) -> float:
        probability = original(at_place, prediction)
        if (features := presence_features(at_place, prediction)) is not None:
            looks.append((probability, features))
        return probability

    module = sys.modules["vig.recognition.find"]
    original = module._present
    with patch.object(module, "_present", look):
        find(coded_photo(image), recognizer)
    return max(looks, key=lambda each: each[0])[1] if looks else None


def regression(features: np.ndarray, present: np.ndarray, map_weight: float | None = None) -> np.ndarray:
    """Return weights (5,) of a logistic regression, with a slight ridge, the map's where it is given."""
    share = np.where(present, 0.5 / present.sum(), 0.5 / (~present).sum())
    free = [index for index in range(len(FEATURES)) if index != 1 or map_weight is None]
    spread = np.append(1.0, features[:, free[1:]].std(0))
    standard, offset = features[:, free] / spread, (map_weight or 0.0) * features[:, 1]

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        odds = standard @ weights + (0.0 if map_weight is None else offset)
        ridge = 1e-2 * np.append(0.0, weights[1:])
        value = (share * (np.logaddexp(0, odds) - present * odds)).sum() + 0.5 * (ridge * weights).sum()
        return value, standard.T @ (share * (expit(odds) - present)) + ridge

    weights = np.empty(len(FEATURES))
    weights[free] = minimize(loss, np.zeros(len(free)), jac=True).x / spread
    if map_weight is not None:
        weights[1] = map_weight
    return weights


def explain(photos: list[Path], name: str, labels: Path | None) -> None:
    """Print the verdicts on photos of which no box is given."""
    azimuths = (
        {} if labels is None else {e["photo"]: e["azimuth_deg"] for e in json.loads(labels.read_text())}
    )
    explainer, rows = Explainer(name), []
    for photo in photos:
        found = explainer.explain(photo)
        turn = (found.azimuth_deg - azimuths.get(photo.name, np.nan) + 180) % 360 - 180
        absent = found.verdict is Verdict.ABSENT
        rows.append([absent, "view" in found.trusted, "mask" in found.trusted, abs(turn) <= 25])
    absent, view, mask, right = np.array(rows).T
    print(f"{len(rows)} photos: absent {absent.mean():.3f}, view trusted {view.sum()}, mask {mask.sum()}")
    if labels is not None:
        trusted = f"trusted {view.mean():.2f}, of which right {right[view].mean():.3f}"
        print(f"view right {right.mean():.2f}, {trusted}; mask trusted {mask.mean():.2f}")


if __name__ == "__main__":
    main()
