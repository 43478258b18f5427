"""Keeps a run of the command in a folder of its own, and makes it again. Run as a file by the command.

usage: session.py PROGRAM keep DIR SUBCOMMAND SCENES WORD...     (helix_arm SUBCOMMAND .. --session DIR)
       session.py PROGRAM rerun FORMAT FOLDER OUT SCENES         (helix_arm session rerun FOLDER)

SCENES is the folder of the shipped scenes. DIR/<UTC>_<SUBCOMMAND>/ gets
  session.json   version, subcommand, command (words), folder, time_utc, host, system, scene, scene_sha256 (of the scene and the
                 profile that it includes), inputs and outputs [{path, copy, sha256}], figures, exit_code
  command.sh     the call
  log.txt        stdout and stderr in the order in which they came; stdout.txt: stdout alone
  *.yaml, data   copies of scenes with their profiles, and of data
  out            copies of the files that the run wrote; figure.png: the report of a calibration with --format json
"""
import csv
import hashlib
import itertools
import json
import os
import platform
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

OUTPUTS = ("--out", "--png")
OTHER_SCENES = ("--rig", "--also")
STDIN = "-"
PROFILE = re.compile(r"\bprofile:\s*['\"]?([^\s'\",}#]+)")
TIME = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")  # when a scene was calibrated
MOST_DIFFERENCES = 20  # of a file


def sha256_of(*paths):
    digest = hashlib.sha256()
    for path in paths:
        with open(str(path), "rb") as file:  # videos are large
            for block in iter(lambda: file.read(1 << 20), b""):
                digest.update(block)
    return digest.hexdigest()


def version_of(program):
    return subprocess.run([program, "--version"], stdout=subprocess.PIPE, check=True).stdout.decode().split()[-1]


