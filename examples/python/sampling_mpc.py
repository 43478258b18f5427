#!/usr/bin/env python3
"""Sampling model predictive control of an arm that swings: in every step hundreds of pressure sequences are drawn about the last
plan, moved by the arm's equations of motion, and averaged by how well they do (MPPI). The closed loop brings the same arm to the
same tip, with a scene that tells masses and damping, and with one that does not. Settling times, until the tip stays within 2 mm + 5 %
of the step, are printed.

The true arm is 5 % stiffer in bending than the model, and its tip is measured with 0.3 mm of noise. The controller never sees the
true state: its own arm follows the same commands, and the measured tip corrects its state and a slow offset (a Luenberger observer).

usage: sampling_mpc.py [--samples N] [--png FILE]
"""
import argparse

import helix_arm
import numpy as np

STEP_S = 0.05
LAG_S = 0.15  # of the valves
HORIZON = 10
SECONDS = 2.0
SPREAD_PA = 3e4
TEMPERATURE_M2 = 5e-6
NOISE_M = 3e-4
OFFSET_GAIN, POSITION_GAIN, RATE_GAIN = 0.15, 0.4, 3.0  # of the observer, per step; of the rates [1/s]
# 1.5 Hz with a damping ratio of 0.05: masses and stiffness, whose ratio counts, and weight that hangs in balance.
DAMPING = {"damping_s": {"stretch": 0.0106, "shear": 0.0106, "twist": 0.0106, "bend": 0.0106}, "step_s": 0.01}
SWINGING = {"arm.stiffness.K_eps_n": 60, "load": {"mass_kg": 1.76, "gravity_m_s2": [0, 0, 0]}, "dynamics": DAMPING}
STIFFER = {"arm.stiffness.K_kappa_m2": 1.05 * 9.8e-5}
RIG = {"K_kappa_scale": 1.05, "dynamics": {"mass_kg": 1.76, "K_eps_n": 60, **DAMPING}}


def settling_time(times, errors):
    """When the error is within 2 mm + 5 % of the first one for good [s]; NaN if never."""
    outside = np.flatnonzero(errors > 2e-3 + 0.05 * errors[0])
    if len(outside) == 0:
        return 0.0
    return times[outside[-1] + 1] - times[0] if outside[-1] + 1 < len(times) else np.nan


def lagged(pressures, commands):
    """Pressures behind the valves at the end of each step (samples, horizon, n), from the present ones (n,)."""
    keep, state, out = np.exp(-STEP_S / LAG_S), pressures, np.empty_like(commands)
    for k in range(commands.shape[1]):
        state = out[:, k] = commands[:, k] + (state - commands[:, k]) * keep
    return out


def mpc(model, true_arm, wanted, samples):
    """Times and errors of the true tip under model predictive control, from rest without pressure."""
    random = np.random.default_rng(1)
    lower, upper = model.limits_pa.T
    slew = 5e5 * STEP_S  # as safety.slew_kpa_s of the scene
    pressures, command = lower.copy(), lower.copy()
    plan = np.tile(command, (HORIZON, 1))
    plant, own = true_arm.dynamics(pressures), model.dynamics(pressures)
    to_position = np.linalg.pinv(own.linearised(pressures + 1e5).C[:, :own.state.shape[1]])
    offset, times, errors = np.zeros(3), [], []
    horizon_s = STEP_S * np.arange(HORIZON + 1)
    for step in range(int(SECONDS / STEP_S)):
        times.append(step * STEP_S)
        errors.append(np.linalg.norm(plant.tip - wanted))
        noise = SPREAD_PA * random.standard_normal((samples, HORIZON, len(lower)))
        noise[0] = 0
        commands = plan + (noise + np.roll(noise, 1, axis=1)) / 2
        for k in range(HORIZON):  # within limits and slew rate
            before = commands[:, k - 1] if k else command
            commands[:, k] = np.clip(np.clip(commands[:, k], before - slew, before + slew), lower, upper)
        rows = np.concatenate([np.broadcast_to(pressures, (samples, 1, len(lower))), lagged(pressures, commands)], axis=1)
        tips = model.motion(rows, horizon_s, start=own.state, threads=0).tips
        cost = ((tips[:, 1:] + offset - wanted)**2).sum(axis=(1, 2))
        weights = np.exp(-(cost - cost.min()) / (TEMPERATURE_M2 * HORIZON))
        plan = np.einsum("s,skn->kn", weights / weights.sum(), commands)
        command = plan[0]
        pressures = lagged(pressures, plan[None, :1])[0, 0]
        plan = np.vstack([plan[1:], plan[-1:]])
        measured = plant.step(pressures, STEP_S) + NOISE_M * random.standard_normal(3)
        surprise = measured - own.step(pressures, STEP_S) - offset
        offset += OFFSET_GAIN * surprise
        own.restart(pressures, own.state + np.outer([POSITION_GAIN, RATE_GAIN], to_position @ surprise))
    return np.array(times), np.array(errors)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=200)
    parser.add_argument("--png", help="picture of both errors over time")
    arguments = parser.parse_args()
    model = helix_arm.Scene.load("demo", SWINGING)
    vibration = model.dynamics().linearised([100e3, 50e3, 50e3])
    print(f"The arm swings at {vibration.frequencies_hz[0]:.2f} Hz, damping ratio {vibration.damping_ratios[0]:.3f}.")
    wanted = model.tips([200e3, 60e3, 20e3])
    times, errors = mpc(model, helix_arm.Scene.load("demo", {**SWINGING, **STIFFER}), wanted, arguments.samples)
    runs = {f"predictive control, {1e3 * np.sqrt(np.mean(errors[-10:]**2)):.2f} mm RMS in the last half second": (times, errors)}
    for name, changes in {"closed loop": SWINGING, "closed loop that learns how the arm swings": {}}.items():
        run = helix_arm.Scene.load("demo", {**changes, "simulation.arm": RIG}).follow(wanted, seconds=3 * SECONDS)
        seen = ~np.isnan(run.wanted_tips[:, 0])
        runs[name] = (run.times_s[seen], np.linalg.norm(run.true_tips - wanted, axis=1)[seen])
    for name, (run_times, run_errors) in runs.items():
        print(f"settled after {settling_time(run_times, run_errors):.2f} s: {name}")
    if arguments.png:
        import matplotlib
        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
        axes = plt.figure(figsize=(7, 4)).add_subplot(xlabel="time [s]", ylabel="error of the tip [mm]")
        for name, (run_times, run_errors) in runs.items():
            axes.plot(run_times - run_times[0], 1e3 * run_errors, label=name.split(",")[0])
        axes.legend()
        axes.grid(True)
        axes.figure.savefig(arguments.png, dpi=120)


if __name__ == "__main__":
    main()
