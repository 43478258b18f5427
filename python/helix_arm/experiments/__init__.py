"""Experiments that measure an arm by fixed protocols: figures with standard errors, and a data sheet (docs/experiments.md).

>>> from helix_arm import Scene
>>> from helix_arm.experiments import SimulatedRig, measure
>>> scene = Scene.load("demo")
>>> result = measure("step", scene, SimulatedRig(scene), "out")     # figures, and the paths of the sheet

Needs NumPy, SciPy and matplotlib, but not ROS. A rig of your own is a class with the members of Rig.
"""
from helix_arm.experiments.figures import Figure
from helix_arm.experiments.protocol import Analysis, Curve, Experiment, Options, Plot, Trial
from helix_arm.experiments.rig import Inputs, Recording, Rig, SimulatedRig, read_series
from helix_arm.experiments.run import EXPERIMENTS, Progress, Result, measure

__all__ = ["Analysis", "Curve", "EXPERIMENTS", "Experiment", "Figure", "Inputs", "Options", "Plot", "Progress", "Recording", "Result",
           "Rig", "SimulatedRig", "Trial", "measure", "read_series"]
