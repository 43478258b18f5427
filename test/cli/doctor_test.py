#!/usr/bin/env python3
"""`helix_arm doctor` on computers that lack something: folders, variables and a ROS master that are made up.

usage: doctor_test.py --command HELIX_ARM
"""
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path
from unittest import mock
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import doctor  # noqa: E402

COMMAND = None


class Master(SimpleXMLRPCServer):
    """Answers as a ROS master that knows one node, with a clock of its own."""

    def __init__(self, node_host, ahead):
        class Handler(SimpleXMLRPCRequestHandler):
            rpc_paths = ("/", "/RPC2")

            def date_time_string(self, timestamp=None):
                return super().date_time_string(time.time() + ahead)

        super().__init__(("127.0.0.1", 0), Handler, logRequests=False)
        self.register_function(lambda _: [1, "", [[["/tip", ["/vision"]]], [], []]], "getSystemState")
        self.register_function(lambda *_: [1, "", "http://%s:1234/" % node_host], "lookupNode")
        self.register_function(lambda _: [1, "", 1], "getPid")


class ComputerThatLacksSomething(unittest.TestCase):
    def states(self, method, root="/", **environment):
        found = doctor.Doctor(COMMAND, str(root), environment)
        getattr(found, method)()
        self.checks = {check["name"]: check for check in found.checks}
        return {name: check["state"] for name, check in self.checks.items()}

    def network(self, node_host, ahead, own, ends_after=None):
        """@param ends_after  a call with which the master's answers end."""
        with Master(node_host, ahead) as master:
            if ends_after:
                calls = ("getSystemState", "lookupNode", "getPid")
                for call in calls[calls.index(ends_after) + 1:]:
                    del master.funcs[call]
            thread = threading.Thread(target=master.serve_forever)
            thread.start()
            try:
                return self.states("ros_network", ROS_MASTER_URI="http://127.0.0.1:%d" % master.server_address[1], ROS_HOSTNAME=own)
            finally:
                master.shutdown()
                thread.join()

    def test_devices_without_permission(self):
        with tempfile.TemporaryDirectory() as root:
            self.assertEqual(self.states("devices", root)["ports"], "not_checked")
            os.mkdir(os.path.join(root, "dev"))
            for name in ("ttyUSB0", "ttyACM1", "video0"):
                Path(root, "dev", name).touch()
            self.assertEqual(self.states("devices", root)["ports"], "ok")
            with mock.patch.object(doctor.os, "access", lambda path, _: not path.endswith("ttyACM1")):
                states = self.states("devices", root)
        self.assertEqual((states["ports"], states["cameras"]), ("fault", "ok"))
        self.assertRegex(self.checks["ports"]["found"], "^no permission for [^,]*/ttyACM1$")
        self.assertIn("dialout", self.checks["ports"]["remedy"])

    def test_network(self):
        self.assertEqual(self.network("localhost", 0, "localhost"),
                         {"own_name": "ok", "ros_master": "ok", "node /vision": "ok", "clock": "ok"})
        self.assertEqual(self.network("no-such-host.invalid", 0.4, "no-such-host.invalid"),
                         {"own_name": "fault", "ros_master": "ok", "node /vision": "fault", "clock": "fault"})
        self.assertAlmostEqual(float(self.checks["clock"]["found"].split(" ")[0]), 0.4, delta=0.2)

    def test_the_command_says_it_and_ends_with_1_on_a_fault(self):
        for uri, state in (("http://127.0.0.1:1", "not_checked"), ("robot", "fault")):
            run = subprocess.run([COMMAND, "doctor", "--format", "json"], stdout=subprocess.PIPE, timeout=60,
                                 env={**os.environ, "ROS_HOSTNAME": "localhost", "ROS_MASTER_URI": uri})
            checks = json.loads(run.stdout)["checks"]
            self.assertEqual({tuple(sorted(check)) for check in checks}, {("found", "name", "remedy", "state")})
            self.assertEqual([check["state"] for check in checks if check["name"] == "ros_master"], [state])
            self.assertEqual(run.returncode, int(any(check["state"] == "fault" for check in checks)))


if __name__ == "__main__":
    COMMAND = sys.argv[sys.argv.index("--command") + 1]
    unittest.main(argv=sys.argv[:1])
