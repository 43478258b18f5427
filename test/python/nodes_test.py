"""What the nodes in Python compute: series of pressures, records of runs, and the files that they may write."""
import os
import tempfile
import unittest

import numpy as np
from helix_arm import _core, run_record
from helix_arm.file_access import FileAccess
from helix_arm.pressure_series import SeriesPlayer
from helix_arm.run_record import AHEAD, REACH, Row, TimeSeries, TipRecord

ROWS = np.array([[100.0, 200.0], [300.0, 0.0]])


def player(ramp=2.0, hold=1.0, loop=False):
    out = SeriesPlayer(ROWS, ramp, hold, loop)
    out.resume(np.zeros(2))
    return out


class SeriesTest(unittest.TestCase):
    def expect(self, series, row, *pressures):
        self.assertEqual((series.row, *series.pressure()), (row, *pressures))

    def test_ramps_in_a_straight_line_then_holds(self):
        series = player()
        self.expect(series, 0, 0, 0)
        for step, row, *pressures in ((0.5, 0, 25, 50), (1.5, 0, 100, 200), (0.75, 0, 100, 200), (1.25, 1, 200, 100)):
            series.advance(step)
            self.expect(series, row, *pressures)

    def test_ends_at_the_last_row_and_stays_there(self):
        series = player()
        for step, finished in ((5.75, False), (0.25, True), (1e6, True)):
            series.advance(step)
            self.assertEqual(series.finished, finished)
        self.expect(series, 1, 300, 0)

    def test_a_loop_ramps_from_the_last_row_to_the_first_whatever_the_steps(self):
        coarse, fine = player(loop=True), player(loop=True)
        coarse.advance(7.0)
        self.expect(coarse, 0, 200, 100)
        coarse.advance(90.0)
        for _ in range(97 * 64):
            fine.advance(1 / 64)
        self.expect(coarse, fine.row, *fine.pressure())

    def test_resumes_the_current_row_from_where_others_left_the_arm(self):
        series = player()
        series.advance(4.5)
        series.resume(np.array([50.0, 50.0]))
        self.expect(series, 1, 50, 50)
        series.advance(1.0)
        self.expect(series, 1, 175, 25)


def series_of(*pairs):
    out = TimeSeries()
    for moment, *value in pairs:
        out.add(moment, np.array(value))
    return out


class TimeSeriesTest(unittest.TestCase):
    def test_is_linear_between_its_values(self):
        self.assertIsNone(TimeSeries().between(0))
        series = series_of(*((t, t, -3 * t) for t in (10.0, 10.1, 10.2)))
        for t in (10.0, 10.03, 10.1, 10.17, 10.2):
            np.testing.assert_allclose(series.between(t), (t, -3 * t), atol=1e-12)
        self.assertIsNone(series.between(9.99))

    def test_the_newest_holds_for_a_moment_alone_and_long_gaps_are_not_bridged(self):
        for margin in (-1e-3, 1e-3):
            self.assertEqual(series_of((10, 1)).between(10 + AHEAD + margin) is not None, margin < 0)
            self.assertEqual(series_of((10, 1)).covers(10 + margin), margin < 0)
            self.assertEqual(series_of((10, 1), (10 + REACH + margin, 2)).between(10.1) is not None, margin < 0)

    def test_a_command_is_in_force_until_the_next(self):
        series = series_of((10, 1), (10.5, 2))
        for moment, value in ((9.9, None), (10, 1), (10.499, 1), (10.5, 2), (11.499, 2), (11.501, None)):
            self.assertEqual(series.in_force(moment), value, moment)


def row_at(stamp, path_time, measured=0.003, **more):
    """Wanted at 0, measured 3 mm from it and predicted 2 mm."""
    return Row(stamp, path_time, np.zeros(3), np.array([0, measured, 0]), np.array([0, 0, 0.002]), 1e-4, "closed", **more)


