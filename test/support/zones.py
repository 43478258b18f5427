"""A post in the way of the demo's arm, which is made thin: its tip moves by few of its own diameters."""
import os
import sys

import numpy as np
import yaml
from helix_arm import Scene

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from processes import SOURCE  # noqa: E402

DEMO = SOURCE + "/config/scenes/demo.yaml"
TOUCHES = [3e5, 0, 0]  # pressures at which the arm's tip is inside the post [Pa]
POST, ARM, LEAST = 0.005, 0.01, 0.005  # radii; clearance_m [m]


def with_post(touches, radius=POST):
    """Values of a scene: the post is where the tip is at these pressures. The base looks down: its x is -z of the world."""
    with open(DEMO) as file:
        section, = yaml.safe_load(file)["arm"]["sections"]
    x, y, z = (float(one) for one in Scene.load("demo").tips(touches))
    return {"arm.sections": [dict(section, separator_radius_m=ARM)], "clearance_m": LEAST,
            "keep_out": [{"name": "post", "sphere": {"radius_m": radius, "position_m": [z, y, 0.6 - x]}}]}


def clearance(pressures, touches, radius=POST):
    """Distance of the arm from the post, by many places along its curve [m]."""
    scene = Scene.load("demo")
    places = scene.curve(pressures, points=400).positions.reshape(-1, 3)
    return np.linalg.norm(places - scene.tips(touches), axis=1).min() - radius - ARM
