"""The experiments by their names, in the order of `all`."""
from typing import Dict

from helix_arm.experiments import bode, creep, hysteresis, loads, repeatability, step, workspace
from helix_arm.experiments.protocol import Experiment

# `step` tells the others how long the arm takes to rest; `workspace` finds a wrong model before hours are spent.
EXPERIMENTS: Dict[str, Experiment] = {
    "step": Experiment("step response of pressure and tip", step.plan, step.analyse),
    "workspace": Experiment("reached against predicted tips", workspace.plan, workspace.analyse),
    "hysteresis": Experiment("loop of the tip over the pressure at two rates", hysteresis.plan, hysteresis.analyse),
    "bode": Experiment("frequency response of the tip", bode.plan, bode.analyse),
    "repeatability": Experiment("accuracy and repeatability by ISO 9283", repeatability.plan, repeatability.analyse),
    "stiffness": Experiment("stiffness of the tip", loads.plan_stiffness, loads.analyse_stiffness, "hang"),
    "payload": Experiment("what a payload does", loads.plan_payload, loads.analyse_payload, "hang"),
    "creep": Experiment("creep at a held pressure, and fatigue", creep.plan, creep.analyse),
}
