"""Threads of Python that share a scene or an array, and those that outlive the interpreter."""
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path

import helix_arm
import numpy as np
from forward_test import pressures_of

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from test_size import draws


class Writer:
    """Another thread that writes NaN into an entry of every row, and what was there, in turn."""

    def __init__(self, rows):
        self.rows = rows
        self.good = rows[:, 1].copy()
        self.done = threading.Event()
        self.thread = threading.Thread(target=self.write)

    def write(self):
        while not self.done.is_set():
            self.rows[:, 1] = np.nan
            self.rows[:, 1] = self.good

    def __enter__(self):
        self.thread.start()

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()


class SharedArrayTest(unittest.TestCase):
    """Each call either raises, or returns what it returns of the rows before they were written."""

    def check(self, call, rows, calls):
        expected = call(rows)
        self.assertTrue(np.isfinite(expected).all())
        calls, refused, end = draws(calls // 10, calls), 0, time.monotonic() + 60
        with Writer(rows):
            while calls > 0 or (refused == 0 and time.monotonic() < end):
                calls -= 1
                try:
                    found = call(rows)
                except ValueError as error:
                    self.assertRegex(str(error), r"^(pressures_pa|start) (asks \S+ for nan|changed during the call)")
                    refused += 1
                else:
                    np.testing.assert_array_equal(found, expected)
        self.assertGreater(refused, 0, "nothing was written during the calls")

    def test_closed_form(self):
        scene = helix_arm.Scene.load("helical_50")
        wide = np.zeros((30_000, 5))
        wide[:, 1:4] = pressures_of(scene, 30_000)
        dense = pressures_of(scene, 30_000)
        for rows in [dense, np.asfortranarray(dense), wide[:, 1:4]]:
            self.check(scene.tips, rows, 300)
        self.check(lambda p: scene.forward(p, threads=2).tips, pressures_of(scene, 3000), 100)
        self.check(lambda p: scene.curve(p, points=3).positions, pressures_of(scene, 1000), 100)
        self.check(lambda p: scene.jacobian(p).tip_by_pressures, pressures_of(scene, 1000), 50)

# Daemon threads are within calls when the interpreter ends. Names with an underscore are the first that it clears, so their __del__
# runs between its end and that of the process: there, other calls return and their threads ask for the interpreter.
ENDING = """
import threading, helix_arm, numpy as np
scene = helix_arm.Scene.load({name!r})
p = np.random.default_rng(1).uniform(*scene.limits_pa.T, ({rows}, len(scene.limits_pa)))


def call():
    {call}


def work(begun):
    while True:
        call()
        begun.set()


class Late:
    def __del__(self):
        for _ in range({late}):
            call()
call()
events = [threading.Event() for _ in range(3)]
for one in events:
    threading.Thread(target=work, args=(one,), daemon=True).start()
for one in events:
    one.wait()
_late = Late()
"""


class EndOfInterpreterTest(unittest.TestCase):
    CALLS = [("helical_50", 20_000, "scene.forward(p, threads=0)"), ("helical_50", 500_000, "scene.tips(p, threads=0)"),
             ("loaded", 100, "scene.forward(p)"), ("helical_50", 300, "scene.curve(p, threads=0)"),
             ("helical_50", 3_000, "scene.jacobian(p, threads=0)"),
             ("spatial_50", 100, "scene.inverse(np.zeros((100, 3)), threads=0)"),
             ("helical_50", 1, "scene.workspace(100_000)"), ("helical_50", 1, "helix_arm.Scene.load('demo')"),
             ("demo", 1, "scene.localize(np.zeros((720, 1280), np.uint8))"),
             ("demo", 1, "scene.follow(scene.tips(p), seconds=1)")]

    def test_daemon_threads_within_calls_do_not_end_the_process(self):
        for name, rows, call in self.CALLS:
            with self.subTest(call=call):
                code = ENDING.format(name=name, rows=rows, call=call, late=draws(3, 20))
                result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
                self.assertEqual((result.returncode, result.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main()
