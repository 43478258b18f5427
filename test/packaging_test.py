"""debian/ and the wheel name the libraries that MODULE has, helix_arm._core as it was built, and the packages of scripts/packages.txt."""
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[1]
MODULE = sys.argv.pop(1)


def words_of(path, pattern):
    return set(re.findall(pattern, (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE))


class PackagingTest(unittest.TestCase):
    def test_the_module_alone_has_its_libraries_and_no_ros(self):
        listed = subprocess.run(["ldd", MODULE], stdout=subprocess.PIPE, check=True).stdout.decode()
        self.assertFalse(re.findall(r"^\s*lib(?:ros|xmlrpcpp|tf2|rviz)\S*", listed, re.MULTILINE))
        names = set(re.findall(r"lib(helix_arm_\w+)\.so =>", listed)) | {"helix_arm_media"}  # loaded at its first use
        self.assertGreater(len(names), 5)
        self.assertEqual(words_of("debian/python3-helix-arm.install", r"lib(helix_arm_\w+)\.so"), names)
        self.assertEqual(words_of("cmake/python_alone.cmake", r"\bhelix_arm_[a-z]+\b") - {"helix_arm_python"}, names)

    def test_the_package_is_built_with_what_scripts_build_installs(self):
        wanted = set(" ".join(words_of("scripts/packages.txt", r"^(?:all|debian|bookworm|trixie): *(.*)")).split())
        named = words_of("debian/control", r"[\w.+-]+")
        self.assertEqual(wanted - named, {"ccache", "make", "librostest-dev", "python3-rostest"})  # of catkin_make and tests


if __name__ == "__main__":
    unittest.main()
