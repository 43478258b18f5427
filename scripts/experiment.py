"""Measures an arm, or analyses recordings. Run as a file by `helix_arm experiment`.

usage: experiment.py PROGRAM [OPTION..] NAME SCENE, as --help says
"""
from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import time
from pathlib import Path
from typing import Callable, Dict, List, Optional, Sequence

if sys.argv[1:] in (["-h"], ["--help"]):
    print(__doc__)
    sys.exit()
sys.path.insert(0, str(Path(sys.argv[1]).resolve().parents[1] / "python3/dist-packages"))
from helix_arm.experiments import EXPERIMENTS, Options, Progress, Result, SimulatedRig, measure, read_series, sheet  # noqa: E402
from helix_arm.experiments.figures import Figure  # noqa: E402
from helix_arm.experiments.protocol import Analysis, Recordings, parts_of  # noqa: E402
from helix_arm.experiments.run import ALL, UNNAMED, estimate_s, measure_all, result_of, write  # noqa: E402
from helix_arm.scene import Scene  # noqa: E402

ANALYSE = "analyse"
ALONE = ("hysteresis", "step", "creep")  # what recordings of any motion may tell, of one actuator at a time
TELL_S = 120.0  # of the rig, between two lines on stderr
DONE, NOT_POSSIBLE, CALLER_ERRED, INTERRUPTED = 0, 1, 2, 130
HELP = """measure an arm by a fixed protocol: figures with standard errors, data sheet
Usage: helix_arm experiment [OPTIONS] NAME SCENE
       helix_arm experiment [OPTIONS] analyse NAME DATA...

Positionals:
  NAME TEXT:{step,workspace,hysteresis,bode,repeatability,stiffness,payload,creep,all,analyse} REQUIRED
                              experiment, or all of them, or analyse and the experiment of recordings, or all: hysteresis,
                              step and creep of each actuator
  SCENE TEXT REQUIRED         scene file with camera and tags, or name of a shipped scene
  DATA TEXT ... REQUIRED      of analyse: series of the tip as helix_arm calibrate takes them, with commanded_1_kpa .. where known

Options:
  -h,--help                   Print this help message and exit
  --out DIR                   folder of sheet, figures and raw series, required unless to analyse; a call that was stopped goes on there
  --rig FILE                  scene file of the rig, if it is another one, or name of a shipped scene
  --plant COMMAND             command that simulates the true arm in place of the rig's: docs/closed_loop.md
  --scene SCENE               of analyse: scene of the arm, or name of a shipped scene
  --actuators NAMES           actuators that are driven, as a,b,c; default: all, one after the other
  --repeats N                 number of repeats in place of the protocol's, at least 2
  --hold-s S                  time of a hold, or of a period of bode [s], in place of the protocol's
  --seed UINT=1               seed of all noise of the simulated rig

The simulated rig runs the protocols of docs/experiments.md, which defines every figure.
DIR gets NAME.json, NAME.html, NAME.pdf and raw/NAME-TRIAL.csv: a trial is TRIAL.part.csv
until it is complete; complete ones are not measured again.
json: experiment, scene, scene_sha256, version, date, figures [{name, symbol, value,
standard_error, unit, definition}], ended (empty, or why it was stopped). Value +- 1.96
standard_error is the 95 % interval; both are null where the recordings do not determine a
figure, and definition says why. Of all: an array of these. csv: one row per figure.
Exit code 1 if it was stopped or no figure has a value; 130 on Ctrl-C.
"""


