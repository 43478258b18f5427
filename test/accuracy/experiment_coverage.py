#!/usr/bin/python3
"""How often the 95 % intervals of helix_arm.experiments hold the truth, on arms that share no code with the package.

Each rig has regulators with a lag, muscles with dead time, lag, play and creep, a mode, a valve that comes to rest a little differently
each time, noise of readings and camera, and pictures in which the tip is not seen. The truth of a figure is what its definition gives
for the rig's motion without noise, every 10 ms, or the rig's own parameter; of those of ISO 9283, the mean over many experiments; of
AT and RT, with the motion of this one, since play keeps the way in which the arm came to the circle.

usage: experiment_coverage.py [--rigs N] [--seed N] [--experiments a,b,c] [--camera] [--ringing] [--check]
  --camera    the simulated rig of demo, of other stiffness, measured by its tags
  --ringing   rigs of little damping and lag, whose steps show both figures of the mode
  --check   on few rigs in place of 50: exit code 1 where intervals hold the truth in too few cases, or a bias exceeds what chance and a third of the error allow
"""
import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from helix_arm import Scene
from helix_arm.experiments import EXPERIMENTS, Options, Recording, SimulatedRig, iso9283
from helix_arm.experiments.repeatability import attained_of

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from test_size import draws

STEP_S, RATE_HZ, NAMES = 0.01, 30.0, ["muscle_1", "muscle_2", "muscle_3"]
QUICK = {"step": 5, "hysteresis": 5, "bode": 6, "repeatability": 12, "stiffness": 4, "payload": 4, "creep": 12, "workspace": 24}


class OwnRig:
    """An arm of three muscles; a recording has all rows, and `truth` the same without noise, with the tip in every row."""

    def __init__(self, scene, seed, ringing):
        r = self.random = np.random.default_rng(seed)
        self.limits_pa, self.slew_pa_s, self.rate_hz, self.hangs, self.origin = scene.limits_pa, 5e5, RATE_HZ, True, f"own {seed}"
        self.regulator, self.lag, self.dead = r.uniform(0.03, 0.15), np.exp(r.uniform(np.log(0.02), np.log(0.6))), r.integers(0, 5)
        self.lag *= 0.1 if ringing else 1.0
        self.play, self.play_share = r.uniform(2e3, 8e3), r.uniform(0.4, 1.0)
        self.creep, self.creep_s = r.uniform(0.02, 0.25), r.uniform(4, 20)
        self.frequency, self.damping = r.uniform(1.5, 4), r.uniform(0.05, 0.15 if ringing else 0.5)
        self.valve, self.noise_pa, self.noise_m, self.unseen = 200.0, r.uniform(1e3, 5e3), r.uniform(1e-4, 5e-4), 0.03
        self.stroke = r.uniform(0.8, 1.2, 3)
        self.compliance = np.diag(r.uniform(2e-3, 8e-3, 3)) * r.uniform(0.7, 1.3)
        self.force, self.late = np.zeros(3), 2 + seed % 4  # late: rows of the regulator's dead time

    def hang(self, force):
        self.force = force

    def tips(self, pressure):
        """(m, 3) of an arc that the muscles bend and shorten."""
        pull = self.stroke * np.tanh(pressure / 3e5) * 0.05
        around = 2 * np.pi * np.arange(3) / 3
        bend = np.stack([pull @ np.cos(around), pull @ np.sin(around)], axis=1) / 0.04
        length, angle = 0.4 - pull.mean(axis=1), np.maximum(np.linalg.norm(bend, axis=1), 1e-9)
        side = length * (1 - np.cos(angle)) / angle
        return np.stack([length * np.sin(angle) / angle, side * bend[:, 0] / angle, side * bend[:, 1] / angle], axis=1)

    def lagged(self, value, time_s):
        keep = np.exp(-STEP_S / time_s)
        return lfilter([1 - keep], [1, -keep], value, axis=0, zi=keep * value[:1])[0]

    def delayed(self, value, rows):
        return np.concatenate([np.repeat(value[:1], rows, axis=0), value])[:len(value)]

    def played(self, value):
        out = np.empty_like(value)
        for column in range(value.shape[1]):
            at = value[0, column]
            for row, one in enumerate(value[:, column].tolist()):
                at = min(max(at, one - self.play), one + self.play)
                out[row, column] = at
        return self.play_share * out + (1 - self.play_share) * value

    def swung(self, value):
        turn = 2 * np.pi * self.frequency
        fall, angle = np.exp(-self.damping * turn * STEP_S), turn * np.sqrt(1 - self.damping**2) * STEP_S
        a = np.array([1, -2 * fall * np.cos(angle), fall**2])
        start = value[:1]
        return start + lfilter([a.sum()], a, value - start, axis=0)

    def motion(self, targets):
        pressure = self.delayed(self.lagged(targets, self.regulator), self.late)
        fast = self.played(self.lagged(self.delayed(pressure, self.dead), self.lag))
        effective = (1 - self.creep) * fast + self.creep * self.lagged(fast, self.creep_s)
        return pressure, self.tips(self.swung(effective)) + self.compliance @ self.force

    def record(self, inputs, stop, sink):
        r, time = self.random, STEP_S * np.arange(1, round(inputs.time_s[-1] / STEP_S) + 1)
        targets = inputs.at(time)
        still = np.append(False, np.all(np.diff(targets, axis=0) == 0, axis=1))
        arrivals = np.cumsum(np.append(0, np.diff(still.astype(int)) > 0))

        def motion():
            return self.motion(targets + np.where(still[:, None], self.valve * r.standard_normal((arrivals[-1] + 1, 3))[arrivals], 0.0))

        looks = np.diff(np.floor(np.append(0, time) * RATE_HZ + 1e-9)) > 0
        moved = motion()

        def again(noisy=True, same=True):
            pressure, tips = moved if same else motion()
            if noisy:
                tips = tips + self.noise_m * r.standard_normal(tips.shape)
                tips[~looks | (r.random(len(time)) < self.unseen)] = np.nan
                pressure = pressure + self.noise_pa * r.standard_normal(pressure.shape)
            return Recording(time, targets, pressure, tips)

        self.truth, self.again = Recording(time, targets, *self.motion(targets)), again
        return again()


