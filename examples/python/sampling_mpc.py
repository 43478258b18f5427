#!/usr/bin/env python3
"""Sampling model predictive control on the batch: in every step thousands of pressure sequences are drawn about the last plan,
computed at once, and averaged by how well they do (MPPI). The true arm is softer and longer than the model, so its tip is off by
what the model does not know; a measured offset of the tip removes that.

usage: sampling_mpc.py [SCENE] [--steps N] [--samples M]
"""
import argparse

import helix_arm
import numpy as np

STEP_S = 0.05
LAG_S = 0.15  # of the valves
HORIZON = 8
SPREAD_PA = 2e4
TEMPERATURE_M2 = 1e-5


def pressures_after(pressures, commands):
    """First-order lag of the valves, one step."""
    return commands + (pressures - commands) * np.exp(-STEP_S / LAG_S)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", default="helical_50", help="shipped scene or path")
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--samples", type=int, default=2000)
    arguments = parser.parse_args()

    model = helix_arm.Scene.load(arguments.scene)
    K_kappa = 1.1 * 9.8e-5
    true_arm = helix_arm.Scene.load(arguments.scene, {"arm.stiffness.K_kappa_m2": K_kappa, "arm.stiffness.K_gamma": 80})
    lower, upper = model.limits_pa.T
    random = np.random.default_rng(1)

    wanted = model.tips(lower + np.resize([0.6, 0.2, 0.3], len(lower)) * (upper - lower))
    pressures = lower.copy()
    plan = np.tile(pressures, (HORIZON, 1))
    offset = np.zeros(3)  # of the true tip from the model's
    errors = []
    for _ in range(arguments.steps):
        commands = plan + SPREAD_PA * random.standard_normal((arguments.samples, HORIZON, len(lower)))
        commands[0] = plan
        commands = np.clip(commands, lower, upper)
        there = np.empty_like(commands)
        state = np.broadcast_to(pressures, commands[:, 0].shape)
        for k in range(HORIZON):
            state = there[:, k] = pressures_after(state, commands[:, k])
        tips = model.tips(there.reshape(-1, len(lower)), threads=0).reshape(arguments.samples, HORIZON, 3)
        cost = ((tips + offset - wanted) ** 2).sum(axis=(1, 2))
        weights = np.exp(-(cost - cost.min()) / TEMPERATURE_M2)
        plan = np.einsum("s,skn->kn", weights / weights.sum(), commands)

        pressures = np.clip(pressures_after(pressures, plan[0]), lower, upper)
        plan = np.vstack([plan[1:], plan[-1:]])
        true_tip = true_arm.tips(pressures)
        offset = true_tip - model.tips(pressures)
        errors.append(np.linalg.norm(true_tip - wanted))
    last = np.array(errors[-len(errors) // 4:])
    print(f"{arguments.samples * HORIZON} tips per step; error {1e3 * errors[0]:.1f} mm at first, "
          f"{1e3 * np.sqrt(np.mean(last**2)):.2f} mm RMS in the last quarter")


if __name__ == "__main__":
    main()
