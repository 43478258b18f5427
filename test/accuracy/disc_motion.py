#!/usr/bin/env python3
"""Motion of the model of order 2 beside the discs of disc_arm.py, which share no code with it: the same arm, masses and pressures.

usage: disc_motion.py [--discs N]
A second of steps of the pressures, from rest. Prints the RMS distance of the tips in % of the arm's length, of order 0 and 2; exits with
1 if order 2 is more than 1 % away.
"""
import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import disc_arm  # noqa: E402
import helix_arm  # noqa: E402

STEP_S, FREQUENCY_HZ, DAMPING = 0.001, 3.0, 0.2
SPREAD = 0.01  # part of the mass that is uniform along the arm and has all the rotary inertia
# Steps of the three pressures [kPa], each within 20 ms.
STEPS = ((0.0, (50, 100, 0)), (0.05, (250, 20, 60)), (0.4, (40, 300, 120)), (0.7, (0, 60, 280)))


def nominal_arm(discs):
    """The discs without what the scene does not know: uneven muscles, lag, play and dead time."""
    disc_arm.N, disc_arm.STROKES, disc_arm.UNEVEN, disc_arm.GROWTH = discs, (1, 1, 1), 0.0, 0.0
    disc_arm.PLAY_PA, disc_arm.DEAD_S, disc_arm.STEP_S = 0.0, 0.0, STEP_S
    return disc_arm.Arm(FREQUENCY_HZ, DAMPING, 1e-9)


def scene_of(arm):
    """The scene demo with the stiffness, masses and damping of the discs."""
    gamma, kappa = disc_arm.STIFFNESS[1], disc_arm.STIFFNESS[4]
    mass, radius = disc_arm.MASS_KG, disc_arm.DISC_M / 2**0.5
    discs = [{"section": "arm", "s": (k + 1) / disc_arm.N, "mass_kg": (1 - SPREAD) * mass / disc_arm.N} for k in range(disc_arm.N)]
    damping = {strain: float(arm.beta) for strain in ("stretch", "shear", "twist", "bend")}
    return helix_arm.Scene.load("demo", {
        "arm.stiffness": {"K_gamma": gamma, "K_tau_m2": 0, "K_kappa_m2": kappa, "K_eps_n": float(arm.scale * disc_arm.COEFFICIENTS[0])},
        "load": {"gravity_m_s2": [0, 0, 0], "mass_kg": SPREAD * mass, "points": discs},
        "dynamics": {"damping_s": damping, "inertia_radius_m": radius / SPREAD**0.5, "step_s": STEP_S}})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--discs", type=int, default=12)
    arm = nominal_arm(parser.parse_args().discs)
    scene = scene_of(arm)
    times = np.arange(0, 1 + STEP_S / 2, STEP_S)
    begins = [begin for at, _ in STEPS for begin in (at, at + 0.02)]
    columns = np.array([kpa for number, (_, kpa) in enumerate(STEPS) for kpa in (STEPS[max(number - 1, 0)][1], kpa)], float).T
    pressures, middles = (1e3 * np.column_stack([np.interp(at, begins, column) for column in columns])
                          for at in (times, times + STEP_S / 2))
    arm.played = pressures[0].copy()  # at rest there
    A, b = arm.balance(arm.played)
    arm.q = np.tile(np.linalg.solve(A, b) / disc_arm.N, (disc_arm.N, 1)).ravel()
    arm.delayed = [middles[0]]
    tips = []
    for k in range(len(times)):
        tips.append(arm.poses([(0, 1.0)])[0]["position_m"])
        arm.step(middles[min(k + 1, len(times) - 1)], STEP_S)
    tips, length = np.array(tips), disc_arm.COEFFICIENTS[0]
    errors = {}
    for order in (0, 2):
        found = scene.motion(pressures, times, start="rest", order=order).tips
        errors[order] = 100 * np.sqrt(((found - tips) ** 2).sum(axis=1).mean()) / length
        print("order %d: %.3f %% of the length RMS, %d discs" % (order, errors[order], disc_arm.N))
    return int(errors[2] > 1)


if __name__ == "__main__":
    sys.exit(main())
