"""The model of numpy_model.RingArm in PyTorch, with its derivatives by automatic differentiation: what the benchmark compares
with where PyTorch (python3-torch) is installed."""
import numpy as np
import torch

import numpy_model


class TorchArm:
    def __init__(self, arm):
        self.map = torch.from_numpy(np.ascontiguousarray(arm.map.T))

    def tips(self, pressures):
        """(N, n) tensor [Pa] to (N, 3) [m]."""
        x = pressures / numpy_model.MAX_PRESSURE
        lengths = torch.full_like(x, numpy_model.FIG3[-1])
        for coefficient in numpy_model.FIG3[-2::-1]:
            lengths = lengths * x + coefficient
        g = lengths @ self.map
        v, w = g[:, :3], g[:, 3:]
        square = (w * w).sum(dim=1, keepdim=True)
        near = square < 1e-4
        safe = torch.where(near, torch.ones_like(square), square)
        angle = safe.sqrt()
        b = torch.where(near, 0.5 - square / 24 + square**2 / 720, (1 - angle.cos()) / safe)
        c = torch.where(near, 1 / 6 - square / 120 + square**2 / 5040, (angle - angle.sin()) / (safe * angle))
        cross = torch.cross(w, v, dim=1)
        return v + b * cross + c * torch.cross(w, cross, dim=1)

    def jacobian(self, pressures):
        """(N, n) tensor [Pa] to tips (N, 3) [m] and their derivatives (N, 3, n) [m/Pa]: each row has its own pressures, so that the
        derivative of a sum over rows is that of each row."""
        pressures = pressures.detach().requires_grad_()
        tips = self.tips(pressures)
        rows = [torch.autograd.grad(tips[:, i].sum(), pressures, retain_graph=True)[0] for i in range(3)]
        return tips.detach(), torch.stack(rows, dim=1)
