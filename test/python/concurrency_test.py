"""Threads of Python that outlive the interpreter."""
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from test_size import draws


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
