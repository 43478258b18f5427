"""`~reload` of a node in Python, as src/ros_bridge/common/parameters.hpp is that of those in C++."""
import os
import pathlib
import threading
from typing import Callable

import rospy

from helix_arm import Scene, _core
from helix_arm.node import log, quoted
from helix_arm.srv import Reload, ReloadRequest, ReloadResponse

SCENES = "config/scenes"  # of the package
LONGEST_PATH = 300  # in a message


class ReloadServer:
    """Loads another file of the same rig at run time. The file is loaded and checked before anything changes.

    path, scene_folder: as the parameters `~scene` and `~scene_folder`. Scenes come from that folder, from those that are shipped
    and from the first file alone, since any client may name any path. adopt: called with the new scene while `lock` is held.
    """

    def __init__(self, path: str, scene_folder: str, adopt: Callable[[Scene], None]) -> None:
        self.scene, self.lock = Scene.load(path), threading.RLock()
        self._first, self._path, self._folder, self._adopt = path, path, scene_folder, adopt
        self._service = rospy.Service("~reload", Reload, self._on_reload)

    def _allowed(self, given: str) -> str:
        """The file that a request means. Raises ValueError if the node does not accept it."""
        if not given or given == self._first:
            return given or self._path
        shipped, _ = _core._shipped(SCENES, ".yaml")
        if "/" not in given and "." not in given:
            return os.path.join(shipped, given + ".yaml")
        if not given.startswith("/"):
            raise ValueError(f"scene is '{quoted(given)}'; expected an absolute path, or the name of a file in {SCENES} of the "
                             "package")
        is_line = "\n" not in given and _core._printable(given.encode()) == given  # messages repeat it
        path = os.path.realpath(given) if is_line else ""
        above = [str(folder) for folder in pathlib.Path(path).parents]
        if not path.endswith(".yaml") or not {os.path.realpath(self._folder), os.path.realpath(shipped)} & set(above):
            raise ValueError(f"scene is '{quoted(given, LONGEST_PATH)}'; expected the absolute path of a .yaml file below "
                             f"{self._folder} (~scene_folder) or {shipped} (the package's own)")
        if not os.path.isfile(path):
            raise ValueError(f"scene is '{quoted(given, LONGEST_PATH)}', which is not a regular file")
        return path

    def _on_reload(self, request: ReloadRequest) -> ReloadResponse:
        try:
            path = self._allowed(request.scene)
            scene = Scene.load(path)
            with self.lock:
                self.scene._require_same_rig(scene)
                self._adopt(scene)
                self.scene, self._path = scene, path
            log.info(f"reload: scene {scene.name} of {path}")
            return ReloadResponse(True, f"scene {scene.name} of {path}")
        except Exception as fault:
            text = _core._printable(str(fault).encode())
            log.warning(f"reload refused, nothing changed: {text}")
            return ReloadResponse(False, text)
