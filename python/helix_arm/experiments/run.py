"""Measures an arm by the trials of its experiments, and writes what they give."""
from __future__ import annotations

import datetime
import hashlib
import json
import os
import re
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

import helix_arm
from helix_arm import _core
from helix_arm.experiments import bode, creep, hysteresis, loads, repeatability, sheet, step, workspace
from helix_arm.experiments.figures import Figure
from helix_arm.experiments.protocol import Analysis, Experiment, Options, Recordings, Trial
from helix_arm.experiments.rig import Rig, columns, lines_of, read_series
from helix_arm.scene import Scene

ALL = "all"
UNNAMED = "actuator_"  # and a number: actuators of recordings without a scene
SETTLE = 1.5  # times the longest 98 % time of `step`
# `step` tells the others how long the arm takes to rest; `workspace` finds a wrong model before hours are spent.
EXPERIMENTS: Dict[str, Experiment] = {
    "step": Experiment(step.plan, step.analyse),
    "workspace": Experiment(workspace.plan, workspace.analyse),
    "hysteresis": Experiment(hysteresis.plan, hysteresis.analyse),
    "bode": Experiment(bode.plan, bode.analyse),
    "repeatability": Experiment(repeatability.plan, repeatability.analyse),
    "stiffness": Experiment(loads.plan_stiffness, loads.analyse_stiffness, "hang"),
    "payload": Experiment(loads.plan_payload, loads.analyse_payload, "hang"),
    "creep": Experiment(creep.plan, creep.analyse),
}


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
    analysis = EXPERIMENTS[name].analyse(recordings, scene.actuators, scene) if recordings else Analysis()
    if EXPERIMENTS[name].needs == "hang" and not rig.hangs:
        why = "this rig hangs no forces at the tip; hang weights, record trials named as docs/experiments.md says, and analyse them."
        analysis = Analysis([Figure.unknown(name, "", "", why)])
    return write(name, [(name, analysis)], scene, rig.origin, Path(out), ended)


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


def _picture_of(scene: Scene) -> Optional[np.ndarray]:
    """(height, width) of the scene's camera: the arm, bent by one actuator; None without a camera or tags."""
    if scene._picture_shape is None:
        return None
    shares = np.where(np.arange(len(scene.actuators)) == 0, 0.6, 0.1)
    return _core.picture(scene, scene.limits_pa[:, 0] + shares * np.ptp(scene.limits_pa, axis=1))


def write(name: str, sections: Sequence[Tuple[str, Analysis]], scene: Optional[Scene], conditions: str, out: Path,
          ended: str = "") -> Result:
    """Writes NAME.json, NAME.html and NAME.pdf of analyses by their experiments, each completely or not at all."""
    analysis = Analysis([one for _, part in sections for one in part.figures], [one for _, part in sections for one in part.plots])
    result = result_of(name, analysis, scene, ended)
    actuators = scene.actuators if scene else [one.name.partition(" ")[0] for one in analysis.figures if one.name.startswith(UNNAMED)]
    paths = {kind: out / f"{name}.{kind}" for kind in ("json", "html", "pdf")}
    out.mkdir(parents=True, exist_ok=True)
    header = sheet.header_of(result.document(), conditions)
    for path, content in zip(paths.values(), (json.dumps(result.document(), indent=1).encode(),
                                              sheet.html_of(header, sections, actuators).encode(),
                                              sheet.pdf_of(header, sections, actuators, _picture_of(scene) if scene else None))):
        _core._write(str(path), content)
    return Result(**{**vars(result), "paths": paths})


def measure_all(scene: Scene, rig: Rig, out: Path, options: Options, stop: Callable[[], str],
                tell: Callable[[Progress], None]) -> List[Result]:
    """Each experiment in the order of EXPERIMENTS, then a sheet of all. Ends where one is stopped."""
    results: List[Result] = []
    for name in EXPERIMENTS:
        results.append(measure(name, scene, rig, out, options, stop=stop, tell=tell))
        if results[-1].ended:
            break
        if name == "step":
            found = (one for one in results[-1].figures if one.symbol == "t98" and one.name.endswith("tip"))
            times = [one.value for one in found if one.value is not None]
            if times:
                options = replace(options, settle_s=float(np.clip(SETTLE * max(times), 1.0, 30.0)))
    write(ALL, [(one.experiment, one.analysis) for one in results], scene, rig.origin, out, results[-1].ended)
    return results


def estimate_s(names: Sequence[str], scene: Scene, rig: Rig, options: Options) -> float:
    """Time of all trials on a rig [s]."""
    return sum(float(trial.inputs.time_s[-1]) for name in names for trial in plan(name, scene, rig, options))