def step_truth(rig, trials):
    out = {}
    for name, (_, true, _) in trials.items():
        i = int(np.argmax(np.ptp(true.target_pa, axis=0)))
        target, time = true.target_pa[:, i], true.time_s
        low, high = np.median(target[300:700]), target.max()
        starts = {"up": np.flatnonzero((target[:-1] == low) & (target[1:] > low)),
                  "down": np.flatnonzero((target[:-1] == high) & (target[1:] < high))}
        every = np.sort(np.concatenate(list(starts.values())))
        for way, rows in starts.items():
            found = {}
            for row in rows[1:]:
                later = every[every > row]
                end = later[0] if len(later) else np.flatnonzero(target[row + 100:] < low)[0] + row + 99
                for what, values in (("pressure", true.measured_pa[:, i:i + 1]), ("tip", true.tip_m)):
                    start = values[(time > time[row] - 1) & (time <= time[row])].mean(axis=0)
                    final = values[(time > 0.2 * time[row] + 0.8 * time[end]) & (time <= time[end])].mean(axis=0)
                    part = (values[row:end + 1] - start) @ (final - start) / np.sum((final - start) ** 2)
                    for words, level in (("5 % time", 0.05), ("63 % time", 0.63), ("90 % time", 0.9), ("98 % time", 0.98)):
                        k = int(np.argmax(part >= level))
                        found.setdefault((words, what), []).append(STEP_S * (k - (part[k] - level) / (part[k] - part[k - 1])))
                    found.setdefault(("overshoot", what), []).append(100 * (part[:int(0.8 * len(part))].max() - 1))
            out.update({f"{name} {way} {words}, {what}": np.mean(values) for (words, what), values in found.items()})
            out[f"{name} {way} dead time, pressure"] = (rig.late - 0.5) * STEP_S  # lagged() takes a row's target before its time
        out[f"{name} frequency"], out[f"{name} damping ratio"] = rig.frequency, rig.damping
    return out


def bode_truth(rig, trials):
    out = {}
    still = {one.name: one.value for one in EXPERIMENTS["bode"].analyse({key: one[1] for key, one in trials.items()}, NAMES).figures}
    for name, (recording, true, _) in trials.items():
        actuator, period = name.split(" ")[0], int(float(name.split(" ")[2]) / STEP_S)
        i = int(np.argmax(np.ptp(true.target_pa, axis=0)))
        end = len(true.time_s) - 200
        X, Y = (np.fft.rfft(values[end - period:end], axis=0) for values in (true.target_pa[:, i], true.tip_m))
        lines = np.flatnonzero(np.abs(X) > 0.03 * np.abs(X[1:]).max())
        lines = lines[lines > 0]
        ratio = Y[lines] / X[lines, None]
        direction = np.real(ratio[0]) / np.linalg.norm(np.real(ratio[0]))
        G, f = ratio @ direction, lines / (period * STEP_S)
        fall = 20 * np.log10(np.abs(G / G[0])) + 3
        k = int(np.argmax(fall < 0))
        corner = np.exp(np.interp(0, [-fall[k - 1], -fall[k]], np.log([f[k - 1], f[k]])))
        passed, near = f <= corner, int(np.argmin(np.abs(f - 1)))
        pictures = recording.seen()[end - period:end].sum()
        signal = np.abs(G[passed] * X[lines[passed]] * 2 / period) ** 2
        out.update({f"{actuator} gain": 1e6 * abs(G[0]), f"{actuator} gain at {f[near]:.3g} Hz": 1e6 * abs(G[near]),
                    f"{actuator} phase at {f[near]:.3g} Hz": np.degrees(np.angle(G[near])), f"{actuator} -3 dB frequency": corner,
                    f"{actuator} coherence": np.mean(signal / (signal + 4 * rig.noise_m**2 / pictures)) + still[f"{actuator} coherence"] - 1,
                    f"{actuator} delay": -np.polyfit(2 * np.pi * f[passed], np.unwrap(np.angle(G[passed])), 1)[0]})
    return out


