#!/usr/bin/python3
"""The arm of the scene demo as a plant that shares no code with helix_arm, but the form of the elastic energy: six discs with six
strains between each two, inertia with Coriolis terms, Kelvin-Voigt damping, and muscles with dead time, lag and play, whose strokes
and stiffnesses are not those of the scene. Its protocol is that of `helix_arm follow --plant` (docs/closed_loop.md)."""

import argparse
import math
import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # in matrices as small as these, threads wait for each other: four times the time
import numpy as np  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "examples"))
import plant  # noqa: E402

N = 6  # discs
# Free length of a muscle, a quintic in p / P_REF [m].
COEFFICIENTS = [4.269760703e-1, -2.38941682740e-2, -2.95784735616000e-1, 1.165161535272000e-1, 3.4560820177920000e-1,
                -2.3348750434848000e-1]
P_REF = 413.6856e3
RADIUS, TILT = 0.0254, math.radians(15)
# The truth: K_gamma and K_kappa of the scene times 0.7 and 1.1; stiffness grows with pressure, up to P_REF.
STIFFNESS = (1, 70, 70, 1e-12, 1.1 * 9.8e-5, 1.1 * 9.8e-5)
STROKES, UNEVEN, GROWTH = (1.10, 0.93, 1.04), 0.05, 0.2
MASS_KG, DISC_M, PLAY_PA, DEAD_S, STEP_S = 0.5, 0.037, 5e3, 0.02, 0.005


# Each takes one, or any number of them in rows.


def skew(w):
    W = np.zeros(w.shape + (3,))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        W[..., k, j], W[..., j, k] = w[..., i], -w[..., i]
    return W


