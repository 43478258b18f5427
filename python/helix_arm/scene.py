"""A scene file and what its model computes."""
from __future__ import annotations

import json
import os
from typing import Any, List, Mapping, Union

from helix_arm import _core


def shipped_scenes() -> List[str]:
    """Names of the shipped scenes, for Scene.load()."""
    return sorted(name[:-5] for name in os.listdir(_core.scene_folder()) if name.endswith(".yaml"))


def _path_of(path_or_name: Union[str, "os.PathLike[str]"]) -> str:
    """A shipped scene by its name, or a path: with a / or ending in .yaml."""
    text = os.fspath(path_or_name)
    if not isinstance(text, str):
        raise TypeError(f"path_or_name is {type(path_or_name).__name__}; expected str or os.PathLike of str")
    if os.sep in text or text.endswith(".yaml"):
        return text
    if text not in shipped_scenes():
        raise ValueError(f"path_or_name is {text!r}; expected one of {', '.join(shipped_scenes())}, "
                         "or a path (with a / or ending in .yaml)")
    return os.path.join(_core.scene_folder(), text + ".yaml")


def _yaml_of(key: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"overrides[{key!r}] is {type(value).__name__}; expected text, numbers, or lists and "
                        "dicts of them") from error


class Scene(_core.Scene):
    """A scene file: an arm and its rig. Immutable; threads may share it."""

    @classmethod
    def load(cls, path_or_name: Union[str, "os.PathLike[str]"], overrides: Mapping[str, Any] = {}) -> "Scene":
        """Reads and checks a scene file.

        path_or_name: name of a shipped scene, or a path (with a / or ending in .yaml).
        overrides: values by dotted key, as of --set: {"arm.stiffness.K_gamma": 100}. Text counts as YAML.
        Raises DocumentError, a ValueError, with all faults: `file:line key value rule`.
        """
        if not isinstance(overrides, Mapping):
            raise TypeError(f"overrides is {type(overrides).__name__}; expected a dict of values by dotted key")
        return cls(_path_of(path_or_name), [(str(key), _yaml_of(key, value)) for key, value in overrides.items()])

    def __repr__(self) -> str:
        return f"<helix_arm.Scene {self.name}: {len(self.actuators)} actuators, tier {self.tier}>"
