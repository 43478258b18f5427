"""Figures of an arm and their standard errors.

A standard error is here such that value +- 1.96 standard errors is the 95 % interval: of few repeats, the scatter of the mean is
multiplied by the quantile of Student's t over that of the normal distribution.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

NORMAL = float(stats.norm.ppf(0.975))


@dataclass(frozen=True)
class Figure:
    """A figure of the data sheet.

    name: unique in its experiment, with the actuator where it is of one: "muscle_1 up t63 tip". symbol: as in the definition's
    source. value: None where the data do not determine it, and then `definition` says why. standard_error: as above; None with the
    value. unit: SI or what a lab says: "s", "mm", "%", "Hz", "N/mm", "1". definition: one sentence, with its source.
    """

    name: str
    symbol: str
    value: Optional[float]
    standard_error: Optional[float]
    unit: str
    definition: str

    @staticmethod
    def unknown(name: str, symbol: str, unit: str, why: str) -> "Figure":
        return Figure(name, symbol, None, None, unit, f"Not identifiable: {why}")


def t_factor(freedom: float) -> float:
    """By which a standard deviation with so many degrees of freedom is multiplied."""
    return float(stats.t.ppf(0.975, freedom)) / NORMAL


def of_repeats(values: Sequence[float]) -> Tuple[float, float]:
    """Mean of independent repeats (>= 2), and its standard error by Student's t."""
    array = np.asarray(values, float)
    return float(array.mean()), float(array.std(ddof=1) / np.sqrt(len(array)) * t_factor(len(array) - 1))


def jackknife(parts: Sequence[Any], figure: Callable[[Sequence[Any]], float]) -> Tuple[float, float]:
    """A figure of independent parts (>= 2) without its bias of first order, and its standard error, by leaving out each part in
    turn."""
    count = len(parts)
    left = np.array([figure([*parts[:i], *parts[i + 1:]]) for i in range(count)])
    value = count * figure(parts) - (count - 1) * left.mean()
    return float(value), float(np.sqrt((count - 1) * left.var()) * t_factor(count - 1))


def bootstrap(parts: np.ndarray, figure: Callable[[np.ndarray], float], draws: int = 300, seed: int = 1) -> Tuple[float, float]:
    """A figure of independent parts (r, ..) as it is, and its standard error by drawing parts with replacement."""
    generator, count = np.random.default_rng(seed), len(parts)
    drawn = [figure(parts[generator.integers(0, count, count)]) for _ in range(draws)]
    return float(figure(parts)), float(np.std(drawn) * np.sqrt(count / (count - 1)) * t_factor(count - 1))


def correlated_mean(values: np.ndarray) -> Tuple[float, float]:
    """Mean of readings (m,) in their order, m >= 3, and its standard error; those correlated in time count as fewer."""
    rest, count = values - values.mean(), len(values)
    square = float(rest @ rest)
    correlation = min(max(float(rest[1:] @ rest[:-1]) / square, 0.0), 0.95) if square > 0 else 0.0
    independent = max(count * (1 - correlation) / (1 + correlation), 2.0)
    return float(values.mean()), float(np.sqrt(square / (count - 1) / independent) * t_factor(independent - 1))
