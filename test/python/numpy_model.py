"""The unloaded model of a straight or helical ring of muscles, written by hand from the paper's equations in NumPy: what the
tests expect, and what the benchmark compares with."""
import numpy as np

MAX_PRESSURE = 413.6856e3  # 60 psi as scenes have it [Pa]
# Fig. 3 of the paper, as printed for psi [m / psi^k].
FIG3_PER_PSI = [4.269760703e-1, -3.982361379e-4, -8.216242656e-5, 5.394266367e-7, 2.666729952e-8, -3.002668523e-10]
FIG3 = np.array([c * 60.0**k for k, c in enumerate(FIG3_PER_PSI)])  # of p / MAX_PRESSURE [m]


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def adjoint(R, p):
    """Ad of twists [v; w]."""
    return np.block([[R, skew(p) @ R], [np.zeros((3, 3)), R]])


def about(axis, angle):
    W = skew(axis)
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


def ring_poses(count, radius, tilt):
    """Poses of the muscles in the frame of the base curve: (R, p) each (MODEL, section 1)."""
    poses = []
    for i in range(count):
        angle = 2 * np.pi * i / count
        R = about([1.0, 0, 0], angle - np.pi / 2) @ about([0, 0, 1.0], -tilt)
        poses.append((R, radius * np.array([0, np.cos(angle), np.sin(angle)])))
    return poses


def ring_map(poses, gamma, tau, kappa):
    """A+ D of eq. 17, (6, n): twist of the section per length of each muscle."""
    n = len(poses)
    root = np.sqrt(np.array([1, gamma, gamma, tau, kappa, kappa]))
    scale = np.diag([1, 1, 1, 30.0, 30.0, 30.0])  # m and rad to about one unit
    stack, pull = [], []
    for i, (R, p) in enumerate(poses):
        inverse = adjoint(R.T, -R.T @ p)
        stack.append(root[:, None] * inverse @ scale)
        column = np.zeros((6, n))
        column[0, i] = 1.0
        pull.append(column)
    return scale @ np.linalg.lstsq(np.vstack(stack), np.vstack(pull), rcond=1e-12)[0]


class RingArm:
    """An arm of one section."""

    def __init__(self, count=3, radius=0.0254, tilt=0.0, gamma=10.0, tau=0.0, kappa=1.38e-4):
        self.poses = ring_poses(count, radius, tilt)
        self.map = ring_map(self.poses, gamma, tau, kappa)

    def lengths(self, pressures):
        return np.polynomial.polynomial.polyval(pressures / MAX_PRESSURE, FIG3)

    def twists(self, pressures):
        """(N, n) [Pa] to (N, 6)."""
        return self.lengths(pressures) @ self.map.T

    def tips(self, pressures):
        """(N, n) [Pa] to (N, 3) [m]: the translation of exp of the twist."""
        g = self.twists(np.atleast_2d(pressures))
        v, w = g[:, :3], g[:, 3:]
        x = np.einsum("ij,ij->i", w, w)
        near = x < 1e-4
        safe = np.where(near, 1.0, x)
        angle = np.sqrt(safe)
        b = np.where(near, 0.5 - x / 24 + x * x / 720, (1 - np.cos(angle)) / safe)
        c = np.where(near, 1 / 6 - x / 120 + x * x / 5040, (angle - np.sin(angle)) / (safe * angle))
        cross = np.cross(w, v)
        return v + b[:, None] * cross + c[:, None] * np.cross(w, cross)


def helical():
    return RingArm(tilt=np.radians(15), gamma=100.0, kappa=9.8e-5)
