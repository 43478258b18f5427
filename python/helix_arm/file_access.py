"""Files that nodes read and write."""
from __future__ import annotations

import errno
import os
import pathlib
from typing import Mapping, Sequence

from helix_arm import _core
from helix_arm.arguments import require

LONGEST_PATH = 300  # in a message
RECORDED, RECORDED_RUN = "recorded of scene ", "recorded run of "  # after "# ", the begin of a table of this package
PROVEN = b"# follow.contact_limit and follow.on_contact are of a proof"  # the begin of a scene of procedures::provenSceneText()


def quoted(text: str, most: int = 64) -> str:
    """An untrusted word for messages: of printable ASCII alone, at most so many characters."""
    out = "".join(c if " " <= c <= "~" else "?" for c in text[:most])
    return out + "..." if len(text) > most else out


class FileAccess:
    """Restricts the files that a node reads and writes to some folders, since any client may name any path. The target of a link
    counts, not the link's location.

    folders: by the parameters that name them, such as "~out_folder"; none: any. Each method takes the name of the file in messages,
    an absolute path and the allowed endings, and returns the path without links. It raises ValueError naming the rule, in a message
    that does not reveal whether a path elsewhere exists.
    """

    def __init__(self, folders: Mapping[str, str]) -> None:
        self._folders = folders

    def to_read(self, what: str, given: str, *endings: str) -> str:
        path = self._resolved(what, given, endings)
        require(os.path.isfile(path), f"{what} is '{quoted(given, LONGEST_PATH)}', which is not a regular file")
        return path

    def to_write(self, what: str, given: str, *endings: str) -> str:
        """Its folder must be writable. A file that is there is accepted only if this package wrote it."""
        path = self._resolved(what, given, endings)
        named = f"{what} is '{quoted(given, LONGEST_PATH)}'"
        dangles = os.path.islink(given) and not os.path.exists(given)
        if os.path.lexists(path) or dangles:
            require(os.path.isfile(path) and _is_ours(path),
                    f"{named}, which exists and was not written by this package as a calibrated scene, recorded samples, a recorded "
                    "run or its figure; expected a new name, or that of one of these")
            require(os.access(path, os.W_OK), f"{named}, which cannot be overwritten; expected another path")
        folder = os.path.dirname(path)
        why = os.strerror(errno.EACCES if os.path.isdir(folder) else errno.ENOENT)
        require(os.access(folder, os.W_OK),
                f"{named}, but {folder} cannot be written ({why}); expected a path in a folder that can")
        return path

    def folder(self, what: str, given: str) -> str:
        """Path of a folder, whose name has no ending."""
        return self._resolved(what, given, ("",))

    def _resolved(self, what: str, given: str, endings: Sequence[str]) -> str:
        # The system would cut a path at a null character, and messages repeat it.
        is_line = "\n" not in given and _core._printable(given.encode("utf-8", "surrogateescape")) == given
        path = os.path.realpath(given) if is_line else ""
        above = {str(folder) for folder in pathlib.Path(path).parents}
        is_below = not self._folders or bool(above & {os.path.realpath(folder) for folder in self._folders.values()})
        below = " or ".join(f"{path} ({parameter})" for parameter, path in self._folders.items())
        require(given.startswith("/") and is_line and is_below and os.path.splitext(path)[1] in endings,
                f"{what} is '{quoted(given, LONGEST_PATH)}'; expected the absolute path of a {' or '.join(endings)} "
                f"file{' below ' if below else ''}{below}")
        return path


def _is_ours(path: str) -> bool:
    with open(path, "rb") as file:
        begin = file.read(256)
    if path.endswith(".yaml"):
        try:
            return begin.startswith(PROVEN) or _core.Scene(path, [])._is_calibrated
        except Exception:
            return False
    if path.endswith(".csv"):
        return any(begin.startswith(b"# " + title.encode()) for title in (RECORDED, RECORDED_RUN))
    return begin.startswith(b"\x89PNG") and b"helix_arm plot_report" in begin


def ros_home() -> pathlib.Path:
    return pathlib.Path(os.environ.get("ROS_HOME") or pathlib.Path.home() / ".ros")
