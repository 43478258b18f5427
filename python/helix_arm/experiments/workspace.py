"""Where the tip gets to, and whether the model says so."""
from __future__ import annotations

from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError
from scipy.stats import qmc

from helix_arm.experiments.figures import Figure
from helix_arm.experiments.protocol import Analysis, Course, Curve, Options, Plot, Recordings, Trial
from helix_arm.experiments.repeatability import LOOK_S, NO_SCENE, holds_of
from helix_arm.experiments.rig import Rig
from helix_arm.scene import Scene

PLACES, MOST_CORNERS, VISITS = 32, 32, 3
DRAWS, POINTS = 100, 4000  # of the bootstrap; in the predicted hull


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """Corners of the limits, if they are few, and a Halton sequence within them, each held; three times in the same order, of which the first conditions."""
    course, count = Course(rig), len(rig.limits_pa)
    shares = qmc.Halton(count, scramble=False).random(options.repeats or PLACES)
    if 2**count <= MOST_CORNERS:
        shares = np.concatenate([np.array(np.meshgrid(*[(0.0, 1.0)] * count)).reshape(count, -1).T[1:], shares])
    for share in np.tile(shares, (VISITS, 1)):
        course.go(course.share(share)).hold((options.hold_s or 2 * options.settle_s) + LOOK_S)
    return [Trial("places", course.inputs())]


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: pressures that are held for 2 s or more, each at least twice."""
    places: Dict[Tuple[int, ...], List[Tuple[np.ndarray, np.ndarray]]] = {}
    for recording in recordings.values():
        for target, tip, _ in holds_of(recording):
            places.setdefault(tuple(np.round(1e-2 * target).astype(int)), []).append((target, tip))
    held = [one for one in places.values() if len(one) > 1]
    if scene is None or len(held) < 8:
        why = NO_SCENE if scene is None else "fewer than eight places are visited twice."
        return Analysis([Figure.unknown("model error", "e", "mm", why)])
    predicted = scene.tips(np.clip([one[0][0] for one in held], *scene.limits_pa.T))
    visits = [np.array([tip for _, tip in one[len(one) > 2:]]) for one in held]
    reached = np.array([one.mean(axis=0) for one in visits])
    scatter = np.sqrt(np.mean([one.var(axis=0, ddof=1) for one in visits], axis=0))
    noise = scatter / np.sqrt([len(one) for one in visits])[:, None]
    generator = np.random.default_rng(1)
    drawn = [reached + noise * generator.standard_normal(reached.shape) for _ in range(DRAWS)]

    def of(figure: Callable[[np.ndarray], float]) -> Tuple[float, float]:
        # Noise acts on the draws as it did on the readings: their mean tells the bias that it makes.
        values = [figure(one) for one in drawn]
        return 2 * figure(reached) - float(np.mean(values)), float(np.std(values))

    def rms(tips: np.ndarray) -> float:
        return 1e3 * float(np.sqrt(np.mean(np.sum((tips - predicted) ** 2, axis=1))))

    rows = [("model error", "e", "mm", rms, "RMS distance of the tip at rest from the model's"),
            ("reach", "R", "mm", lambda tips: 1e3 * float(np.linalg.norm(tips, axis=1).max()), "Largest distance of the tip from the base")]
    try:
        hull = ConvexHull(predicted)
        inside = predicted[generator.integers(0, len(predicted), (POINTS, 4))]
        weights = generator.dirichlet(np.ones(4), POINTS)
        points = np.einsum("pk,pkd->pd", weights, inside)
        rows += [("reached volume", "V", "%", lambda tips: 100 * float(ConvexHull(tips).volume / hull.volume),
                  "Volume of the convex hull of the tips by that of the model's tips at the same pressures"),
                 ("coverage", "C", "%", lambda tips: 100 * float(np.mean(Delaunay(tips).find_simplex(points) >= 0)),
                  "Part of 4000 places between the model's tips that lies in the convex hull of the measured ones")]
    except QhullError:  # an arm in a plane
        pass
    out = Analysis([Figure(name, symbol, *of(figure), unit, f"{text}, {len(held)} places; scatter between the visits.")
                    for name, symbol, unit, figure, text in rows])
    for across, up in ((1, 2), (1, 0)):
        out.plots.append(Plot("Tips at rest", f"{'xyz'[across]} [mm]", f"{'xyz'[up]} [mm]",
                              [Curve(1e3 * tips[:, across], 1e3 * tips[:, up], label, style)
                               for tips, label, style in ((reached, "measured", "o"), (predicted, "model", "x"))]))
    return out
