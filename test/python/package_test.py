"""The package on the path: without ROS, beside the messages of the same name, installed."""
import argparse
import math
import os
import subprocess
import sys
import unittest

ARGUMENTS = argparse.Namespace()


class PackageTest(unittest.TestCase):
    def said(self, *command, **variables):
        """What it prints in an environment of these alone, without a word on stderr."""
        result = subprocess.run(command, env={"PATH": os.environ["PATH"], **variables}, capture_output=True, text=True, timeout=60)
        self.assertEqual(result.stderr, "")
        return result.stdout

    def test_import_needs_no_ros(self):
        # Whatever ROS has in the interpreter's own folders is hidden.
        code = ("import sys\n"
                "for name in ['rospy', 'roslib', 'genpy', 'rosbag', 'std_msgs']: sys.modules[name] = None\n"
                "import helix_arm\n"
                "print(helix_arm.Scene.load('helical_50').forward([0.0, 0.0, 0.0]).tips[0])\n")
        tip = float(self.said(sys.executable, "-c", code, PYTHONPATH=ARGUMENTS.path))
        self.assertAlmostEqual(tip, 0.42698 * math.cos(math.radians(15)), 3)

    def test_messages_of_the_same_name_are_there(self):
        code = ("import helix_arm\n"
                "from helix_arm.msg import PressureArray, FollowTipPathAction\n"
                "from helix_arm.srv import Reload\n"
                "print(PressureArray._type, helix_arm.Scene.load('demo').name)\n")
        self.assertEqual(self.said(sys.executable, "-c", code, PYTHONPATH=ARGUMENTS.path), "helix_arm/PressureArray demo\n")

    def test_setup_puts_it_on_the_path(self):
        code = "import helix_arm; print(helix_arm.shipped_scenes()[0])"
        told = self.said("bash", "-c", f"source '{ARGUMENTS.setup}' && '{sys.executable}' -c '{code}'")
        self.assertEqual(told, "annotated\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--path", required=True, help="folder of the package")
    parser.add_argument("--setup", required=True, help="setup.bash of the workspace")
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest])
