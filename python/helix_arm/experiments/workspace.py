"""Where the tip gets to, and whether the model says so."""
from __future__ import annotations

from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError
from scipy.stats import qmc

from helix_arm.experiments.figures import Figure, jackknife
from helix_arm.experiments.protocol import Analysis, Course, Curve, Options, Plot, Recordings, Trial
from helix_arm.experiments.repeatability import LOOK_S, NO_SCENE, held_of
from helix_arm.experiments.rig import Rig
from helix_arm.scene import Scene

PLACES, MOST_CORNERS, VISITS = 32, 32, 3  # VISITS: after the first one
POINTS = 4000  # in the predicted hull


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """Corners of the limits, if they are few, and a Halton sequence within them, each held; again and again in the same order."""
    course, count = Course(rig), len(rig.limits_pa)
    shares = qmc.Halton(count, scramble=False).random(options.repeats or PLACES)
    if 2**count <= MOST_CORNERS:
        shares = np.concatenate([np.array(np.meshgrid(*[(0.0, 1.0)] * count)).reshape(count, -1).T[1:], shares])
    for share in np.tile(shares, (VISITS + 1, 1)):
        course.go(course.share(share)).hold((options.hold_s or options.settle_s) + LOOK_S)
    return [Trial("places", course.inputs())]


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: pressures that are held for 2 s or more, each at least three times."""
    held = held_of(recordings.values())
    visits = len(held[0]) if held else 0
    if scene is None or len(held) < 8 or visits < 3:
        why = NO_SCENE if scene is None else "fewer than eight places are visited three times."
        return Analysis([Figure.unknown("model error", "e", "mm", why)])
    predicted = scene.tips(np.clip([one[0][0] for one in held], *scene.limits_pa.T))
    reached = np.array([[tip for _, tip in one[1:]] for one in held])  # the first visit conditions
    farthest = int(np.argmax(np.linalg.norm(reached.mean(axis=1), axis=1)))

    rows: List[Tuple[str, str, str, Callable[[np.ndarray], float], str]] = [
        ("model error", "e", "mm", lambda tips: 1e3 * float(np.sqrt(np.mean(np.sum((tips - predicted) ** 2, axis=1)))),
         "RMS distance of the tip at rest from the model's"),
        ("reach", "R", "mm", lambda tips: 1e3 * float(np.linalg.norm(tips[farthest])), "Largest distance of the tip from the base")]
    try:
        hull, generator = ConvexHull(predicted), np.random.default_rng(1)
        points = np.einsum("pk,pkd->pd", generator.dirichlet(np.ones(4), POINTS),
                           predicted[generator.integers(0, len(predicted), (POINTS, 4))])
        rows += [("reached volume", "V", "%", lambda tips: 100 * float(ConvexHull(tips).volume / hull.volume),
                  "Volume of the convex hull of the tips by that of the model's tips at the same pressures"),
                 ("coverage", "C", "%", lambda tips: 100 * float(np.mean(Delaunay(tips).find_simplex(points) >= 0)),
                  f"Part of {POINTS} places between the model's tips that lies in the convex hull of the measured ones")]
    except QhullError:  # an arm in a plane
        pass
    out = Analysis()
    for name, symbol, unit, figure, text in rows:
        value, error = jackknife(list(reached.swapaxes(0, 1)), lambda some: figure(np.mean(some, axis=0)))
        out.figures.append(Figure(name, symbol, value, max(error, 100 / POINTS if symbol == "C" else 0.0), unit,
                                  f"{text}, {len(held)} places, mean of the visits; jackknife over these."))
    for across, up in ((1, 2), (1, 0)):
        out.plots.append(Plot("Tips at rest", f"{'xyz'[across]} [mm]", f"{'xyz'[up]} [mm]",
                              [Curve(1e3 * tips[:, across], 1e3 * tips[:, up], label, style)
                               for tips, label, style in ((reached.mean(axis=1), "measured", "o"), (predicted, "model", "x"))]))
    return out
