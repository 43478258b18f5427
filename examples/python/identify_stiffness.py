#!/usr/bin/env python3
"""Stiffness of an arm from a table of pressures and curvatures, with its standard error; writes the calibrated scene.

usage: identify_stiffness.py SCENE DATA.csv [--out calibrated.yaml]
The table has the columns pressure_1_kpa, pressure_2_kpa, .. and curvature_rad.
"""
import argparse
import csv
import pathlib

import helix_arm
import numpy as np


def read_columns(path):
    """A CSV file with # comments as a dict of columns."""
    with open(path, encoding="utf-8") as file:
        header, *rows = csv.reader(line for line in file if not line.startswith("#"))
    return dict(zip(header, np.array(rows, dtype=float).T.copy()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", help="shipped scene or path")
    parser.add_argument("data")
    parser.add_argument("--out", default="calibrated.yaml")
    arguments = parser.parse_args()

    scene = helix_arm.Scene.load(arguments.scene)
    data = read_columns(arguments.data)  # a place to leave out rows; the path of the file would do as well
    found = scene.calibrate(data, fit=["stiffness"])
    if not found.success:
        raise SystemExit(found.message)
    for one in found.parameters:
        known = f"+- {one.standard_error:.2g}" if one.identifiable else "(the data do not determine it)"
        print(f"{one.name} = {one.value:.4g} {one.unit} {known}; before {one.initial:.4g}")
    print(f"held-out error {found.held_out_error:.3g} {found.error_unit}")
    pathlib.Path(arguments.out).write_text(found.scene_text, encoding="utf-8")


if __name__ == "__main__":
    main()