def _arguments(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("helix_arm experiment", add_help=False, allow_abbrev=False)
    parser.add_argument("words", nargs="*")
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("--format", choices=("text", "json", "csv"), default="text")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    for name in ("--out", "--rig", "--plant", "--scene", "--actuators"):
        parser.add_argument(name, default="")
    parser.add_argument("--repeats", type=int)
    parser.add_argument("--hold-s", type=float)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_intermixed_args(words)


def _check(given: argparse.Namespace) -> None:
    """Raises ValueError naming an argument, its value and its rule."""
    words = given.words
    analyses = words[:1] == [ANALYSE]
    known = [*EXPERIMENTS, ALL]
    name = words[1 if analyses else 0:][:1]
    if not name or name[0] not in known:
        raise ValueError(f"experiment: the name is {name[0] if name else 'missing'}; expected {', '.join(known)}"
                         + ("" if analyses else f", or {ANALYSE}"))
    if analyses and len(words) < 3 or not analyses and len(words) != 2:
        raise ValueError(f"experiment {' '.join(words[:2])}: expected " + ("recordings" if analyses else "the name and a SCENE"))
    if not analyses and not given.out:
        raise ValueError("--out is missing; expected the folder of the data sheet")
    if given.repeats is not None and given.repeats < 2:
        raise ValueError(f"--repeats is {given.repeats}; expected a number >= 2")
    if given.hold_s is not None and not 0.5 <= given.hold_s <= 3600:
        raise ValueError(f"--hold-s is {given.hold_s:g}; expected a time of 0.5 to 3600 s")


def _scene(path: str, changes: Sequence[str]) -> Scene:
    pairs = {}
    for one in changes:
        key, equal, value = one.partition("=")
        if not equal:
            raise ValueError(f"--set {one}; expected KEY=VALUE")
        pairs[key] = value
    return Scene.load(path, pairs)


def _analyse(given: argparse.Namespace) -> List[Result]:
    name, files = given.words[1], given.words[2:]
    scene = _scene(given.scene, given.set) if given.scene else None
    recordings = {}
    count = len(scene.actuators) if scene else 0
    for path in files:
        if scene is None:
            with open(path, encoding="utf-8") as file:
                header = next((line for line in file if not line.startswith("#")), "")
            count = max([int(one) for one in re.findall(r"pressure_(\d+)_kpa", header)], default=0)
        for trial, recording in read_series(Path(path), count).items():
            recordings[trial if trial not in recordings else f"{Path(path).stem} {trial}"] = recording
    names = scene.actuators if scene else [f"{UNNAMED}{i + 1}" for i in range(count)]
    analyses = [(one, _analysis_of(one, recordings, names, scene)) for one in (ALONE if name == ALL else (name,))]
    if given.out:
        return [write(name, analyses, scene, f"recordings {', '.join(Path(one).name for one in files)}", Path(given.out))]
    return [result_of(one, analysis, scene) for one, analysis in analyses]


def _analysis_of(name: str, recordings: Recordings, names: Sequence[str], scene: Optional[Scene]) -> Analysis:
    """Figures of recordings, actuator by actuator where the protocol drives one alone; or why there are none."""
    if name in ALONE:
        recordings = {f"{trial} {i + 1}" if i > 0 else trial: part for trial, one in recordings.items()
                      for i, part in enumerate(parts_of(one))}
    found = EXPERIMENTS[name].analyse(recordings, names, scene)
    known = {(one.name.split()[0], one.symbol) for one in found.figures if one.value is not None}
    figures: Dict[str, Figure] = {}
    for one in found.figures:
        if one.value is not None or (one.name.split()[0], one.symbol) not in known:
            figures.setdefault(one.name, one)
    return Analysis(list(figures.values()), found.plots)


def _measure(given: argparse.Namespace, stop: Callable[[], str]) -> List[Result]:
    name, scene = given.words[0], _scene(given.words[1], given.set)
    rig = SimulatedRig(scene, Scene.load(given.rig) if given.rig else None, given.plant, given.seed)
    names = given.actuators.split(",") if given.actuators else scene.actuators
    for one in names:
        if one not in scene.actuators:
            raise ValueError(f"--actuators has {one}; expected some of {', '.join(scene.actuators)}")
    options = Options([scene.actuators.index(one) for one in names], given.repeats, given.hold_s)
    experiments = [*EXPERIMENTS] if name == ALL else [name]
    times = {one: estimate_s([one], scene, rig, options) for one in experiments}
    total, begin = sum(times.values()), time.monotonic()
    told, found = -TELL_S, -1.0  # time on the rig: of the last line, and of what a call that goes on found on disk [s]

    def tell(progress: Progress) -> None:
        nonlocal told, found
        done = sum(times[one] for one in experiments[:experiments.index(progress.experiment)]) + progress.done_s
        found = done if found < 0 else found
        if done < told + TELL_S:
            return
        told = done
        wait = f", {(time.monotonic() - begin) / (done - found) * (total - done) / 60:.1f} min left" if done > found else ""
        print(f"{progress.experiment}: {progress.trial}{wait}", file=sys.stderr, flush=True)

    print(f"{name}: {total / 60:.0f} min on a rig in real time; the simulated rig is faster", file=sys.stderr)
    if name == ALL:
        return measure_all(scene, rig, Path(given.out), options, stop, tell)
    return [measure(name, scene, rig, given.out, options, stop=stop, tell=tell)]


def _print(results: Sequence[Result], style: str) -> None:
    if style == "json":
        documents = [one.document() for one in results]
        print(json.dumps(documents if len(documents) != 1 else documents[0], indent=1))
        return
    if style == "csv":
        print("experiment,name,symbol,value,standard_error,unit")
    for result in results:
        if style == "text":
            print(f"experiment  {result.experiment}" + (f" of {result.scene}" if result.scene else ""))
        for one in result.figures:
            if style == "csv":
                numbers = ["" if x is None else repr(x) for x in (one.value, one.standard_error)]
                print(",".join([result.experiment, json.dumps(one.name), one.symbol, *numbers, one.unit]))
            else:
                print(f"  {one.name:<44}  {sheet.value_text(one)}" if one.value is not None else f"  {one.name:<44}  {one.definition}")
        if style == "text":
            for note in ([f"stopped: {result.ended}"] if result.ended else []) + [f"written {path}" for path in result.paths.values()]:
                print(note)


def main() -> None:
    """Ends the process."""
    noted: List[int] = []
    for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(one, lambda number, frame: noted.append(number))
    given = _arguments(sys.argv[2:])
    if given.help:
        print(HELP, end="")
        sys.exit(DONE)
    try:
        _check(given)
        analyses = given.words[0] == ANALYSE
        results = _analyse(given) if analyses else _measure(given, lambda: "interrupted" if noted else "")
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        sys.exit(CALLER_ERRED)
    except RuntimeError as error:  # of a plant, or an arm that no shape balances
        print(error, file=sys.stderr)
        sys.exit(NOT_POSSIBLE)
    _print(results, given.format)
    if noted:
        sys.exit(INTERRUPTED)
    known = any(one.value is not None for result in results for one in result.figures)
    sys.exit(DONE if known and not results[-1].ended else NOT_POSSIBLE)


if __name__ == "__main__":
    main()