def put(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(str(source), str(target))


def values_of(words):
    """(option before it, text) of all that may be a path; lists and commands as a whole and in parts."""
    before = ""
    for word in words:
        option, equals, value = word.partition("=") if word.startswith("--") else (before, "=", word)
        before = "" if equals else option
        if equals:
            parts = value.split() if option == "--plant" else value.split(",")
            yield from ((option, text) for text in dict.fromkeys([value, *parts]))


class Folder:
    """The folder of one run."""

    def __init__(self, parent, subcommand):
        self.path = self._free(Path(parent), time.strftime("%Y%m%dT%H%M%SZ_", time.gmtime()) + subcommand, "")
        self.path.mkdir(parents=True)

    @staticmethod
    def _free(folder, stem, suffix):
        names = itertools.chain([stem], ("%s_%d" % (stem, number) for number in itertools.count(2)))
        return next(path for path in (folder / (name + suffix) for name in names) if not path.exists())

    def copy(self, source, kind):
        """Copies a file into the folder `kind`. @return what session.json says of it."""
        target = self._free(self.path / kind, source.stem, source.suffix)
        put(source, target)
        return {"path": os.path.abspath(str(source)), "copy": str(target.relative_to(self.path)), "sha256": sha256_of(target)}

    def take_inputs(self, words, scenes):
        """Copies what the words name. @return inputs; the scene as the words have it; the files of the scene."""
        inputs, scene, of_scene, seen = [], None, [], {""}
        for option, text in values_of(words):
            shipped = os.path.join(scenes, text + ".yaml")
            path = Path(shipped if os.sep not in text and os.path.isfile(shipped) and not os.path.isfile(text) else text)
            system = str(path).startswith(("/usr/", "/bin/")) and os.access(str(path), os.X_OK)  # an interpreter
            if text in seen or system or option in OUTPUTS:
                continue
            seen.add(text)
            group = [path] if os.path.isfile(str(path)) else []  # a list of tips may be longer than a path, which Path refuses
            group += sorted(filter(Path.is_file, path.iterdir())) if os.path.isdir(str(path)) else []
            if path.suffix == ".yaml" and group:
                profiles = PROFILE.findall(path.read_text(encoding="utf-8", errors="replace"))
                group += [path.parent / each for each in profiles if (path.parent / each).is_file()]
                if scene is None and option not in OTHER_SCENES:
                    scene, of_scene = text, group
            inputs += [self.copy(each, "" if path.suffix == ".yaml" else "data") for each in group]
            if text == STDIN:
                copy = self.path / "data" / "stdin"
                copy.parent.mkdir(exist_ok=True)
                copy.write_bytes(sys.stdin.buffer.read())
                inputs.append({"path": STDIN, "copy": "data/stdin", "sha256": sha256_of(copy)})
        return inputs, scene, of_scene


def run(command, cwd, inputs, copies, to, echo):
    """Runs a command with its output in log.txt and stdout.txt of a folder, and passed on if asked for.

    @return its exit code; negative: the signal that ended it.
    """
    given = next((copies / each["copy"] for each in inputs if each["path"] == STDIN), os.devnull)
    with open(str(given), "rb") as stdin, open(str(to / "log.txt"), "wb") as log, open(str(to / "stdout.txt"), "wb") as out:
        child = subprocess.Popen(command, cwd=cwd, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(each, lambda number, _: child.send_signal(number))

        def pump(source, files):
            for chunk in iter(lambda: os.read(source.fileno(), 65536), b""):
                for file in list(files):
                    try:
                        rest = chunk
                        while rest:
                            rest = rest[file.write(rest):]
                        file.flush()
                    except BrokenPipeError:  # nobody reads on; the files get the rest
                        files.remove(file)

        own = [[open(number, "wb", buffering=0, closefd=False)] if echo else [] for number in (1, 2)]
        pumps = [threading.Thread(target=pump, args=(child.stdout, [log, out] + own[0])),
                 threading.Thread(target=pump, args=(child.stderr, [log] + own[1]))]
        for each in pumps:
            each.start()
        for each in pumps:
            each.join()
        return child.wait()


def stamp_of(path):
    """Changes when the file is written anew."""
    return (os.stat(path).st_mtime_ns, os.stat(path).st_ino) if os.path.exists(path) else None


def draw(program, scenes, folder):
    """Has plot_report draw what was printed. @return the figure's name; nothing if that is no report."""
    beside = Path(program).parent / "plot_report"  # where it is installed
    script = beside if beside.is_file() else Path(scenes).parents[1] / "scripts/plot_report"
    command = [str(script), str(folder / "stdout.txt"), str(folder / "figure.png")]
    return [] if subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode else ["figure.png"]


def keep(program, parent, subcommand, scenes, *words):
    words = [word for before, word in zip(("", *words), words) if "--session" not in (before, word.split("=")[0])]
    folder = Folder(parent, subcommand)
    inputs, scene, of_scene = folder.take_inputs(words, scenes)
    before = {text: stamp_of(text) for option, text in values_of(words) if option in OUTPUTS}
    call = "#!/bin/sh\ncd %s\nexec helix_arm %s\n" % (shlex.quote(os.getcwd()), " ".join(map(shlex.quote, words)))
    (folder.path / "command.sh").write_text(call, encoding="utf-8", errors="surrogateescape")
    (folder.path / "command.sh").chmod(0o755)
    record = {"version": version_of(program), "subcommand": subcommand, "command": words, "folder": os.getcwd(),
              "time_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "host": socket.gethostname(),
              "system": platform.platform(), "scene": scene, "scene_sha256": sha256_of(*of_scene) if of_scene else None}
    code = run([program, *words], None, inputs, folder.path, folder.path, True)
    outputs = []
    for path in (Path(text) for text, stamp in before.items() if stamp_of(text) != stamp):
        files = [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.is_file())
        outputs += [folder.copy(each, "out" / each.relative_to(path.parent).parent) for each in files]
    figures = [each["copy"] for each in outputs if each["copy"].endswith(".png")]
    figures += draw(program, scenes, folder.path) if subcommand == "calibrate" else []
    record.update(inputs=inputs, outputs=outputs, figures=figures, exit_code=code if code >= 0 else 128 - code)
    (folder.path / "session.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code


def differences_of(name, then, now):
    """Lines that differ, apart from the time of a calibration; of a file that is no text, its hash."""
    then, now = (hashlib.sha256(each).hexdigest().encode() if b"\0" in each else TIME.sub(b"", each) for each in (then, now))
    lines = itertools.zip_longest(then.decode(errors="replace").split("\n"), now.decode(errors="replace").split("\n"))
    found = [{"file": name, "line": i + 1, "then": old, "now": new} for i, (old, new) in enumerate(lines) if old != new]
    return found[:MOST_DIFFERENCES]


def make_again(program, folder, record, root, scenes):
    """Runs the command below the folder `root`, which mirrors the paths of the run.

    @return exit code; [(file of the run, file of now)]
    """
    def mirrored(path):
        return Path(str(root) + path)

    cwd = mirrored(record["folder"])
    cwd.mkdir(parents=True)
    for each in record["inputs"]:
        if sha256_of(folder / each["copy"]) != each["sha256"]:
            raise ValueError("%s has changed since the run; restore it" % (folder / each["copy"]))
        if each["path"] == STDIN:
            continue
        put(folder / each["copy"], mirrored(each["path"]))
        shipped = Path(scenes) / Path(each["path"]).name
        if shipped.stem in record["command"] and not (shipped.is_file() and sha256_of(shipped) == each["sha256"]):
            put(folder / each["copy"], cwd / shipped.stem)  # a shipped scene that has changed since: a file goes before it
    paths = {each["path"] for each in record["inputs"] + record["outputs"]}
    words = record["command"]
    for option, text in values_of(words):
        named = option in OUTPUTS or any(path == text or path.startswith(text + "/") for path in paths)
        if named and os.path.isabs(text):
            whole = re.compile(r"(?<![^=,\s])%s(?![^,\s])" % re.escape(text))
            words = [whole.sub(lambda _, to=str(mirrored(text)): to, word) for word in words]
    for text in (text for option, text in values_of(words) if option in OUTPUTS):
        (cwd / text).parent.mkdir(parents=True, exist_ok=True)
    code = run([program, *words], str(cwd), record["inputs"], folder, root, False)
    made = [(each["copy"], mirrored(each["path"])) for each in record["outputs"]
            if not each["copy"].endswith(".pdf")]  # a sheet, which bears its date; its figures are in a .json
    made.append(("stdout.txt", root / "stdout.txt"))
    if "figure.png" in record["figures"]:
        made += [(name, root / name) for name in draw(program, scenes, root)]
    return code if code >= 0 else 128 - code, made


def rerun(program, form, folder, out, scenes):
    folder, differences = Path(folder), []
    try:
        record = json.loads((folder / "session.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError("%s has no session.json that can be read; give a folder below that of --session" % folder) from error
    if out and os.path.isdir(out) and os.listdir(out):
        raise ValueError("--out %s is not empty; choose another folder" % out)
    with tempfile.TemporaryDirectory(prefix="helix_arm_rerun_") as root:
        code, made = make_again(program, folder, record, Path(root), scenes)
        for name, now in made:
            content = now.read_bytes().replace(os.fsencode(root), b"") if now.is_file() else b""
            differences += differences_of(name, (folder / name).read_bytes(), content)
            if out and now.is_file():
                put(now, Path(out) / name)
    same = not differences and code == record["exit_code"]
    result = {"folder": str(folder), "same": same, "version": version_of(program), "version_then": record["version"],
              "exit_code": code, "exit_code_then": record["exit_code"], "differences": differences, "out": out or None}
    if form == "json":
        print(json.dumps(result, indent=2))
    elif form == "csv":
        rows = csv.DictWriter(sys.stdout, ["file", "line", "then", "now"], lineterminator="\n")
        rows.writeheader()
        rows.writerows(differences)
    else:
        print("same       %s" % ("yes" if same else "no"))
        print("version    %(version)s, then %(version_then)s\nexit code  %(exit_code)s, then %(exit_code_then)s" % result)
        for each in differences:
            print("%(file)s:%(line)s\n  then     %(then)s\n  now      %(now)s" % each)
    return 0 if same else 1


def main(program, what, *arguments):
    try:
        return (keep if what == "keep" else rerun)(program, *arguments)
    except OSError as error:
        print("%s: %s; choose another folder" % (error.filename, error.strerror), file=sys.stderr)
    except ValueError as error:
        print(error, file=sys.stderr)
    return 2


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        sys.exit()
    sys.exit(main(*sys.argv[1:]))
