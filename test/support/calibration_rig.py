"""The simulated rig, whose time runs fast, and the nodes of a calibration. Time limits are wide, since they pass three times as fast."""
import os
import sys
import tempfile

import actionlib
import numpy as np
import rospy

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from helix_arm.msg import PressureArray, RunCalibrationAction, RunCalibrationGoal, SafetyState, TagDetections  # noqa: E402
from helix_arm.srv import Save  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import CommanderCase  # noqa: E402

RAMP = 2e5  # of the run, in simulated time [Pa/s]
LONGEST_STEP = 0.1  # of procedures::CalibrationRun [s]


class CalibrationRig(CommanderCase):
    RIG = {}  # what of `simulation` is not as in the demo
    SCENE, SIGHT = "demo", "image"
    KNOWN = {}  # what the nodes' scene has otherwise than the rig's
    PERIOD = 0.07  # 0.2 s of the rig

    def setUp(self):
        super().setUp()
        self.safety, self.targets, detections = (self.inbox(topic, kind) for topic, kind in (
            ("safety_state", SafetyState), ("pressure_target", PressureArray), ("tag_detections", TagDetections)))
        demo = SOURCE + "/config/scenes/%s.yaml" % self.SCENE
        folders = ["_%s_folder:=%s" % (kind, tempfile.gettempdir()) for kind in ("scene", "data", "out")]
        true = self.scene_with(demo, {"simulation." + key: value for key, value in self.RIG.items()})
        self.scene = scene = "_scene:=" + self.scene_with(demo, {"safety.target_timeout_s": 3, "safety.reading_timeout_s": 1, **self.KNOWN})
        self.rig = self.run_node("simulated_rig", "_scene:=" + true, "_time_factor:=3", "_camera_rate:=8", "_command_timeout_s:=5")
        self.commander = self.run_node("pressure_command", scene, folders[0], "_regulator:=topic", "_auto_enable:=true", "_rate:=50")
        self.run_node("vision", scene, folders[0], "_source:=" + self.SIGHT, "_stale_after_s:=30")
        self.calibration = self.run_node("calibration", scene, *folders, "_max_age_s:=20", "_pressure_tolerance_kpa:=6",
                                         "_ramp_kpa_s:=200")
        self.assert_wait(lambda: not rospy.Time.now().is_zero() and self.safety and self.command and self.measured and detections)
        self.assert_wait(lambda: self.send_pressures([0, 0, 0], deadline=1) and self.held)
        self.free_the_arm()
        self.client = actionlib.SimpleActionClient("calibration/run_calibration", RunCalibrationAction)
        self.assert_wait(lambda: self.client.action_client.wait_for_server(rospy.Duration(1)))

    def why(self):
        return self.safety[-1:], self.commander.output()[-3000:], self.calibration.output()[-3000:]

    def free_the_arm(self):
        """Sends no target until the arm has vented, unless it rests, and is free: the next target, from any sender, enables it again."""
        self.held, since = None, len(self.diagnostics)
        self.assert_wait(lambda: self.safety[-1].state in (SafetyState.VENTED, SafetyState.DISABLED)
                         and self.diagnosed("targets", since).get("lease_holder") == "")

    def call(self, name, service, **fields):
        """A service of the calibration node, or of another one."""
        path = name if "/" in name else "calibration/" + name
        rospy.wait_for_service(path, 60)
        return rospy.ServiceProxy(path, service)(**fields)

    def save(self, name):
        saved = self.call("save", Save, path=self.path(name))
        self.assertTrue(saved.success, saved.message)
        return saved.message

    def send(self, **fields):
        self.progress = []
        self.client.send_goal(RunCalibrationGoal(**fields), feedback_cb=self.progress.append)

    def is_done(self):
        # The client's own state misses an end that comes before its send_goal() returns.
        return self.client.gh.get_comm_state() == actionlib.CommState.DONE

    def assert_ends(self, state, *words, deadline=45):
        self.assert_wait(self.is_done, deadline)
        result = self.client.get_result()
        self.assertEqual(self.client.get_state(), state, result)
        for word in words:
            self.assertIn(word, result.message)
        return result

    def assert_rest(self, first=None):
        """The arm comes to rest; where the first of its targets is given, without a fault, and by no step that the ramp does not
        allow: however late one is, it makes up for no more than the longest step."""
        self.assertTrue(self.command.next(lambda command: not any(command.pressure)))
        if first is None:
            return
        self.assert_wait(lambda: self.safety[-1].state == SafetyState.DISABLED)
        steps = np.abs(np.diff([target.pressure for target in list(self.targets)[first:]], axis=0))
        self.assertLessEqual(steps.max(), RAMP * LONGEST_STEP * (1 + 1e-9))