def mean_figures(name, trials, draws=12, kept="", **how):
    """Of recordings that differ in the noise alone or, without noise, in the valve, since play adds up only what it pushes on."""
    found = {}
    for _ in range(draws):
        for one in EXPERIMENTS[name].analyse({key: one[2](**how) for key, one in trials.items()}, NAMES, Scene.load("demo")).figures:
            found.setdefault(one.name, []).append(one.value)
    return {name: np.mean(values) for name, values in found.items() if None not in values and name.endswith(kept)}


def hysteresis_truth(rig, trials):
    """Widths and strokes of all rows between the turns, without the package; play and lag of other motions."""
    out = mean_figures("hysteresis", trials, kept=(" play", " lag"), noisy=False, same=False)
    for name, (_, true, _) in trials.items():
        target, pressure = (values[:, np.argmax(np.ptp(true.target_pa, axis=0))] for values in (true.target_pa, true.measured_pa))
        tops = np.flatnonzero((np.diff(target[:-1]) > 0) & (np.diff(target[1:]) <= 0) & (target[1:-1] > target.mean())) + 1
        lows = [a + int(np.argmin(target[a:b])) for a, b in zip(tops, tops[1:])]
        chord, half, widths = true.tip_m[tops[0]] - true.tip_m[lows[0]], len(tops) // 2, []
        tip = true.tip_m @ (chord / np.linalg.norm(chord))
        for begin, top, end in zip(lows, tops[1:], lows[1:]):
            nodes = pressure[end] + np.linspace(0.2, 0.8, 121) * (pressure[top] - pressure[end])
            up, down = (np.interp(nodes, *np.array(sorted(zip(pressure[a:b], tip[a:b]))).T) for a, b in ((begin, top), (top, end)))
            widths.append((down - up) / (tip[top] - tip[end]))
        out[f"{name} stroke"] = 1e3 * np.mean(tip[tops[1:half]] - tip[lows[1:half]])
        for period, some in ((32, widths[:half - 1]), (8, widths[half:])):
            out[f"{name} loop width at {period} s"] = 100 * np.mean(some, axis=0).max()
    return out


def repeatability_truth(rig, trials):
    """Means over many experiments that differ in the valve and in the noise alone."""
    circles = {name: one for name, one in trials.items() if name.startswith("circle")}
    found = {name: 1e-3 * value for name, value in mean_figures("repeatability", circles, 20).items()}
    (_, true, _), draws, drawn, scene = trials["poses"], 300, [], Scene.load("demo")
    poses, r = attained_of(true), np.random.default_rng(5)
    for target, tips in poses.values():
        slope = np.array([rig.tips(target[None] + 100 * e)[0] - rig.tips(target[None])[0] for e in np.eye(3)]).T / 100
        valve, noise = r.standard_normal((2, draws, *tips.shape))
        drawn.append(tips + (valve @ (rig.valve * slope * (1 - rig.creep)).T + rig.noise_m / np.sqrt(30 * (1 - rig.unseen)) * noise))
    wanted = [scene.tips(target) for target, _ in poses.values()]
    for k, some in enumerate(drawn):
        found[f"P{k + 1} accuracy"] = np.mean([iso9283.pose_accuracy(one, wanted[k]) for one in some])
        found[f"P{k + 1} repeatability"] = np.mean([iso9283.pose_repeatability(one) for one in some])
    found["P2-P4 distance repeatability"] = np.mean([iso9283.distance_repeatability(a, b) for a, b in zip(drawn[1], drawn[3])])
    distance = np.linalg.norm(wanted[1] - wanted[3])
    found["P2-P4 distance accuracy"] = np.mean([iso9283.distance_accuracy(a, b, distance) for a, b in zip(drawn[1], drawn[3])])
    third = len(drawn[0][0]) // 3
    found["P1 drift of accuracy"] = np.mean([iso9283.accuracy_drift(one[:third], one[-third:], wanted[0]) for one in drawn[0]])
    found["P1 drift of repeatability"] = np.mean([iso9283.repeatability_drift(one[:third], one[-third:]) for one in drawn[0]])
    return {name: 1e3 * value for name, value in found.items()}


