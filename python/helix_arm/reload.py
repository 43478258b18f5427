"""`~reload` of a node in Python, as src/ros_bridge/common/parameters.hpp is that of those in C++."""
import os
import threading
from typing import Any, Callable

from helix_arm import Scene, _core
from helix_arm.arguments import require
from helix_arm.file_access import FileAccess, quoted
from helix_arm.jobs import serve
from helix_arm.srv import Reload

SCENES = "config/scenes"  # of the package


class ReloadServer:
    """Loads another file of the same rig at run time. The file is loaded and checked before anything changes.

    path, scene_folder: as the parameters `~scene` and `~scene_folder`. Scenes come from that folder, from those that are shipped
    and from the first file alone, since any client may name any path. adopt: called with the new scene while `lock` is held.
    """

    def __init__(self, path: str, scene_folder: str, adopt: Callable[[Scene], None]) -> None:
        self.scene, self.lock = Scene.load(path), threading.RLock()
        self._first, self._path, self._folder, self._adopt = path, path, scene_folder, adopt
        self._service = serve("reload", Reload, self._on_reload)

    def _allowed(self, given: str) -> str:
        """The file that a request means. Raises ValueError if the node does not accept it."""
        if not given or given == self._first:
            return given or self._path
        shipped, _ = _core._shipped(SCENES, ".yaml")
        if "/" not in given and "." not in given:
            return os.path.join(shipped, given + ".yaml")
        require(given.startswith("/"),
                f"scene is '{quoted(given)}'; expected an absolute path, or the name of a file in {SCENES} of the package")
        access = FileAccess({"~scene_folder": self._folder, "the package's own": shipped})
        return access.to_read("scene", given, ".yaml")

    def _on_reload(self, request: Any, response: Any) -> None:
        path = self._allowed(request.scene)
        scene = Scene.load(path)
        with self.lock:
            self.scene._require_same_rig(scene)
            self._adopt(scene)
            self.scene, self._path = scene, path
        response.success, response.message = True, f"scene {scene.name} of {path}"
