"""What debian/ and the wheel say of the package is true of it: libraries, and the packages that they are built with."""
import argparse
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[1]
ARGUMENTS = argparse.Namespace()
OURS = re.compile(r"libhelix_arm_(\w+)\.so")


def linked(path):
    """Names of the libraries that a library is loaded with."""
    listed = subprocess.run(["ldd", path], stdout=subprocess.PIPE, check=True).stdout.decode()
    return re.findall(r"^\s*(lib\S+)", listed, re.MULTILINE)


def control():
    """Fields of each paragraph of debian/control: the source, then the packages."""
    paragraphs = re.split(r"\n\n+", (ROOT / "debian/control").read_text(encoding="utf-8").strip())
    return [dict(re.findall(r"^(\S+):((?:.*\n?(?: .*\n?)*))", paragraph, re.MULTILINE)) for paragraph in paragraphs]


def packages_of(field):
    return set(re.findall(r"[\w.+-]+", re.sub(r"\(.*?\)|\$\{.*?\}", "", field)))


class PackagingTest(unittest.TestCase):
    def test_the_module_alone_has_its_libraries_and_no_ros(self):
        names = linked(ARGUMENTS.module)
        ours = {name for name in names if OURS.match(name)} | {"libhelix_arm_media.so"}  # loaded at its first use
        self.assertGreater(len(ours), 5)
        self.assertFalse([name for name in names if re.match("lib(ros|xmlrpcpp|tf2|rviz)", name)])
        installed = (ROOT / "debian/python3-helix-arm.install").read_text(encoding="utf-8")
        self.assertEqual({match.group() for match in OURS.finditer(installed)}, ours)
        wheel = (ROOT / "cmake/python_alone.cmake").read_text(encoding="utf-8")
        targets = re.search(r"install\(TARGETS(.*?)LIBRARY", wheel, re.DOTALL).group(1).split()
        self.assertEqual({"lib%s.so" % target for target in targets}, ours)

    def test_the_packages_that_it_is_built_with_and_that_it_needs_are_named(self):
        wanted = re.findall(r"^(?:all|debian): *(.*)", (ROOT / "scripts/packages.txt").read_text(encoding="utf-8"), re.MULTILINE)
        source, whole, *_ = control()
        named = packages_of(source["Build-Depends"]) | packages_of(whole["Depends"]) | packages_of(whole["Recommends"])
        without = {"ccache", "make", "librostest-dev", "python3-rostest"}  # what catkin_make and tests need
        self.assertEqual(packages_of(" ".join(wanted)) - named - without, set())

    def test_package_and_wheel_have_the_version_of_the_command(self):
        said = subprocess.run([ARGUMENTS.command, "--version"], stdout=subprocess.PIPE, check=True).stdout.decode().split()[-1]
        wheel = subprocess.run([sys.executable, "setup.py", "--version"], cwd=ROOT, stdout=subprocess.PIPE, check=True)
        self.assertEqual(wheel.stdout.decode().strip(), said)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--module", required=True, help="helix_arm._core as it was built")
    parser.add_argument("--command", required=True)
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=[__file__, *rest])
