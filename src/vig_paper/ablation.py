"""Ablations: the default fit with one part of the method switched off at a time, on the same photos."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vig.inference import ExplainSettings, Stage, explain_one
from vig.inference.settings import PICTURE
from vig.io.errors import UserError
from vig.likelihood import LIKELIHOODS, ROBUST
from vig.recognition import Recognizer
from vig.scene import ObjectClass, linear_from_srgb
from vig.search.optimizer import Optimizer
from vig_paper.optimizers import BFGS, LBFGS, ConjugateGradient, Dogleg, GradientDescent
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.presentation import TableBlock
from vig_train.evaluation.protocol import evaluate
from vig_train.evaluation.results import MethodResult
from vig_train.evaluation.statistics import (
    FAR_DEG,
    bootstrap_indices,
    failure_rate,
    paired_difference,
    summary,
)
from vig_train.evaluation.table import METRICS
from vig_world.dataset import Dataset
from vig_world.threads import one_thread

DEFAULT = "default"


@dataclass(frozen=True)
class Ablation:
    """One part of the method switched off."""

    title: str
    """Title of its row in the table."""
    change: Callable[[ExplainSettings], ExplainSettings]
    """Changes the default's settings."""


def _change_stages(change: Callable[[Stage], Stage]) -> Callable[[ExplainSettings], ExplainSettings]:
    """Return the change of every stage of the settings, those of pictures where they are left open."""
    return lambda settings: replace(
        settings, stages=tuple(change(stage) for stage in settings.stages or PICTURE["stages"])
    )


def _other_optimizer(title: str, optimizer: Optimizer, patience: int = 1) -> Ablation:
    """Return another optimiser from the same starts; patience: its iterations for each of the default's."""

    def change(settings: ExplainSettings) -> ExplainSettings:
        longer = _change_stages(
            lambda stage: replace(
                stage, iterations=patience * stage.iterations, tolerance=stage.tolerance / patience
            )
        )
        return replace(longer(settings), optimizer=optimizer)

    return Ablation(title, change)


ABLATIONS: dict[str, Ablation] = {
    "silhouettes": Ablation("constant silhouettes", lambda s: replace(s, silhouette="paper")),
    "priors": Ablation(
        "no prior on latents from the recognition model, the class's counted once",
        lambda s: replace(s, recognition_weight=0.0, view_weight=0.0, prior_weight=1.0),
    ),
    "prior-weight": Ablation("priors counted once", lambda s: replace(s, prior_weight=1.0)),
    "spatial": Ablation("no spatial model of the mask", lambda s: replace(s, likelihood=ROBUST)),
    "annealing": Ablation("no annealing", _change_stages(lambda stage: replace(stage, sigma=1.0))),
    "hypotheses": Ablation("one start", _change_stages(lambda stage: replace(stage, starts=1))),
    "self-shadow": Ablation("no self-shadow", lambda s: replace(s, self_shadow=False)),
    "mask-prior": Ablation("no prior from the predicted mask", lambda s: replace(s, mask_weight=0.0)),
    "shading-gain": Ablation(
        "no last refinement, with a gain of the shading and the noise estimated",
        lambda s: replace(s, gain_deviation=0.0),
    ),
    "surroundings": Ablation("no model of the surroundings", lambda s: replace(s, surroundings=0.0)),
    "cg": _other_optimizer("by conjugate gradient", ConjugateGradient()),
    "cg-unscaled": _other_optimizer(
        "by conjugate gradient, unscaled as in the paper", ConjugateGradient(scaled=False)
    ),
    "gd": _other_optimizer("by gradient descent", GradientDescent(), patience=10),
    "bfgs": _other_optimizer("by BFGS", BFGS(), patience=4),
    "lbfgs": _other_optimizer("by L-BFGS", LBFGS(), patience=4),
    "dogleg": _other_optimizer("by Powell's dogleg", Dogleg()),
}


def variants(
    settings: ExplainSettings | None = None, names: Iterable[str] | None = None
) -> dict[str, ExplainSettings]:
    """Return the default's settings, and those of each ablation (of `names` only), by name.

    An ablation that changes nothing is left out: its part is off already.

    Raises:
        UserError: An unknown name.
    """
    settings = settings or ExplainSettings()
    chosen = list(ABLATIONS if names is None else names)
    unknown = [name for name in chosen if name not in ABLATIONS]
    if unknown:
        raise UserError(f"expected ablations among {', '.join(ABLATIONS)}; got {', '.join(unknown)}")
    changed = {name: ABLATIONS[name].change(settings) for name in chosen}
    return {DEFAULT: settings} | {name: variant for name, variant in changed.items() if variant != settings}


