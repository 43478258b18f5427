"""Builds the Python module without ROS, for pip: CMake with HELIX_ARM_ROS=OFF, installed as the package's folder."""
import pathlib
import subprocess
import sys
import xml.etree.ElementTree

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = pathlib.Path(__file__).resolve().parent


class CMakeBuild(build_ext):
    """All files of the package, its Python sources too, come from `cmake --install`."""

    def build_extension(self, ext):
        target = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve().parent
        folder = pathlib.Path(self.build_temp).resolve()
        for command in (
                ["-S", ROOT, "-B", folder, "-G", "Ninja", "-DHELIX_ARM_ROS=OFF", "-DCMAKE_BUILD_TYPE=Release",
                 f"-DPython3_EXECUTABLE={sys.executable}", f"-DPYTHON_EXECUTABLE={sys.executable}"],
                ["--build", folder],
                ["--install", folder, "--prefix", target]):
            subprocess.run(["cmake", *map(str, command)], check=True)


setup(
    version=xml.etree.ElementTree.parse(ROOT / "package.xml").findtext("version"),
    ext_modules=[Extension("helix_arm._core", sources=[])],
    cmdclass={"build_ext": CMakeBuild},
)
