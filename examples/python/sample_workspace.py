#!/usr/bin/env python3
"""Reachable tips of an arm: a million samples, the farthest tips, and how densely the samples fill space.

usage: sample_workspace.py [SCENE] [--points N] [--out workspace.npz]
"""
import argparse
import time

import helix_arm
import numpy as np


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", default="spatial_50", help="shipped scene or path")
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--out", default="workspace.npz")
    arguments = parser.parse_args()

    scene = helix_arm.Scene.load(arguments.scene)
    begin = time.perf_counter()
    found = scene.workspace(arguments.points, extremes=True)
    print(f"{len(found.tips)} tips in {time.perf_counter() - begin:.2f} s")
    for name, tip in zip(["-x", "-y", "-z", "+x", "+y", "+z", "far"], found.extreme_tips):
        print(f"{name:>3}: {np.round(1e3 * tip, 1)} mm")
    density, edges = np.histogramdd(found.tips, bins=24)
    print(f"{np.count_nonzero(density)} of {density.size} cells are reached")
    np.savez_compressed(arguments.out, tips=found.tips, pressures_pa=found.pressures_pa, density=density,
                        edges_m=np.array(edges))


if __name__ == "__main__":
    main()