class RecordTest(unittest.TestCase):
    def test_a_row_waits_until_all_has_come_and_gets_what_was_at_its_time(self):
        record = TipRecord()
        record.add(row_at(1.05, 0))
        for moment, complete in ((1.0, False), (1.1, True)):
            record.model.add(moment, np.array([moment, 0, 0]))
            record.command.add(moment, np.array([1e3 * moment]))
            record.update()
            self.assertFalse(record.is_complete(), "the pressures of its time have not come")
            record.pressure.add(moment, np.array([1e4 * moment]))
            record.update()
            self.assertEqual(record.is_complete(), complete)
        row = record.finish()[0]
        self.assertAlmostEqual(row.model[0], 1.05)
        self.assertEqual(row.command[0], 1000, "in force, not interpolated")
        self.assertAlmostEqual(row.pressure[0], 10500)

    def test_errors_are_those_on_the_path(self):
        rows = [row_at(1, -0.1, 1), row_at(2, 0), row_at(3, 1, 0.004), row_at(4, 1.1, 1)]
        self.assertAlmostEqual(run_record.rms_of(rows, "measured", 1.0), np.sqrt((9e-6 + 16e-6) / 2), 15)
        self.assertAlmostEqual(run_record.rms_of(rows, "predicted", 1.0), 0.002, 15)
        self.assertIsNone(run_record.rms_of(rows, "model", 1.0))


CALIBRATED = b"""
calibration:
  date: "2026-01-31T12:00:00Z"
  package_version: "0.1.0"
  from: arm.yaml
  data:
    - {file: a.csv, sha256: ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad, captures: 36}
  parameters:
    K_kappa: {value: 1.5e-4, standard_error: 2.0e-6, identifiable: true, unit: m^2}
  rms: 0.3
  error_unit: px
"""


class FileTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        # The name of the one begins with that of the other.
        self.inside, self.outside = [os.path.join(os.path.realpath(folder.name), name) for name in ("in", "inside_not")]
        for name in (self.inside, self.outside):
            os.mkdir(name)
            self.write(os.path.join(name, "data.csv"), b"a,b\n")
        self.access = FileAccess({"~out_folder": self.inside})

    def write(self, path, content):
        with open(path, "wb") as file:
            file.write(content)

    def refusal(self, name, content=None, call=None):
        path = os.path.join(self.inside, name)
        if content is not None:
            self.write(path, content)
        try:
            self.assertEqual((call or self.access.to_write)("out", path, ".csv", ".png", ".yaml"), os.path.realpath(path))
            return ""
        except ValueError as error:
            self.assertTrue(str(error).startswith(f"out is '{path[:8]}"), error)
            return str(error)

    def test_new_files_and_ours_are_written_and_nothing_else(self):
        with open(_core.scene_path("demo"), "rb") as file:
            demo = file.read()
        for name, content in (("new.csv", None), ("run.csv", b"# recorded run of circle.csv, 2026\n"),
                              ("samples.csv", b"# recorded of scene demo, 2026\n"), ("calibrated.yaml", demo + CALIBRATED),
                              ("run.png", b"\x89PNG Software helix_arm plot_report")):
            self.assertEqual(self.refusal(name, content), "")
        writer = b"helix_arm plot_report"
        os.mkdir(os.path.join(self.inside, "folder.yaml"))
        os.mkfifo(os.path.join(self.inside, "fifo.yaml"))
        for name, target in (("link.csv", "data.csv"), ("dangling.yaml", "none.yaml")):
            os.symlink(os.path.join(self.inside, target), os.path.join(self.inside, name))
        for name, content in (("data.csv", None), ("short.csv", b"# recorded"), ("foreign.png", b"\x89PNG somebody"),
                              ("named.png", writer), ("hidden.png", b"\x89PNG" + 300 * b" " + writer), ("empty.csv", b""),
                              ("hand_made.yaml", demo), ("notes.yaml", b"a: 1\n"), ("empty.yaml", b""), ("link.csv", None),
                              ("dangling.yaml", None), ("folder.yaml", None), ("fifo.yaml", None)):
            self.assertIn("exists and was not written by this package", self.refusal(name, content))
        self.assertIn("No such file", self.refusal("none/new.csv"))


if __name__ == "__main__":
    unittest.main()
