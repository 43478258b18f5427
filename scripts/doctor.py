"""Whether this computer has what an arm needs, and what to do where it has not. Run as a file by `helix_arm doctor`.

usage: doctor.py PROGRAM FORMAT (text, json or csv)

Needs nothing but Python, since what is missing is what it looks for. Exit code: 1 if there is a fault.
"""
import csv
import glob
import http.client
import importlib.util
import json
import os
import platform
import re
import resource
import shutil
import socket
import subprocess
import sys
import time
import xmlrpc.client
from email.utils import parsedate_to_datetime
from pathlib import Path
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError

TESTED = ("bookworm", "trixie")  # releases of Debian
MODULES = {name: "python3-" + name for name in ("numpy", "scipy", "matplotlib", "yaml", "rospy")}
PROGRAMS = {"roslaunch": "python3-roslaunch", "rosmaster": "python3-rosmaster", "rostopic": "python3-rostopic", "rviz": "rviz"}
DEVICES = (("ports", ("ttyUSB*", "ttyACM*"), "dialout"), ("cameras", ("video*",), "video"))  # name, files in /dev, group
LIMITS = (("real_time_priority", resource.RLIMIT_RTPRIO, 40, "rtprio 40"),  # ~realtime_priority of pressure_command
          ("locked_memory", resource.RLIMIT_MEMLOCK, sys.maxsize, "memlock unlimited"))
CLOCK_ERROR = 0.02  # that matters to a moving arm [s]
ANSWER = 3  # longest wait for another machine [s]
REACH = "export ROS_HOSTNAME, a name, or ROS_IP, an address, by which others reach this machine, in every terminal; alone: localhost"


class TimedTransport(xmlrpc.client.Transport):
    """Keeps what the other machine's clock says (`second`), when it was asked (`now`), and how long that took (`span`)."""

    def single_request(self, host, handler, request_body, verbose=False):
        self.verbose, start = verbose, time.time()
        connection = http.client.HTTPConnection(host, timeout=ANSWER)
        connection.request("POST", handler, request_body, {"Content-Type": "text/xml"})
        answer = connection.getresponse()
        self.now, self.span = time.time(), time.time() - start
        date = answer.headers["Date"]
        self.second = parsedate_to_datetime(date).timestamp() if date else None
        if answer.status != 200:
            raise http.client.HTTPException("HTTP status %d" % answer.status)
        return self.parse_response(answer)


def output_of(*command):
    """Output of a program; nothing if there is no such program."""
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60, check=False)
        return done.stdout.decode(errors="replace").strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""


def is_here(host):
    """Whether a name or address is of this machine; None if it does not resolve."""
    try:
        with socket.socket() as trial:
            trial.bind((socket.gethostbyname(host or "?"), 0))
        return True
    except (socket.gaierror, UnicodeError):
        return None
    except OSError:
        return False


