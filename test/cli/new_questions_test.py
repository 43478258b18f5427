#!/usr/bin/env python3
"""`helix_arm new` on a terminal: what it asks, what it does with answers that break a rule, and how it ends without them.

usage: new_questions_test.py --command HELIX_ARM
"""
import os
import pty
import select
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

DEADLINE = 30  # [s] of one answer
CTRL_C, CTRL_D = "\x03", "\x04"
COMMAND = None


class Terminal:
    """The command on a terminal of its own, which Ctrl-C and Ctrl-D reach."""

    def __init__(self, *arguments):
        self.seen = ""
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            os.execv(COMMAND, [COMMAND, *arguments])

    def _read(self):
        """Whether there was more to read."""
        ready, _, _ = select.select([self.terminal], [], [], DEADLINE)
        if not ready:
            raise AssertionError("nothing more within %d s after: %s" % (DEADLINE, self.seen))
        try:
            more = os.read(self.terminal, 4096)
        except OSError:  # Linux: the other end is closed
            more = b""
        self.seen += more.decode().replace("\r\n", "\n")
        return bool(more)

    def question(self):
        """The question that it waits for an answer to; empty once it has ended."""
        while not self.seen.endswith("]: "):
            if not self._read():
                return ""
        return self.seen.rsplit("\n", 1)[-1]

    def type(self, text):
        """Types, and @return what it says up to the next question."""
        before = len(self.seen)
        os.write(self.terminal, text.encode())
        # The echo of the answer, so that the question before is not taken for the next one. Nothing echoes Ctrl-D.
        while len(self.seen) == before:
            if not self._read():
                break
        self.question()
        return self.seen[before:]

    def answer(self, text=""):
        return self.type(text + "\n")

    def end(self):
        """Exit code, as a shell gives it."""
        while self._read():
            pass
        os.close(self.terminal)
        deadline = time.monotonic() + DEADLINE
        while time.monotonic() < deadline:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return 128 + os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)
            time.sleep(0.01)
        os.kill(self.pid, signal.SIGKILL)
        raise AssertionError("it does not end: " + self.seen)

    def keep_all(self):
        """Enter to all questions that are left. @return them."""
        questions = []
        while self.question():
            questions.append(self.question())
            self.answer()
        return questions


class NewOnATerminal(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        (self.folder / "asked").mkdir()
        (self.folder / "told").mkdir()
        self.out = str(self.folder / "asked" / "arm.yaml")

    def told(self, *options):
        """The text of the scene that these options give without a terminal."""
        out = self.folder / "told" / "arm.yaml"
        subprocess.run([COMMAND, "new", "--out", str(out), "--force", *options], check=True, stdin=subprocess.DEVNULL,
                       stdout=subprocess.DEVNULL)
        return out.read_text()

    def assert_written(self, terminal, *options):
        self.assertEqual(terminal.end(), 0, terminal.seen)
        self.assertEqual(Path(self.out).read_text(), self.told(*options))
        check = subprocess.run([COMMAND, "check", self.out], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        self.assertEqual(check.returncode, 0, check.stdout.decode())

    def assert_nothing_written(self):
        self.assertEqual(os.listdir(self.folder / "asked"), [])

    def test_enter_keeps_the_defaults(self):
        terminal = Terminal("new", "--out", self.out)
        questions = terminal.keep_all()
        self.assertEqual(len(questions), 12, questions)
        self.assertIn("Enter keeps the value in brackets; Ctrl-C leaves without a file.", terminal.seen)
        # A length and the like say their unit, and every number its range.
        for words in ("without pressure, in m (0.02 to 5) [0.3]: ", "in degrees (-60 to 60;", "in kPa (1 to 2000) [300]: "):
            self.assertTrue(any(words in question for question in questions), words)
        self.assert_written(terminal, "--defaults")

    def test_answers_are_what_options_would_be(self):
        terminal = Terminal("new", "--out", self.out)
        for answer in ("2", "4", "0.4", "0.25", "0.03", "15", "200", "0.028", "3", "0.9", "lying", "none"):
            terminal.answer(answer)
        self.assert_written(terminal, "--sections", "2", "--muscles", "4", "--length-m", "0.4", "--contraction", "0.25",
                            "--radius-m", "0.03", "--tilt-deg", "15", "--max-pressure-kpa", "200", "--tag-size-m", "0.028",
                            "--tags", "3", "--camera-distance-m", "0.9", "--mounting", "lying", "--regulator", "none")

    def test_what_breaks_a_rule_is_asked_for_again(self):
        terminal = Terminal("new", "--out", self.out)
        answers = (  # the question's beginning, what is wrong with each answer, the answer that is taken
            ("number of sections", (("three", "three is not a number"), ("2.5", "2.5 is not a whole number"),
                                    ("17", "--sections is 17; expected 1 to 16")), "1"),
            ("number of muscles", (), "5"),
            ("length of a muscle", (("0,3", "0,3 is not a number; expected one such as 0.3"), ("nan", "nan is not a number")), " 0.4 "),
            ("by how much it shortens", (), ""), ("from the arm's centre line", (), "0.03"), ("tilt", (), "0"),
            ("highest gauge pressure", (), "250"),
            ("outer edge", (("0.06", "which overlaps on 5 muscles side by side; expected at most 0.053"),), "0.03"),
            ("number of tags", (("12", "12 tags of 30 mm with their white border do not fit"),), "4"),
            ("from the arm to the camera", (), "1"),
            ("mounting", (("upside down", "upside down is no mounting; expected hanging, standing or lying"),), "standing"),
            ("pressure regulator", (), "generic"), ("serial device of the regulator", (), "/dev/tty: USB #7"),
        )
        for begin, wrong, right in answers:
            question = terminal.question()
            self.assertTrue(question.startswith(begin), question)
            for answer, words in wrong:
                said = terminal.answer(answer)
                self.assertIn(words, said)
                self.assertEqual(terminal.question(), question, "what Enter keeps is the same")
            terminal.answer(right)
        self.assert_written(terminal, "--muscles", "5", "--length-m", "0.4", "--radius-m", "0.03", "--max-pressure-kpa", "250",
                            "--tags", "4", "--camera-distance-m", "1", "--mounting", "standing", "--regulator", "generic", "--device", "/dev/tty: USB #7")

    def assert_leaves_no_file(self, key, exit_code, words=""):
        for answers in (0, 5, 10):
            terminal = Terminal("new", "--out", self.out)
            terminal.question()
            for _ in range(answers):
                terminal.answer()
            terminal.type(key)
            self.assertEqual(terminal.end(), exit_code, terminal.seen)
            self.assertIn(words, terminal.seen)
            self.assert_nothing_written()

    def test_the_end_of_the_input_leaves_no_file(self):
        self.assert_leaves_no_file(
            CTRL_D, 2, "the answers end before the last question, so that nothing is written; answer all, or give --defaults")

    def test_ctrl_c_leaves_no_file(self):
        self.assert_leaves_no_file(CTRL_C, 130)


if __name__ == "__main__":
    COMMAND = sys.argv[sys.argv.index("--command") + 1]
    unittest.main(argv=sys.argv[:1])
