"""An arm in motion, step by step, and its small motions for linear control."""
from __future__ import annotations

from typing import Any, Dict, Optional, Sequence, Union

import numpy as np

from helix_arm import _core, arguments, results
from helix_arm.arguments import require

Numbers = Union[np.ndarray, Sequence[Any]]
Start = Union[str, Numbers]
ENERGIES = ["kinetic", "elastic", "potential", "dissipated", "work"]


def start_of(given: Start) -> Any:
    """"rest", "straight", or a state (2, n)."""
    if isinstance(given, str):
        require(given in ("rest", "straight"), f"start is {arguments.text(given, 'start')[:40]}; expected rest, straight or a state (2, n)")
    return given


def order_and_step(order: Optional[int], step_s: Optional[float]) -> Dict[str, Any]:
    return {"order": None if order is None else arguments.integer(order, "order", 0, 4),
            "step_s": None if step_s is None else arguments.number(step_s, "step_s", 1e-6, 0.1)}


class Dynamics:
    """An arm that moves when step() is called; Scene.dynamics() makes one. Of one thread at a time."""

    def __init__(self, scene: _core.Scene, pressures_pa: Numbers, start: Start, order: Optional[int],
                 step_s: Optional[float]) -> None:
        self._core = _core.Dynamics(scene, **order_and_step(order, step_s))
        self.restart(pressures_pa, start)

    def restart(self, pressures_pa: Numbers, start: Start = "rest") -> None:
        """Starts anew at pressures (n,) [Pa], to which the actuators have responded; start as of Scene.motion()."""
        self._core.start(pressures_pa, start_of(start))
        self.time_s = 0.0  #: since the start [s]

    def step(self, pressures_pa: Numbers, seconds: float) -> np.ndarray:
        """Moves on by a time [s], while pressures go evenly from those of the last call to these (n,) [Pa].

        Returns the tip (3,), base frame [m]. RuntimeError if a step finds no solution.
        """
        seconds = arguments.number(seconds, "seconds", 1e-6, 1e3)
        self._core.step(pressures_pa, seconds)
        self.time_s += seconds
        return self.tip

    @property
    def state(self) -> np.ndarray:
        """(2, n) coordinates and their rates per second: by sections, by degrees of the strain, v [m] and w [rad] (in a plane v_x,
        v_y, w_z)."""
        return self._core.now()[0]

    @property
    def tip(self) -> np.ndarray:
        """(3,) position of the tip, base frame [m]."""
        return self._core.now()[1]

    @property
    def quaternion_xyzw(self) -> np.ndarray:
        """(4,) x, y, z, w of the tip's frame, base frame; w >= 0."""
        return self._core.now()[2]

    @property
    def energy_j(self) -> Dict[str, float]:
        """Since the start [J]: kinetic + elastic + potential + dissipated = work."""
        return dict(zip(ENERGIES, self._core.now()[3]))

    def linearised(self, pressures_pa: Numbers) -> results.LinearMotion:
        """Small motions about the equilibrium under load at pressures (n,) [Pa]: x' = A x + B u, tip = C x, where x are the
        deviations of coordinates and rates, and u those of the effective pressures, behind lag and play of the actuators.
        """
        found = self._core.linearised(pressures_pa)
        mass, damping, stiffness, by_input, tip_by, position = [
            found.pop(name) for name in ("mass", "damping", "stiffness", "by_input", "tip_by", "position")]
        n = len(mass)
        forces = np.linalg.solve(mass, np.hstack([-stiffness, -damping, by_input]))
        A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), forces[:, :2 * n]])
        B = np.vstack([np.zeros_like(by_input), forces[:, 2 * n:]])
        return results.LinearMotion(A=A, B=B, C=np.hstack([tip_by, np.zeros_like(tip_by)]),
                                    state=np.array([position, np.zeros(n)]), tip=found["tip"],
                                    frequencies_hz=np.array(found["frequencies_hz"]),
                                    damping_ratios=np.array(found["damping_ratios"]))