TRUTHS = {
    "step": step_truth, "bode": bode_truth, "repeatability": repeatability_truth, "hysteresis": hysteresis_truth,
    "stiffness": lambda rig, _: {f"stiffness along {'xyz'[k]} at {level} %": 1e-3 / rig.compliance[k, k]
                                 for k in range(3) for level in (20, 60)},
    "payload": lambda rig, _: {"shift by a payload": 1e3 * np.linalg.norm(rig.compliance @ Scene.load("demo")._rotation_WB[2]) * 0.05 * 9.81},
    **{key: lambda _, trials, key=key: mean_figures(key, trials, noisy=False, same=False) for key in ("creep", "workspace")}}


def judged(name, scene, seed, ringing):
    """(symbol, (value - truth) / standard error) of the figures that have both."""
    rig, trials = OwnRig(scene, seed, ringing), {}
    for trial in EXPERIMENTS[name].plan(rig, scene, Options([0, 1, 2], QUICK[name])):
        rig.hang(np.zeros(3) if trial.force_n is None else trial.force_n)
        recording = rig.record(trial.inputs, lambda: "", lambda rows: None)
        trials[trial.name] = recording, rig.truth, rig.again
    truth = TRUTHS[name](rig, trials)
    figures = EXPERIMENTS[name].analyse({key: pair[0] for key, pair in trials.items()}, NAMES, scene).figures
    return [(one.symbol + (" pressure" if one.name.endswith("pressure") else ""), (one.value - truth[one.name]) / one.standard_error)
            for one in figures if one.value is not None and one.name in truth]


def judged_by_camera(name, scene, seed):
    """The same of a simulated rig that is seen by its tags; the truth is what the figure's definition gives for the true tip."""
    r, seen, true = np.random.default_rng(seed), {}, {}
    stiffness = {f"simulation.arm.K_{key}_scale": str(r.uniform(0.8, 1.25)) for key in ("kappa", "gamma", "eps")}
    rig = SimulatedRig(scene, Scene.load("demo", stiffness), seed=seed)
    for trial in EXPERIMENTS[name].plan(rig, scene, Options([0, 1, 2], QUICK[name])):
        rig.hang(np.zeros(3) if trial.force_n is None else trial.force_n)
        seen[trial.name] = rig.record(replace(trial.inputs, name=trial.name), lambda: "", lambda rows: None)
        true[trial.name] = replace(seen[trial.name], tip_m=rig.true_tip_m)
    truth = {one.name: one.value for one in EXPERIMENTS[name].analyse(true, NAMES, scene).figures if one.value is not None}
    return [(one.symbol, (one.value - truth[one.name]) / one.standard_error)
            for one in EXPERIMENTS[name].analyse(seen, NAMES, scene).figures if one.value is not None and one.name in truth]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--experiments", default=",".join(TRUTHS))
    parser.add_argument("--ringing", action="store_true")
    parser.add_argument("--camera", action="store_true")
    parser.add_argument("--check", action="store_true")
    o = parser.parse_args()
    scene, bad, rigs = Scene.load("demo"), 0, o.rigs or (draws(1, 3) if o.check else 50)
    print(f"{'experiment':<15}{'figure':<14}{'number':>7}{'in 95 %':>9}{'bias':>8}")
    for name in o.experiments.split(","):
        found = {}
        for seed in range(o.seed, o.seed + rigs):
            for symbol, deviation in judged_by_camera(name, scene, seed) if o.camera else judged(name, scene, seed, o.ringing):
                found.setdefault(symbol, []).append(deviation)
        for symbol, values in found.items():
            held, bias, chance = np.mean(np.abs(values) <= 1.96), np.median(values), 1 / np.sqrt(len(values))
            wrong = held < 0.9 - 3 * 0.3 * chance - 1e-9 or abs(bias) > 1 / 3 + 3 * 1.25 * chance
            bad += wrong
            print(f"{name:<15}{symbol:<14}{len(values):>7}{100 * held:>7.0f} %{bias:>8.2f}{'  !' if wrong else ''}", flush=True)
    return 1 if bad and o.check else 0


if __name__ == "__main__":
    sys.exit(main())
