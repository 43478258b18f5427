"""Measures an arm, or analyses recordings: the command `helix_arm experiment`."""
from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import re
import signal
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

import helix_arm
from helix_arm.experiments import sheet
from helix_arm.experiments.figures import Figure
from helix_arm.experiments.protocol import Analysis, Options, Recordings, Trial
from helix_arm.experiments.registry import EXPERIMENTS
from helix_arm.experiments.rig import Rig, SimulatedRig, columns, lines_of, read_series
from helix_arm.scene import Scene

ALL, ANALYSE = "all", "analyse"
TELL_S = 120.0  # of the rig, between two lines on stderr
SETTLE = 1.5  # times the longest 98 % time of `step`
DONE, NOT_POSSIBLE, CALLER_ERRED, INTERRUPTED = 0, 1, 2, 130
HELP = """measure an arm by a fixed protocol: figures with standard errors, data sheet
Usage: helix_arm experiment [OPTIONS] NAME SCENE
       helix_arm experiment [OPTIONS] analyse NAME DATA...

Positionals:
  NAME TEXT:{step,workspace,hysteresis,bode,repeatability,stiffness,payload,creep,all,analyse} REQUIRED
                              experiment, or all of them, or analyse and the experiment of recordings
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


@dataclass(frozen=True)
class Progress:
    """Before a trial, and after each piece of one. done_s, total_s: of all trials that were to be measured."""

    experiment: str
    trial: str
    done_s: float
    total_s: float


@dataclass(frozen=True)
class Result:
    """ended: "", or why the rig stopped; figures are then of the complete trials. paths: of json, html and pdf."""

    experiment: str
    scene: str
    scene_sha256: str
    version: str
    date: str
    figures: List[Figure]
    ended: str = ""
    analysis: Analysis = field(default_factory=Analysis)
    paths: Dict[str, Path] = field(default_factory=dict)

    def document(self) -> Dict[str, Any]:
        keys = ("experiment", "scene", "scene_sha256", "version", "date")
        return {**{key: getattr(self, key) for key in keys}, "figures": [asdict(one) for one in self.figures], "ended": self.ended}


def plan(name: str, scene: Scene, rig: Rig, options: Options) -> List[Trial]:
    """The trials of an experiment; none where the rig cannot do what it needs."""
    experiment = EXPERIMENTS[name]
    return experiment.plan(rig, scene, options) if experiment.needs != "hang" or rig.hangs else []


def measure(name: str, scene: Scene, rig: Rig, out: os.PathLike, options: Optional[Options] = None, *,
            stop: Callable[[], str] = lambda: "", tell: Callable[[Progress], None] = lambda progress: None) -> Result:
    """Records the trials of an experiment that `out` does not have, analyses all, and writes the sheet.

    stop: gives a reason to stop, or "". Raises ValueError where `out` holds trials of another call.
    """
    options = options or Options(range(len(scene.actuators)))
    recordings, ended = record(name, plan(name, scene, rig, options), scene, rig, Path(out), stop, tell)
    analysis = analysis_of(name, recordings, scene.actuators, scene, rig.hangs)
    return write(name, analysis, scene, rig.origin, Path(out), ended)


def analysis_of(name: str, recordings: Recordings, names: Sequence[str], scene: Optional[Scene], hangs: bool = True) -> Analysis:
    if EXPERIMENTS[name].needs == "hang" and not hangs:
        why = "this rig hangs no forces at the tip; hang weights, record trials named as docs/experiments.md says, and analyse them."
        return Analysis([Figure.unknown(name, "", "", why)])
    return EXPERIMENTS[name].analyse(recordings, names, scene) if recordings else Analysis()


def record(name: str, trials: Sequence[Trial], scene: Scene, rig: Rig, out: Path, stop: Callable[[], str],
           tell: Callable[[Progress], None]) -> Tuple[Recordings, str]:
    """All complete trials by their names, and why the rig stopped. Rows are on disk within a second of their measurement."""
    raw, recordings = out / "raw", {}
    raw.mkdir(parents=True, exist_ok=True)
    total, done = sum(float(one.inputs.time_s[-1]) for one in trials), 0.0
    for trial in trials:
        path = raw / f"{name}-{re.sub('[^A-Za-z0-9_.+-]+', '_', trial.name)}.csv"
        title = f"# {scene.name}, {rig.origin}, call {_key(trial, scene, rig)}\n"
        if path.exists():
            with open(path, encoding="utf-8") as file:
                if file.readline() != title:
                    raise ValueError(f"{path} is of another scene, rig, protocol or seed; choose another --out, or remove it")
        else:
            tell(Progress(name, trial.name, done, total))
            part = path.with_suffix(".part.csv")
            with open(part, "w", encoding="utf-8") as file:
                file.write(title + ",".join(columns(len(rig.limits_pa))) + "\n")

                def sink(rows: np.ndarray) -> None:
                    file.write(lines_of(trial.name, rows))
                    file.flush()
                    tell(Progress(name, trial.name, done + float(rows[-1, 0]), total))

                if rig.hangs:
                    rig.hang(np.zeros(3) if trial.force_n is None else trial.force_n)
                recording = rig.record(replace(trial.inputs, name=f"{name} {trial.name}"), stop, sink)
            if recording.ended:
                return recordings, f"{trial.name}: {recording.ended}"
            os.replace(part, path)
        done += float(trial.inputs.time_s[-1])
        # As it is on disk, so that a call that resumes gives the same figures.
        recordings[trial.name] = read_series(path, len(rig.limits_pa))[trial.name]
    return recordings, ""


def _key(trial: Trial, scene: Scene, rig: Rig) -> str:
    parts = [scene._sha256, repr(sorted(scene._overrides)), rig.origin, trial.name, trial.inputs.time_s.tobytes(),
             trial.inputs.pressure_pa.tobytes(), repr(None if trial.force_n is None else np.asarray(trial.force_n).tolist())]
    return hashlib.sha256(b"\n".join(one if isinstance(one, bytes) else one.encode() for one in parts)).hexdigest()[:16]


def result_of(name: str, analysis: Analysis, scene: Optional[Scene], ended: str = "") -> Result:
    date = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    return Result(name, scene.name if scene else "", scene._sha256 if scene else "", helix_arm.__version__, date, analysis.figures,
                  ended, analysis)


def write(name: str, analysis: Analysis, scene: Optional[Scene], conditions: str, out: Path, ended: str = "") -> Result:
    """Writes NAME.json, NAME.html and NAME.pdf, each completely or not at all."""
    result = result_of(name, analysis, scene, ended)
    paths = {kind: out / f"{name}.{kind}" for kind in ("json", "html", "pdf")}
    out.mkdir(parents=True, exist_ok=True)
    sheet.write(paths["json"], lambda file: file.write(json.dumps(result.document(), indent=1).encode()))
    header = sheet.header_of(result.document(), conditions)
    sheet.write(paths["html"], lambda file: file.write(sheet.html_of(header, analysis).encode()))
    sheet.write(paths["pdf"], lambda file: sheet.pdf_of(header, analysis, file))
    return Result(**{**vars(result), "paths": paths})


def settle_of(result: Result) -> float:
    """Time in which the arm of a `step` comes to rest [s]."""
    times = [one.value for one in result.figures if one.symbol == "t98" and one.name.endswith("tip") and one.value is not None]
    return float(np.clip(SETTLE * max(times), 1.0, 30.0)) if times else Options.settle_s


def measure_all(scene: Scene, rig: Rig, out: Path, options: Options, stop: Callable[[], str],
                tell: Callable[[Progress], None]) -> List[Result]:
    """Each experiment in the order of EXPERIMENTS, then a sheet of all. Ends where one is stopped."""
    results: List[Result] = []
    for name in EXPERIMENTS:
        results.append(measure(name, scene, rig, out, options, stop=stop, tell=tell))
        if results[-1].ended:
            break
        if name == "step":
            options = Options(options.actuators, options.repeats, options.hold_s, settle_of(results[-1]))
    both = Analysis([one for result in results for one in result.figures], [one for result in results for one in result.analysis.plots])
    write(ALL, both, scene, rig.origin, out, results[-1].ended)
    return results


def estimate_s(names: Sequence[str], scene: Scene, rig: Rig, options: Options) -> float:
    """Time of all trials on a rig [s]."""
    return sum(float(trial.inputs.time_s[-1]) for name in names for trial in plan(name, scene, rig, options))


# ---- The command ------------------------------------------------------------------------------------------------


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
    known = [*EXPERIMENTS] + ([] if analyses else [ALL])
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
    recordings: Recordings = {}
    count = len(scene.actuators) if scene else 0
    for path in files:
        if scene is None:
            with open(path, encoding="utf-8") as file:
                header = next((line for line in file if not line.startswith("#")), "")
            count = max([int(one) for one in re.findall(r"pressure_(\d+)_kpa", header)], default=0)
        for trial, recording in read_series(Path(path), count).items():
            recordings[trial if trial not in recordings else f"{Path(path).stem} {trial}"] = recording
    names = scene.actuators if scene else [f"actuator_{i + 1}" for i in range(count)]
    analysis = EXPERIMENTS[name].analyse(recordings, names, scene)
    if given.out:
        return [write(name, analysis, scene, f"recordings {', '.join(Path(one).name for one in files)}", Path(given.out))]
    return [result_of(name, analysis, scene)]


def _measure(given: argparse.Namespace, stop: Callable[[], str]) -> List[Result]:
    name, scene = given.words[0], _scene(given.words[1], given.set)
    rig = SimulatedRig(scene, Scene.load(given.rig) if given.rig else None, given.plant, given.seed)
    names = given.actuators.split(",") if given.actuators else scene.actuators
    for one in names:
        if one not in scene.actuators:
            raise ValueError(f"--actuators has {one}; expected some of {', '.join(scene.actuators)}")
    options = Options([scene.actuators.index(one) for one in names], given.repeats, given.hold_s)
    told = ["", -TELL_S]  # experiment, and when

    def tell(progress: Progress) -> None:
        if progress.experiment == told[0] and progress.done_s < told[1] + TELL_S:
            return
        told[:] = [progress.experiment, progress.done_s]
        left = (progress.total_s - progress.done_s) / 60
        print(f"{progress.experiment}: {progress.trial}, {left:.1f} min left on a rig in real time", file=sys.stderr, flush=True)

    if name == ALL:
        print(f"all: {estimate_s([*EXPERIMENTS], scene, rig, options) / 60:.0f} min on a rig in real time", file=sys.stderr)
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
    given = _arguments(sys.argv[1:])
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