class Doctor:
    """The checks. `root`: where /dev and /etc are; `environment`: variables of the shell."""

    def __init__(self, program, root="/", environment=os.environ):
        self.program, self.root, self.environment = program, root, environment
        self.checks = []

    def say(self, name, fault, found, remedy="", state="fault"):
        """`fault`: whether there is one, of which `state` says how bad it is, and `remedy` what to do."""
        self.checks.append({"name": name, "state": state if fault else "ok", "found": found, "remedy": remedy if fault else ""})

    def all(self):
        self.attempt("versions", self.versions)
        self.attempt("python_modules", self.needed, "python_modules", MODULES, importlib.util.find_spec)
        self.attempt("ros_programs", self.needed, "ros_programs", PROGRAMS, self.on_path)
        self.attempt("devices", self.devices)
        self.attempt("ros_network", self.ros_network)
        return self.checks

    def attempt(self, name, check, *arguments, remedy="the other checks hold; run helix_arm doctor again"):
        """Makes a check that says a fault of its own, under its name, where it cannot be carried out."""
        try:
            check(*arguments)
        except Exception as error:  # whatever it is, the other checks are to be printed
            self.say(name, True, "%s: %s" % (type(error).__name__, error), remedy)

    def on_path(self, name):
        return shutil.which(name, path=self.environment.get("PATH", ""))

    def versions(self):
        version = output_of(self.program, "--version")
        missing = re.findall(r"(\S+) => not found", output_of("ldd", self.program))
        self.say("command", missing or not version, version + " " + self.program,
                 "build again with scripts/build; missing: " + ", ".join(missing))
        place = self.on_path("helix_arm")
        self.say("path", not place or os.path.realpath(place) != os.path.realpath(self.program),
                 place or "helix_arm is not on PATH", "source devel/setup.bash of the package that you mean", "warning")
        code = "import helix_arm; print(helix_arm.__version__, helix_arm.__file__)"
        path = str(Path(self.program).resolve().parents[1] / "python3/dist-packages") + os.pathsep + self.environment.get("PYTHONPATH", "")
        found = output_of("env", "PYTHONPATH=" + path, sys.executable, "-c", code).split("\n")[-1]
        self.say("python_package", not version or found.split(" ")[0] != version.split(" ")[-1], found,
                 "install what it misses, or build again: it is to have the version of the command")
        file = Path(self.root, "etc/os-release")
        release = dict(re.findall(r'^(\w+)="?(.*?)"?$', file.read_text(encoding="utf-8"), re.M)) if file.is_file() else {}
        name = (release.get("PRETTY_NAME", "unknown"), platform.release(), platform.machine(), platform.python_version())
        self.say("system", release.get("VERSION_CODENAME") not in TESTED, "%s, Linux %s, %s, Python %s" % name,
                 "untested; tested are Debian 12 and 13", "warning")

    def needed(self, what, packages, find):
        missing = [name for name in packages if not find(name)]
        self.say(what, missing, ("missing: " if missing else "") + ", ".join(missing or packages),
                 "sudo apt-get install " + " ".join(packages[name] for name in missing), "warning")

    def devices(self):
        for name, patterns, group in DEVICES:
            found = sorted(path for pattern in patterns for path in glob.glob(os.path.join(self.root, "dev", pattern)))
            refused = [path for path in found if not os.access(path, os.R_OK | os.W_OK)]
            if found:
                self.say(name, refused, ("no permission for " if refused else "") + ", ".join(refused or found),
                         "sudo usermod -aG %s $USER, then log in again" % group)
            else:
                self.say(name, True, "none is connected", "", "not_checked")
        for name, kind, least, word in LIMITS:
            limit = resource.getrlimit(kind)[0]
            unlimited = limit == resource.RLIM_INFINITY or os.geteuid() == 0
            self.say(name, not unlimited and limit < least, "unlimited" if unlimited else "limit %d" % limit,
                     "put `@realtime - %s` in /etc/security/limits.conf, then sudo groupadd -f realtime; sudo usermod -aG realtime $USER, "
                     "and log in again" % word, "warning")

    def ros_network(self):
        """This machine's name, the master, the nodes that it knows, and its clock."""
        variable = next((name for name in ("ROS_HOSTNAME", "ROS_IP") if self.environment.get(name)), "host name")
        own = self.environment.get(variable) or socket.gethostname()
        uri = self.environment.get("ROS_MASTER_URI") or "http://localhost:11311"
        master = urlparse(uri if re.match(r"http://[\w.-]+:\d{1,5}/?$", uri) else "")
        for_itself = is_here(own) and is_here(master.hostname) is False and socket.gethostbyname(own).startswith("127.")
        self.say("own_name", for_itself or not is_here(own), "%s %s%s" % (variable, own, " reaches no other machine" if for_itself else
                 {True: "", False: " is another machine", None: " does not resolve: nodes of this terminal publish into nothing"}[is_here(own)]), REACH)
        transport = TimedTransport()
        try:
            if not master.hostname:
                raise ValueError("expected http://HOST:11311")
            proxy = xmlrpc.client.ServerProxy(uri, transport=transport)
            nodes = {name for kind in proxy.getSystemState("/helix_arm_doctor")[2] for _, names in kind for name in names}
        except (OSError, ValueError, http.client.HTTPException, xmlrpc.client.Error, ExpatError) as error:
            none = isinstance(error, ConnectionRefusedError) and is_here(master.hostname)
            self.say("ros_master", True, "%s does not answer: %s" % (uri, error), "roslaunch starts one" if none else
                     "start roscore on its machine; check ROS_MASTER_URI, cable and firewall", "not_checked" if none else "fault")
            return
        self.say("ros_master", False, uri)
        gone = "the master has answered before: see whether it ends or restarts, then run helix_arm doctor again"
        for node in sorted(nodes):
            self.attempt("node " + node, self.node, node, proxy, remedy=gone)
        self.attempt("clock", self.clock, master.hostname, proxy, transport, remedy=gone)

    def node(self, name, proxy):
        known, _, uri = proxy.lookupNode("/helix_arm_doctor", name)
        host = urlparse(uri).hostname if known == 1 else None
        self.say("node " + name, host and is_here(host) is None, "at %s" % host if host else "ended meanwhile",
                 "its host name does not resolve here, so that nobody hears it: export ROS_HOSTNAME or ROS_IP in its terminal, or add the "
                 "name to /etc/hosts here")

    def clock(self, host, proxy, transport):
        """Asks the master, which tells whole seconds, until one begins."""
        before, end = None, time.monotonic() + 1.5
        while time.monotonic() < end:
            proxy.getPid("/helix_arm_doctor")
            if transport.second and before and transport.second != before[0]:
                behind = transport.second - (before[1] + transport.now) / 2
                doubt = (transport.now - before[1] + transport.span) / 2
                self.say("clock", abs(behind) > CLOCK_ERROR + doubt, "%.3f s +- %.3f s behind %s" % (behind, doubt, host),
                         "synchronise the clocks, such as with chrony")
                return
            before = (transport.second, transport.now)
        self.say("clock", True, "%s does not tell its time" % host, "compare the clocks by hand", "not_checked")


def main(program, form):
    checks = Doctor(program).all()
    if form == "json":
        print(json.dumps({"checks": checks}, indent=2))
    elif form == "csv":
        rows = csv.DictWriter(sys.stdout, ["name", "state", "found", "remedy"], lineterminator="\n")
        rows.writeheader()
        rows.writerows(checks)
    else:
        for check in checks:
            print("%-12s%-20s%s" % (check["state"], check["name"], check["found"]))
            if check["remedy"]:
                print(" " * 32 + "-> " + check["remedy"])
    return 1 if any(check["state"] == "fault" for check in checks) else 0


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        sys.exit()
    sys.exit(main(*sys.argv[1:]))
