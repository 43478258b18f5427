#!/usr/bin/env python3
"""A plant for `helix_arm follow --plant`: three tilted muscles that lag, and a body that swings. The protocol is in
docs/closed_loop.md. Any simulator can take its place; this one knows the arm of the scene demo by a tape measure alone."""

import json
import math
import sys

LENGTH_M, TURN_RAD = 0.42, 4.3  # at rest, and how far the arm is turned from base to tip
STROKE_M = (0.095, 0.088, 0.085)  # of each muscle, no two of which are alike
SOFT_PA = 240e3  # a muscle contracts by tanh(p / SOFT_PA) of its stroke
BEND_PER_M = 5.0  # rad of bend by a metre of stroke in one muscle
LAG_S, FREQUENCY_HZ, DAMPING = 0.1, 3.0, 0.2
STEP_S = 1e-3


def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def pose(twist, s):
    """Position and quaternion at s of a curve with a constant twist [v; w]: Rodrigues' formula."""
    v, w = [s * x for x in twist[:3]], [s * x for x in twist[3:]]
    angle = max(math.hypot(*w), 1e-6)
    b, c = (1 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    wv = cross(w, v)
    position = [x + b * y + c * z for x, y, z in zip(v, wv, cross(w, wv))]
    half = math.sin(angle / 2) / angle
    return {"position_m": position, "quaternion_xyzw": [half * x for x in w] + [math.cos(angle / 2)]}


class Arm:
    def __init__(self):
        self.lagged = [0.0] * 3
        self.state, self.rate = [0.0] * 3, [0.0] * 3  # shortening [m], bends about y and z [rad]

    def step(self, pressure_pa, dt_s):
        for _ in range(max(1, round(dt_s / STEP_S))):
            self.lagged = [x + STEP_S / LAG_S * (p - x) for x, p in zip(self.lagged, pressure_pa)]
            pull = [stroke * math.tanh(max(p, 0.0) / SOFT_PA) for stroke, p in zip(STROKE_M, self.lagged)]
            around = [2 * math.pi * i / 3 for i in range(3)]
            goal = (sum(pull) / 3, -BEND_PER_M * sum(p * math.sin(a) for p, a in zip(pull, around)),
                    BEND_PER_M * sum(p * math.cos(a) for p, a in zip(pull, around)))
            turn = 2 * math.pi * FREQUENCY_HZ
            for i in range(3):
                self.rate[i] += STEP_S * (turn * turn * (goal[i] - self.state[i]) - 2 * DAMPING * turn * self.rate[i])
                self.state[i] += STEP_S * self.rate[i]

    def poses(self, places):
        left = 1 - self.state[0] / LENGTH_M
        twist = [LENGTH_M * left, 0.0, 0.0, TURN_RAD * left, self.state[1], self.state[2]]
        return [pose(twist, s) for _, s in places]


def serve(arm):
    first = json.loads(sys.stdin.readline())
    print(json.dumps({"ready": True, "poses": arm.poses(first["places"])}), flush=True)
    for line in sys.stdin:
        turn = json.loads(line)
        arm.step(turn["pressure_pa"], turn["dt_s"])
        print(json.dumps({"poses": arm.poses(first["places"])}), flush=True)


if __name__ == "__main__":
    serve(Arm())
