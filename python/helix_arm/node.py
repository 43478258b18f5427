"""What the nodes in Python share: their run from start to exit code, private parameters, and `~reload`.

Needs rospy, unlike the rest of the package. Exit codes: 0 asked to end, or work done; 1 the ROS master was lost, or the node
failed; 2 a parameter or a file breaks its rules.
"""
import os
import pathlib
import re
import signal
import sys
import threading
import xmlrpc.client

import rospy

from helix_arm import Scene, _core, shipped_scenes
from helix_arm.srv import Reload, ReloadResponse

DONE, FAILED, BAD_CONFIGURATION = 0, 1, 2
SCENES = "config/scenes"  # of the package
PATIENCE = 5.0  # longest wait for the master at the end [s]
MASTER_PERIOD, MASTER_PATIENCE, MASTER_MISSES = 1.0, 2.0, 3  # between two queries, for an answer [s]; unanswered in a row
MOST_ANCESTORS = 8  # between a node and its roslaunch: launch-prefix, a shell
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def quoted(text, most=64):
    """An untrusted word for messages: other than printable ASCII becomes '?', and long text is cut."""
    return re.sub("[^ -~]", "?", text[:most]) + ("..." if len(text) > most else "")


def printable(text):
    """A line for messages: control characters, and those that change the direction of text, become escapes."""
    return CONTROLS.sub(lambda found: ("\\x%02x" if ord(found[0]) < 256 else "\\u%04x") % ord(found[0]), text)


# ---- From start to exit code -------------------------------------------------------------------------------------


class MasterWatch(threading.Thread):
    """Ends the node if its ROS master is gone, hangs, or was restarted and does not know the node; rospy notices none of these."""

    class _Transport(xmlrpc.client.Transport):
        def make_connection(self, host):
            connection = super().make_connection(host)
            connection.timeout = MASTER_PATIENCE
            return connection

    def __init__(self, end):
        super().__init__(daemon=True)
        self.lost, self._end = False, end
        self.start()

    def _fault(self):
        name = rospy.get_name()
        try:
            with xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"], self._Transport()) as master:
                return "" if master.lookupNode(name, name)[0] == 1 else "was restarted and does not know this node"
        except TimeoutError:
            return "does not answer: it hangs, or is cut off"
        except Exception:  # refused, or what is no answer of a master
            return "is gone"

    def run(self):
        missed = 0
        while missed < MASTER_MISSES:
            if self._end.wait(MASTER_PERIOD):
                return
            fault = self._fault()
            missed = missed + 1 if fault else 0
        self.lost = True
        rospy.logfatal("the ROS master at %s %s: this node exits", os.environ["ROS_MASTER_URI"], fault)
        self._end.set()


def guarded(body):
    """Runs it; prints what it raises, line by line, and returns the exit code for that."""
    try:
        return body()
    except Exception as fault:
        for line in str(fault).split("\n"):
            rospy.logfatal("%s", printable(line))
        return BAD_CONFIGURATION if isinstance(fault, ValueError) else FAILED


def run(name, make):
    """The main function of a node. Does not return.

    make: called with a threading.Event, whose set() asks the node to end. Its set-up raises ValueError with every fault of
    parameters and files. Returns the node, which has step(), called once per second, and finish(), whose value is the exit code.
    """
    sys.stdout.reconfigure(line_buffering=True, errors="replace")
    end, unregistered = threading.Event(), threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(DONE))  # while it waits for a master
    rospy.init_node(name, disable_signals=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: end.set())
    rospy.on_shutdown(end.set)  # rosnode kill
    rospy.core.add_shutdown_hook(lambda reason: unregistered.set())  # called after rospy's own
    master = MasterWatch(end)

    def work():
        node = make(end)
        thrown = guarded(lambda: _spin(node, end))
        return thrown or node.finish()

    verdict = guarded(work)
    end.set()
    sys.stdout.flush()
    # A master that hangs blocks this.
    threading.Thread(target=rospy.signal_shutdown, args=("",), daemon=True).start()
    in_time = unregistered.wait(1.0 if master.lost else PATIENCE)
    os._exit(FAILED if master.lost or not in_time else verdict)


def _spin(node, end):
    while not end.wait(1.0):
        node.step()
    return DONE


# ---- Parameters --------------------------------------------------------------------------------------------------


def _is_path(given):
    return "/" in given or "." in given


def _shipped_path(name):
    return os.path.join(_core.shipped_folder(SCENES), name + ".yaml")


def _launchers_folder():
    """Working directory of the roslaunch or rostest that started this process; None if there is none."""
    process = pathlib.Path("/proc/self")
    for _ in range(MOST_ANCESTORS):
        parent = (process / "stat").read_text().rsplit(") ", 1)[1].split()[1]
        process = pathlib.Path("/proc") / parent
        if int(parent) <= 1:
            return None
        words = (process / "cmdline").read_bytes().split(b"\0")[:3]
        if any(os.path.basename(word) in (b"roslaunch", b"rostest") for word in words):
            return os.readlink(process / "cwd")
    return None


def callers_folder():
    """Folder in which the user called this node, or the roslaunch that started it: where a relative path begins.

    That is the working directory, unless it is ROS_HOME, in which roslaunch starts nodes.
    """
    def same(one, other):
        return os.path.isdir(other) and os.path.samefile(one, other)

    shell, folder = os.environ.get("PWD", ""), os.getcwd()
    if same(folder, os.path.dirname(default_folder())):
        try:
            launcher = _launchers_folder()
        except (OSError, ValueError, IndexError):
            launcher = None
        if launcher is None and os.path.isabs(shell):
            return shell
        folder = launcher or folder
    return shell if os.path.isabs(shell) and same(folder, shell) else folder  # the name that the user knows