def run_ablations(
    dataset: Dataset,
    recognizer: Recognizer,
    run: FitRun,
    names: Iterable[str] | None = None,
    settings: ExplainSettings | None = None,
) -> dict[str, Any]:
    """Fit every photo by the default and by each ablation of it; compare them photo by photo.

    Fits are timed separately, since those in the cache were made in another run.

    Args:
        dataset: Dataset of the run's class.
        recognizer: Its prediction is where fits start.
        run: How fits are made; its cache gets a folder for each variant.
        names: See `variants`.
        settings: The default.

    Returns:
        Plain numbers, ready for JSON: "count", "max_occlusion", and "variants": name to "title", "metrics"
        (metric to `statistics.summary`), "failure" (`statistics.failure_rate`), "milliseconds"
        (`time_variants`), and, but for the default, "against_default": metric to
        `statistics.paired_difference`, the variant less the default.
    """
    chosen = variants(settings, names)
    results: dict[str, MethodResult] = {}
    for name, variant in chosen.items():
        method = next(method for method, model in LIKELIHOODS.items() if model == variant.likelihood)
        own = replace(run, cache=run.cache and run.cache / name)
        results[name] = evaluate(dataset, recognizer, own, (method,), variant)[method]
    milliseconds = time_variants(dataset, run.object_class, recognizer, chosen)
    resamples = bootstrap_indices(len(dataset), np.random.default_rng(0))
    metrics = [metric for metric in METRICS if metric in results[DEFAULT].errors]
    default = results[DEFAULT].errors
    rows: dict[str, Any] = {}
    for name, result in results.items():
        rows[name] = {
            "title": name if name == DEFAULT else ABLATIONS[name].title,
            "metrics": {metric: summary(result.errors[metric], resamples) for metric in metrics},
            "failure": failure_rate(result.errors["azimuth_deg"], resamples),
            "milliseconds": milliseconds[name],
        }
        if name != DEFAULT:
            compared = {
                metric: paired_difference(result.errors[metric], default[metric], resamples)
                for metric in metrics
            }
            rows[name]["against_default"] = compared
    return {"count": len(dataset), "max_occlusion": float(dataset.occlusion.max()), "variants": rows}


def time_variants(
    dataset: Dataset,
    object_class: ObjectClass,
    recognizer: Recognizer,
    chosen: Mapping[str, ExplainSettings],
    count: int = 20,
) -> dict[str, float]:
    """Return milliseconds of a fit by each variant on one thread: means of the first `count` photos.

    Processor time, which is wall time where nothing else runs. The variants take turns on each photo, so
    that a slow period of the machine affects all.
    """
    images = dataset.images[:count].astype(np.float32) / 255
    photos = linear_from_srgb(images)
    prediction = recognizer(photos)
    spent = dict.fromkeys(chosen, 0.0)
    with one_thread():
        for settings in chosen.values():
            explain_one(photos[0], prediction[:1], object_class, settings)
        for index, photo in enumerate(photos):
            for name, settings in chosen.items():
                started = time.process_time()
                explain_one(photo, prediction[index : index + 1], object_class, settings)
                spent[name] += time.process_time() - started
    return {name: 1000 * seconds / len(photos) for name, seconds in spent.items()}


def ablation_blocks(table: Mapping[str, Any]) -> list[TableBlock]:
    """Return the table of `run_ablations`: a block of errors, and one of differences to the default."""
    rows = table["variants"]
    metrics = list(rows[DEFAULT]["metrics"])
    titles = [METRICS[metric] for metric in metrics]
    errors = [
        [
            row["title"],
            *(f"{summary['median']:.3g} ({summary['mean']:.3g})" for summary in row["metrics"].values()),
            f"{row['failure']['rate']:.1%}",
            f"{row['milliseconds']:.0f}",
        ]
        for row in rows.values()
    ]
    differences = [
        [row["title"], *(_difference(row["against_default"][metric]) for metric in metrics)]
        for row in rows.values()
        if "against_default" in row
    ]
    images = f"{table['count']} images, at most {table['max_occlusion']:.0%} hidden"
    header = ["", *titles, f"azimuth off by > {FAR_DEG:.0f}", "ms per fit"]
    blocks = [TableBlock(f"The default fit and its ablations: {images}; median (mean)", header, errors)]
    if differences:
        title = "Less the default: difference of medians, its paired 95 % interval; p of Wilcoxon's test"
        blocks.append(TableBlock(title, ["", *titles], differences))
    return blocks


def _difference(test: Mapping[str, Any]) -> str:
    low, high = test["ci95"]
    p = "p < 0.0001" if test["p"] < 1e-4 else f"p = {test['p']:.2g}"
    return f"{test['median_difference']:+.3g}, {p}\n[{low:+.3g}, {high:+.3g}]"
