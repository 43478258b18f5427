#!/usr/bin/env python3
"""The simulated arm draws a circle with its tip, with the model alone and with the loop closed over vision.

usage: follow_circle.py [SCENE] [--radius-m R] [--period-s T] [--out circle.png]
"""
import argparse

import helix_arm
import numpy as np


def circle(centre, radius_m, period_s, points=201):
    """Way points in the base frame, in the plane across the arm: (points, 4) times [s] and positions [m]."""
    angle = np.linspace(0, 2 * np.pi, points)
    offset = radius_m * np.column_stack([np.zeros(points), np.cos(angle), np.sin(angle)])
    return np.column_stack([period_s * angle / (2 * np.pi), centre + offset])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", default="demo", help="shipped scene or path, with camera and tags")
    parser.add_argument("--radius-m", type=float, default=0.02)
    parser.add_argument("--period-s", type=float, default=20.0)
    parser.add_argument("--out", default="circle.png")
    arguments = parser.parse_args()

    scene = helix_arm.Scene.load(arguments.scene)
    middle = scene.tips(scene.limits_pa.mean(axis=1))
    path = circle(middle, arguments.radius_m, arguments.period_s)
    seconds = arguments.period_s + 10  # the tip first moves to the start
    runs = {"model alone": scene.follow(path=path, seconds=seconds, open=True),
            "closed over vision": scene.follow(path=path, seconds=seconds)}

    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(5, 5))
    axes.plot(1e3 * path[:, 2], 1e3 * path[:, 3], "k--", label="wanted")
    for name, run in runs.items():
        if run.path_rms_m is None:
            raise SystemExit(f"{name}: the path did not begin: {run.vented or 'the time was too short'}")
        on_path = run.path_times_s >= 0
        axes.plot(*1e3 * run.true_tips[on_path, 1:].T, label=f"{name}: {1e3 * run.path_rms_m:.2f} mm RMS")
        print(f"{name}: {1e3 * run.path_rms_m:.2f} mm RMS, {1e3 * run.path_max_m:.2f} mm at most")
    axes.set(xlabel="y [mm]", ylabel="z [mm]", aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15))
    figure.savefig(arguments.out, bbox_inches="tight")


if __name__ == "__main__":
    main()
