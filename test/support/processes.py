"""Child processes whose output is collected, and a ROS master of one's own."""
import os
import signal
import socket
import subprocess
import tempfile
import time

SOURCE = os.path.realpath(os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", ".."))


def node(name):
    """Path of a node of the package."""
    import roslib.packages  # here, since not all that start processes have ROS on their path
    return roslib.packages.find_node("helix_arm", name)[0]


def wait_for(condition, deadline=60):
    end = time.monotonic() + deadline
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


class Process:
    """One with a group of its own, that ends with the object's `with`."""

    def __init__(self, command, variables=None, folder=None):
        self.log = tempfile.TemporaryFile()
        self.child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log, cwd=folder,
                                      env=dict(os.environ, **(variables or {})), start_new_session=True)

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        if self.child.poll() is None:
            self.signal(signal.SIGINT)
            if self.code(10) is None:
                self.signal(signal.SIGKILL)
                self.code(10)
        self.signal(signal.SIGKILL)  # grandchildren, if any are left

    def signal(self, number):
        try:
            os.killpg(self.child.pid, number)
        except ProcessLookupError:
            pass

    def output(self):
        """All that it has printed so far."""
        file = self.log.fileno()  # whose position is also that of the child, which writes there
        return os.pread(file, os.fstat(file).st_size, 0).decode(errors="replace")

    def prints(self, text, deadline=60):
        """Whether the output comes to hold the text."""
        return wait_for(lambda: text in self.output() or self.child.poll() is not None, deadline) and text in self.output()

    def code(self, deadline=60):
        """Exit code; None where it still runs at the deadline [s]."""
        try:
            return self.child.wait(deadline)
        except subprocess.TimeoutExpired:
            return None


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Master:
    """A ROS master on a free port."""

    def __init__(self):
        self.port = free_port()
        self.variables = {"ROS_MASTER_URI": "http://localhost:%d" % self.port, "ROS_HOSTNAME": "localhost"}
        self.start()

    def start(self):
        """Again on the same port, where it was stopped."""
        self.process = Process(["rosmaster", "--core", "-p", str(self.port)], self.variables)
        if not wait_for(self.accepts, 30):
            raise RuntimeError("no master:\n" + self.process.output())

    def accepts(self):
        with socket.socket() as one:
            return one.connect_ex(("127.0.0.1", self.port)) == 0

    def stop(self):
        self.process.__exit__()

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.process.signal(signal.SIGCONT)
        self.stop()
