"""Formulas of ISO 9283:1998, Manipulating industrial robots: performance criteria and related test methods.

Positions in any frame and unit. attained: (n, 3), n >= 2 cycles at one commanded position (3,). Orientations are not measured.
"""
from __future__ import annotations

import numpy as np


def _deviations(attained: np.ndarray) -> np.ndarray:
    """(n, ..) distances l_j from the barycentre."""
    return np.linalg.norm(attained - attained.mean(axis=0), axis=-1)


def pose_accuracy(attained: np.ndarray, commanded: np.ndarray) -> float:
    """AP_P (7.2.1): distance of the barycentre from the commanded position."""
    return float(np.linalg.norm(attained.mean(axis=0) - commanded))


def pose_repeatability(attained: np.ndarray) -> float:
    """RP_l = mean(l) + 3 S_l (7.2.2), S_l with n - 1."""
    far = _deviations(attained)
    return float(far.mean() + 3 * far.std(ddof=1))


def distance_accuracy(first: np.ndarray, second: np.ndarray, commanded: float) -> float:
    """AD_P = mean(D) - D_c (7.3.2), of the distances between two positions in the same cycles."""
    return float(np.linalg.norm(first - second, axis=1).mean() - commanded)


def distance_repeatability(first: np.ndarray, second: np.ndarray) -> float:
    """RD = 3 S_D (7.3.3), to both sides."""
    return float(3 * np.linalg.norm(first - second, axis=1).std(ddof=1))


def accuracy_drift(first: np.ndarray, last: np.ndarray, commanded: np.ndarray) -> float:
    """dAP_P (7.6), with its sign: that of later cycles minus that of the first ones. The standard gives its size."""
    return pose_accuracy(last, commanded) - pose_accuracy(first, commanded)


def repeatability_drift(first: np.ndarray, last: np.ndarray) -> float:
    """dRP_P (7.6), with its sign."""
    return pose_repeatability(last) - pose_repeatability(first)


def path_accuracy(attained: np.ndarray, commanded: np.ndarray) -> float:
    """AT_P (8.2): largest distance of the barycentres from the commanded path. attained: (n, m, 3) where the paths of n cycles
    cross the planes normal to the commanded path at its m points (m, 3)."""
    return float(np.linalg.norm(attained.mean(axis=0) - commanded, axis=-1).max())


def path_repeatability(attained: np.ndarray) -> float:
    """RT_P = max(mean(l_i) + 3 S_li) over the points (8.3)."""
    far = _deviations(attained)
    return float((far.mean(axis=0) + 3 * far.std(axis=0, ddof=1)).max())
