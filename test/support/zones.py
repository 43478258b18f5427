"""A post in the way of the demo's arm."""
import numpy as np
from helix_arm import Scene

TOUCHES = [3e5, 0, 0]  # pressures at which the arm's tip is inside the post [Pa]
POST = 0.005  # radius [m]


def zones():
    """keep_out of a scene with the demo's base, which looks down: x of the base is -z of the world."""
    x, y, z = Scene.load("demo").tips(TOUCHES)
    return [{"name": "post", "sphere": {"radius_m": POST, "position_m": [float(one) for one in (z, y, 0.6 - x)]}}]


def clearance(scene, pressures):
    """Distance of the arm from the post, by many places along its curve [m]."""
    places = np.asarray(scene.curve(pressures, points=400).positions_m).reshape(-1, 3)
    return np.linalg.norm(places - scene.tips(TOUCHES), axis=1).min() - POST - 0.0374
