#!/usr/bin/env python3
"""The Python package beside the batch in C++ and beside the same model written in NumPy and, where python3-torch is installed, in
PyTorch, in the same run; medians of processor time.

usage: python_benchmark.py --batch KINEMATICS_BENCHMARK
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "python"))
import helix_arm
import numpy_model

try:
    import torch
    import torch_model
except ImportError:
    torch = None

ROWS = 1_000_000
TURNS = 7
BATCH_ROWS = 10_000
DERIVATIVE_ROWS = 20_000


def median_s(function, repeats=9):
    """Processor time of this thread, which other programs on the machine disturb least."""
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        function()
        times.append(time.thread_time() - begin)
    return statistics.median(times)


def single_s(function, calls=20_000):
    def many():
        for _ in range(calls):
            function()
    return median_s(many, 5) / calls


def cpp_batch_s(program):
    """The batch of C++: a million pressures to tips, from columns to columns."""
    with tempfile.NamedTemporaryFile() as file:
        subprocess.run([program, "--benchmark_filter=^batch/helical", "--benchmark_min_time=0.05",
                        "--benchmark_out_format=json", "--benchmark_out=" + file.name], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        found = json.load(file)["benchmarks"]
    times = [one["cpu_time"] for one in found if one["name"] == "batch/helical_median"]
    assert len(times) == 1 and found[0]["time_unit"] == "ms"
    return 1e-3 * times[0]


def torch_s(scene, by_hand, rows):
    """PyTorch on one thread: tips, then tips with their derivatives by the pressures, per row [s]; and jacobian() of the
    package by the pressures, then by everything."""
    torch.set_num_threads(1)
    arm = torch_model.TorchArm(by_hand)
    few = rows[:DERIVATIVE_ROWS]
    tips, by_pressures = arm.jacobian(torch.from_numpy(few))
    np.testing.assert_allclose(tips.numpy(), scene.tips(few), atol=1e-10)
    np.testing.assert_allclose(by_pressures.numpy(), scene.jacobian(few, by="pressures").tip_by_pressures[:, :3], atol=1e-12)
    tensor = torch.from_numpy(rows)
    with torch.no_grad():
        alone = median_s(lambda: arm.tips(tensor), 3) / len(rows)
    derived = median_s(lambda: arm.jacobian(tensor[:DERIVATIVE_ROWS]), 3) / len(few)
    ours = [median_s(call, 9) / len(few) for call in [lambda: scene.jacobian(few, by="pressures"), lambda: scene.jacobian(few)]]
    return (alone, derived, *ours)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batch", required=True, help="the program kinematics_benchmark")
    program = parser.parse_args().batch

    scene = helix_arm.Scene.load("helical_50")
    by_hand = numpy_model.helical()
    rows = np.random.default_rng(1).uniform(0, scene.limits_pa[0, 1], (ROWS, 3))
    out = np.empty((ROWS, 3))
    np.testing.assert_allclose(scene.tips(rows[:100]), by_hand.tips(rows[:100]), atol=1e-10)

    turns = [(cpp_batch_s(program), median_s(lambda: scene.tips(rows, out=out))) for _ in range(TURNS)]
    cpp, into = (statistics.median(column) for column in zip(*turns))
    ratio = statistics.median(ours / reference for reference, ours in turns)
    numpy_s = median_s(lambda: by_hand.tips(rows), 3)
    print(f"{'batch of 1e6 pressures to tips, one thread':<58} ns per row   to C++")
    for name, seconds, part in [("C++, columns to columns", cpp, 1.0), ("tips(pressures, out=...)", into, ratio),
                                ("the same model in NumPy", numpy_s, numpy_s / cpp)]:
        print(f"  {name:<56} {1e9 * seconds / ROWS:10.2f} {part:8.2f}")

    if torch is None:
        print("  PyTorch is not installed (python3-torch)")
    else:
        alone, derived, by_pressures, by_all = torch_s(scene, by_hand, rows)
        print(f"  {'the same model in PyTorch':<56} {1e9 * alone:10.2f} {alone * ROWS / cpp:8.2f}")
        print(f"derivatives of {DERIVATIVE_ROWS} rows, one thread")
        for name, seconds in [("tips by pressures in PyTorch", derived),
                              ("jacobian(by=\"pressures\"): tips, orientations, twists", by_pressures),
                              ("jacobian(): also by lengths and stiffness", by_all)]:
            print(f"  {name:<56} {1e9 * seconds:10.2f} {seconds / derived:8.2f} to PyTorch")

    def batches():
        for i in range(0, ROWS, BATCH_ROWS):
            scene.forward(rows[i:i + BATCH_ROWS])
    print("forward(): tips, quaternions, twists")
    for name, function in [(f"batches of {BATCH_ROWS} rows, in the memory of the one before", batches),
                           ("1e6 rows, in new memory", lambda: scene.forward(rows))]:
        print(f"  {name:<56} {1e9 * median_s(function) / ROWS:10.2f}")
    one = np.array([1e5, 2e5, 5e4])
    for name, function in [("tips(pressures)", lambda: scene.tips(one)), ("forward(pressures)", lambda: scene.forward(one)),
                           ("the same model in NumPy", lambda: by_hand.tips(one))]:
        print(f"one row: {name:<49} {1e6 * single_s(function):10.2f} us")
    damping = {"stretch": 0.01, "shear": 0.01, "twist": 0.01, "bend": 0.02}
    moving = helix_arm.Scene.load("demo", {"load": {"mass_kg": 0.2}, "dynamics": {"damping_s": damping}})
    pressures = np.repeat(np.random.default_rng(1).uniform(0, 3e5, (1000, 6, 3)), 10, axis=1)[:, :51]
    start = time.perf_counter()
    moving.motion(pressures, np.linspace(0, 1, 51), threads=0)
    print(f"1000 rollouts of a second, all threads {time.perf_counter() - start:28.2f} s")


if __name__ == "__main__":
    main()