def adjoint(R, p):
    A = np.zeros(R.shape[:-2] + (6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., :3, 3:] = skew(p) @ R
    return A


def small_ad(g):
    A = np.zeros(g.shape + (6,))
    A[..., :3, :3] = A[..., 3:, 3:] = skew(g[..., 3:])
    A[..., :3, 3:] = skew(g[..., :3])
    return A


def exponential(g):
    angle = np.maximum(np.linalg.norm(g[..., 3:], axis=-1), 1e-6)[..., None, None]
    W = skew(g[..., 3:])
    a, b, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    W2 = W @ W
    return np.eye(3) + a * W + b * W2, ((np.eye(3) + b * W + c * W2) @ g[..., :3, None])[..., 0]


def tangent(g):
    """Body velocity by rates of g: series of the right Jacobian; strains of a segment are below 1 rad."""
    A, term = -small_ad(g), np.eye(6)
    out = term
    for k in range(2, 8):
        term = term @ A / k
        out = out + term
    return out


class Arm:
    def __init__(self, frequency_hz, damping, lag_s):
        self.lag = lag_s
        self.stroke = np.array(STROKES)
        self.uneven = np.array([1 + UNEVEN, 1 - UNEVEN, 1.0])
        self.inverse_ad = []
        for i in range(3):
            th = 2 * math.pi * i / 3
            turn = Rotation.from_euler("XZ", [th - math.pi / 2, -TILT]).as_matrix()
            self.inverse_ad.append(np.linalg.inv(adjoint(turn, RADIUS * np.array([0, math.cos(th), math.sin(th)]))))
        self.K = np.diag(STIFFNESS)
        self.inertia = np.diag([MASS_KG / N] * 3 + [MASS_KG / N * DISC_M**2 / 2] + [MASS_KG / N * DISC_M**2 / 4] * 2)
        self.lagged = np.zeros(3)
        self.played = np.zeros(3)
        self.delayed = [np.zeros(3)] * max(1, round(DEAD_S / 0.01) + 1)
        A, b = self.balance(np.zeros(3))
        g = np.linalg.solve(A, b)
        self.q = np.tile(g / N, (N, 1)).ravel()
        self.v = np.zeros(6 * N)
        # Scale of the stiffness at which the lowest mode at rest has the frequency.
        M = self.mass(self.bodies(self.q)[2])
        big = np.kron(np.eye(N), A * N)
        lowest = np.sort(np.linalg.eigvals(np.linalg.solve(M, big)).real)[0]
        turn = 2 * math.pi * frequency_hz
        self.scale = turn**2 / lowest
        self.beta = 2 * damping / turn

    def free_lengths(self, p):
        x = np.clip(p, 0, P_REF) / P_REF
        contraction = sum(c * x**k for k, c in enumerate(COEFFICIENTS) if k > 0)
        return COEFFICIENTS[0] + self.stroke * contraction

    def balance(self, p):
        """A g = b of the whole arm's twist."""
        A, b, lengths = np.zeros((6, 6)), np.zeros(6), self.free_lengths(p)
        for i in range(3):
            k = self.uneven[i] * (1 + GROWTH * max(p[i], 0) / P_REF)
            J = self.inverse_ad[i]
            A += k * J.T @ self.K @ J
            b += k * J.T @ self.K[:, 0] * lengths[i]
        return A, b

    def bodies(self, q):
        """Rotations and places of the base and of each disc, and Jacobians of the discs, (N, 6, 6 N)."""
        g = q.reshape(N, 6)
        E, e = exponential(g)
        back, own = np.swapaxes(E, 1, 2), tangent(g)
        inverse = adjoint(back, -(back @ e[..., None])[..., 0])
        R, p, J = [np.eye(3)], [np.zeros(3)], np.zeros((N + 1, 6, 6 * N))
        for j in range(N):
            J[j + 1] = inverse[j] @ J[j]
            J[j + 1, :, 6 * j:6 * j + 6] += own[j]
            R.append(R[j] @ E[j])
            p.append(p[j] + R[j] @ e[j])
        return R, p, J[1:]

    def mass(self, J):
        return (np.swapaxes(J, 1, 2) @ self.inertia @ J).sum(axis=0) + 1e-9 * np.eye(6 * N)

    def step(self, pressure, dt):
        self.delayed.append(np.array(pressure))
        source = self.delayed.pop(0)
        n = max(1, round(dt / STEP_S))
        h = dt / n
        for _ in range(n):
            self.lagged = self.lagged + (1 - math.exp(-h / self.lag)) * (source - self.lagged)
            self.played = np.clip(self.played, self.lagged - PLAY_PA, self.lagged + PLAY_PA)
            A, b = (self.scale * part for part in self.balance(self.played))
            K = np.kron(np.eye(N), A * N)
            D = self.beta * K
            J = self.bodies(self.q)[2]
            V, M = J @ self.v, self.mass(J)
            acceleration = (self.bodies(self.q + 1e-4 * self.v)[2] @ self.v - V) / 1e-4
            turning = (np.swapaxes(small_ad(V), 1, 2) @ (V @ self.inertia)[..., None])[..., 0]
            inertial = np.einsum("nij,ni->j", J, acceleration @ self.inertia - turning)
            force = np.tile(b, N) - K @ self.q - D @ self.v - inertial
            dv = np.linalg.solve(M + h / 2 * D + h * h / 4 * K, h * force - h * h / 2 * (K @ self.v))
            self.q = self.q + h * (self.v + dv / 2)
            self.v = self.v + dv

    def poses(self, places):
        s = N * np.array([s for _, s in places])
        j = np.minimum(s.astype(int), N - 1)
        E, e = exponential(self.q.reshape(N, 6)[j] * (s - j)[:, None])
        R, p = (np.array(of_disc)[j] for of_disc in self.bodies(self.q)[:2])
        found = zip((p + (R @ e[..., None])[..., 0]).tolist(), Rotation.from_matrix(R @ E).as_quat().tolist())
        return [{"position_m": place, "quaternion_xyzw": turn} for place, turn in found]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frequency", type=float, default=3.0, help="of the lowest mode at rest [Hz]")
    parser.add_argument("--damping", type=float, default=0.2, help="its ratio")
    parser.add_argument("--lag", type=float, default=0.1, help="of the muscles [s]")
    o = parser.parse_args()
    plant.serve(Arm(o.frequency, o.damping, o.lag))


if __name__ == "__main__":
    main()