def default_folder():
    """Where services read by default: `helix_arm` below ROS_HOME."""
    return os.path.join(os.environ.get("ROS_HOME") or os.environ.get("HOME", "") + "/.ros", "helix_arm")


class Parameters:
    """Reads the private parameters of a node, and collects their faults: `~name value rule`."""

    def __init__(self):
        self._faults, self._known = [], set()

    def _read(self, name, fallback, is_sound, rule):
        self._known.add(rospy.resolve_name("~" + name))
        value = rospy.get_param("~" + name, None)
        if value is None or is_sound(value):
            return fallback if value is None else value
        self._faults.append(f"~{name} is {value}; expected {rule}")
        return fallback

    def text(self, name, fallback):
        return self._read(name, fallback, lambda value: isinstance(value, str), "text")

    def frame(self, name, fallback):
        """Name of a tf frame or a prefix of one."""
        return self._read(name, fallback, lambda value: isinstance(value, str) and value[:1] != "/" and (value or not fallback),
                          "a tf2 frame: not empty, no leading slash")

    def number(self, name, fallback, lower, upper):
        return self._read(name, fallback, lambda value: type(value) in (int, float) and lower <= value <= upper,
                          f"a number from {lower:g} to {upper:g}")

    def count(self, name, fallback, lower, upper):
        return self._read(name, fallback, lambda value: type(value) is int and lower <= value <= upper,
                          f"a whole number from {lower} to {upper}")

    def folder(self, name, fallback):
        given = self.text(name, "")
        return self._absolute(name, given) if given else fallback

    def scene(self, name, required):
        """Path of a scene file, or of the shipped scene of this name; empty if the parameter is absent."""
        faults = len(self._faults)
        given = self.text(name, "")
        if not given:
            if required and len(self._faults) == faults:
                self._faults.append(f"~{name} is missing; expected a path, or the name of a file in {SCENES} of the package")
            return ""
        path = self._absolute(name, given) if _is_path(given) else _shipped_path(given)
        if os.path.exists(path):
            return path
        stem, ending = os.path.splitext(os.path.basename(path))
        if not _is_path(given):
            self._faults.append(f"~{name} is {given}; expected a path, or the name of a file in {SCENES} of the package: "
                                + ", ".join(shipped_scenes()))
        elif ending == ".yaml" and stem in shipped_scenes():
            self._faults.append(f"~{name} is {path}; expected a file that is there, or {stem}, which is shipped")
        return path

    def _absolute(self, name, given):
        if given.startswith("/"):
            return given
        path = os.path.normpath(os.path.join(callers_folder(), given))
        rospy.loginfo("~%s is %s: %s", name, printable(given), printable(path))
        rospy.set_param("~" + name, path)  # other nodes read it, too
        return path

    def finish(self):
        """Warns of parameters that were set but never read. Raises ValueError with every fault."""
        for name in rospy.get_param_names():
            if name.startswith(rospy.get_name() + "/") and name not in self._known:
                rospy.logwarn("the node does not know the parameter %s; check its spelling", printable(name))
        if self._faults:
            raise ValueError("\n".join(map(printable, self._faults)))


# ---- ~reload -----------------------------------------------------------------------------------------------------


class ReloadServer:
    """Serves a node's `~reload`: loads another file of the same rig. The file is checked before anything changes.

    path, scene_folder: as the parameters `~scene` and `~scene_folder`; scenes come from that folder, those that are shipped and
    the first file alone, since any client may name any path. adopt: called with the new helix_arm.Scene while `lock` is held.
    """

    def __init__(self, path, scene_folder, adopt):
        self.scene, self.lock = Scene(path), threading.RLock()
        self._first, self._path, self._folder, self._adopt = path, path, scene_folder, adopt
        self._service = rospy.Service("~reload", Reload, self._on_reload)

    def _allowed(self, given):
        if not given or given == self._first:
            return given or self._path
        if not _is_path(given):
            return _shipped_path(given)
        if not given.startswith("/"):
            raise ValueError(f"scene is '{quoted(given)}'; expected an absolute path, or the name of a file in {SCENES} of the "
                             "package")
        path = os.path.realpath(given) if printable(given) == given else ""  # messages repeat it
        folders = {self._folder: "~scene_folder", _core.shipped_folder(SCENES): "the package's own"}
        if not path.endswith(".yaml") or not any(pathlib.Path(os.path.realpath(folder)) in pathlib.Path(path).parents
                                                 for folder in folders):
            below = " or ".join(f"{folder} ({what})" for folder, what in folders.items())
            raise ValueError(f"scene is '{quoted(given, 300)}'; expected the absolute path of a .yaml file below {below}")
        if not os.path.isfile(path):
            raise ValueError(f"scene is '{quoted(given, 300)}', which is not a regular file")
        return path

    def _on_reload(self, request):
        try:
            path = self._allowed(request.scene)
            scene = Scene(path)
            with self.lock:
                self.scene._require_same_rig(scene)
                self._adopt(scene)
                self.scene, self._path = scene, path
        except Exception as fault:
            text = "\n".join(map(printable, str(fault).split("\n")))
            rospy.logwarn("reload refused, nothing changed: %s", text)
            return ReloadResponse(False, text)
        text = f"scene {scene.name} of {path}"
        rospy.loginfo("reload: %s", text)
        return ReloadResponse(True, text)
