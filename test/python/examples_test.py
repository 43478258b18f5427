"""Scripts of examples/python run, and say what is true."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from test_size import full_size_only

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples/python"


class ExamplesTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_example(self, name, *arguments):
        result = subprocess.run([sys.executable, str(EXAMPLES / name), *map(str, arguments)], cwd=self.folder,
                                capture_output=True, text=True, timeout=600)
        self.assertEqual((result.returncode, result.stderr), (0, ""), result.stdout)
        return result.stdout

    def test_follow_circle(self):
        text = self.run_example("follow_circle.py", "--period-s", 8)
        alone, closed = [float(number) for number in re.findall(r"([\d.]+) mm RMS", text)]
        self.assertLess(closed, 1.5)
        self.assertGreater(alone, 3 * closed)
        self.assertEqual((self.folder / "circle.png").read_bytes()[1:4], b"PNG")

    def test_sampling_mpc(self):
        text = self.run_example("sampling_mpc.py", "--samples", 120)
        planned, closed, learning = [float(number) for number in re.findall(r"after ([\d.]+) s", text)]
        self.assertLess(planned, 0.8 * closed)
        self.assertLess(planned, 0.5 * learning)
        self.assertLess(float(re.search(r"([\d.]+) mm RMS", text).group(1)), 1.5)

    @full_size_only
    def test_real_arms(self):
        data = EXAMPLES.parents[2] / "shared/data"
        if not data.exists():
            self.skipTest(f"{data} is absent: recordings of other people's arms have no licence to be shipped")
        environment = dict(os.environ, PATH=f"{EXAMPLES.parents[1]}/build/bin:{os.environ['PATH']}")
        text = subprocess.run([sys.executable, str(EXAMPLES.parent / "real_arms.py"), str(data)], cwd=self.folder,
                              capture_output=True, text=True, timeout=800, env=environment, check=True).stdout
        errors = {name: float(error) for name, error in re.findall(r"^(\w+ \w+).*\] +([\d.]+) ", text, re.MULTILINE)}
        bounds = {"three chambers": 4.2,  # [mm]; a cubic with lag and creep has 3.9
                  "two sections": 4.5,  # [mm]; a cubic with a lag has 4.5
                  "Koopman arm": 0.36,  # of its unit; a cubic with a lag has 0.36
                  "fabric arm": 3.5}  # [mm]; a cubic with a lag has 5.3
        self.assertEqual(set(errors), set(bounds))
        for arm, error in errors.items():
            self.assertLess(error, bounds[arm], arm)


if __name__ == "__main__":
    unittest.main()
