"""The model of a soft arm: pressures to shapes and back.

>>> import helix_arm, numpy as np
>>> scene = helix_arm.Scene.load("helical_50")
>>> scene.forward(np.array([200e3, 0.0, 50e3])).tips

Needs neither ROS nor a master. The messages of the nodes are in helix_arm.msg (those of actions, too) and helix_arm.srv, and
need the Python packages of ROS.
"""
from helix_arm._core import DocumentError, version as __version__
from helix_arm.dynamics import Dynamics
from helix_arm.results import (Alarm, Attainment, Budget, Calibration, Combination, Contraction, Curve, Evaluation, Fit, FollowRun,
                               Forward, Inverse, Jacobian, LinearMotion, Motion, Parameter, Payload, Sight, Workspace)
from helix_arm.scene import Scene, shipped_scenes

__all__ = ["Alarm", "Attainment", "Budget", "Calibration", "Combination", "Contraction", "Curve", "DocumentError", "Dynamics",
           "Evaluation", "Fit", "FollowRun", "Forward", "Inverse", "Jacobian", "LinearMotion", "Motion", "Parameter", "Payload", "Scene",
           "Sight", "Workspace", "__version__", "shipped_scenes"]
