"""How optimisers are compared with the default: by the same photos."""

import numpy as np

from benchmarks.optimizers import COLUMNS, DEFAULT, OPTIMIZERS, START, compare, slug, summary
from benchmarks.report import median_interval
from vig.inference import ExplainSettings
from vig.optimizers.annealing import Annealed
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt


def rows(short: np.ndarray, milliseconds: np.ndarray) -> np.ndarray:
    """A row of the table, of which only these two columns matter here."""
    found = np.zeros((len(short), len(COLUMNS)))
    found[:, list(COLUMNS).index("short_of_best")] = short
    found[:, list(COLUMNS).index("fit")] = milliseconds
    return found


def test_the_default_row_runs_what_a_fit_runs() -> None:
    optimizer, _ = OPTIMIZERS[DEFAULT]
    assert optimizer == Annealed(LevenbergMarquardt()) == Annealed(ExplainSettings().optimizer)
    assert slug(DEFAULT) == "lm_annealed" and slug("gd, decay 0.01") == "gd_decay_0_01"


def test_times_and_ends_are_compared_photo_by_photo() -> None:
    # Photos differ by far more than optimisers do: only pairs show who wins.
    short, spent = np.geomspace(1, 1e5, 21), np.geomspace(10, 1000, 21)
    found = compare(
        {
            START: rows(short + 1e6, spent * 0),
            DEFAULT: rows(short, spent),
            "slow and worse": rows(short + 5, 2 * spent),
            "slow and better": rows(short - 5, 3 * spent),
            "fast and as good": rows(short + 1000 * (-1.0) ** np.arange(21), spent / 2),
        }
    )
    assert list(found) == ["slow and worse", "slow and better", "fast and as good"]
    assert [comparison.verdict for comparison in found.values()] == [
        "worse",
        "better",
        "neither better nor worse",
    ]
    assert np.allclose([comparison.time for comparison in found.values()], [2, 3, 0.5])
    assert np.allclose([comparison.gain for comparison in found.values()][:2], [-5, 5])
    assert [comparison.default_wins for comparison in found.values()] == [True, False, False]
    lines = summary(found).splitlines()
    expected = "slow and worse: 2.00 x the default's time; final objective worse: -5 nats (95 % -5 to -5)"
    assert lines[0] == expected
    assert "faster than 1 of 3" in lines[-1] and lines[-1].endswith("slow and better; fast and as good")


def test_the_interval_of_a_median_covers_it_as_often_as_it_says() -> None:
    rng = np.random.default_rng(5)
    intervals = [median_interval(rng.normal(3.0, 1.0, 40), resamples=400) for _ in range(300)]
    covered = np.mean([low <= 3.0 <= high for low, high in intervals])
    # 95 %, give or take three standard errors (1.3 %) and what the bootstrap misses at 40 values.
    assert 0.90 < covered < 0.99
