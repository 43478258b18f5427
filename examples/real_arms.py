#!/usr/bin/env python3
"""Fits recordings of other people's arms in the arms' own geometry, and predicts trials that the fits have not seen.

usage: real_arms.py FOLDER [ARM]   the recordings: three_chamber_steps.csv with three_chamber_guess.yaml, two_section_steps.csv,
                                   koopman_arm.csv, fabric_two_chambers.csv; those that are absent are left out. ARM: the
                                   begin of a row, such as Koopman, for that row alone
Prints one row per arm: what was fitted, the RMS distance of the tip on trials left out, with the offset of each trial taken
off, and that of a cubic of the pressures behind a lag, fitted to those trials without the part that it predicts. The command
helix_arm has to be on PATH. docs/real_arms.md explains each step.
"""

import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

KPA_PER_COMMAND = 10.0  # Koopman arm: the regulators' full scale of 10 as 100 kPa; only the curve's inputs depend on it
METRES_PER_UNIT = 0.1  # of its recording
FIT = "stiffness,contraction,length_scale_each,base,response"


def helix_arm(*arguments):
    """The JSON that a call of the command prints."""
    done = subprocess.run(["helix_arm", *map(str, arguments), "--format", "json"], stdout=subprocess.PIPE,
                          universal_newlines=True, check=False)
    result = json.loads(done.stdout) if done.stdout else {}
    if done.returncode != 0:
        sys.exit("helix_arm %s: %s" % (arguments[0], result.get("reason", "exit code %d" % done.returncode)))
    return result


def rows_of(path):
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def write(rows, path):
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    return path


def koopman_rows(path):
    """Commands as pressures, and the place of the laser's dot in its plane."""
    return [{"trial": row["trial"], "time_s": row["time_s"],
             **{"pressure_%d_kpa" % k: KPA_PER_COMMAND * float(row["command_%d" % k]) for k in (1, 2, 3)},
             **{axis + "_m": METRES_PER_UNIT * float(row[axis]) for axis in "xy"}} for row in rows_of(path)]


def new_scene(path, options, changes):
    """A scene that `helix_arm new` writes, with texts changed that it has no options for."""
    subprocess.run(["helix_arm", "new", "--out", path, "--force", "--defaults", "--regulator", "none", *options],
                   check=True, stdout=subprocess.DEVNULL)
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        if old not in text:
            sys.exit("helix_arm new writes no %r; expected it in %s" % (old, path))
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def two_section_scene(path):
    """Chamber 1 of each section lies at -x of the recording, since it bends the arm towards x. Sizes are guesses."""
    return new_scene(path, ["--chambers", "--sections", "2", "--length-m", "0.14", "--contraction", "0.35",
                            "--radius-m", "0.025", "--max-pressure-kpa", "120"],
                     [("position_m: [0, 0, 0.7]", "position_m: [0, 0, 0]"),
                      ("        contraction: chamber\n", "        contraction: chamber\n        phase_deg: 270\n")])


def koopman_scene(path):
    """Contracting muscles around a spine whose end is 34 units above the plane of the dot. Sizes are guesses."""
    return new_scene(path, ["--length-m", "%g" % (20 * METRES_PER_UNIT), "--contraction", "0.03",
                            "--radius-m", "%g" % (2 * METRES_PER_UNIT), "--max-pressure-kpa", "%g" % (7 * KPA_PER_COMMAND)],
                     [("        contraction: muscle\n", "        contraction: muscle\n        phase_deg: 208\n"),
                      ("K_kappa_m2: 1.38e-4", "K_kappa_m2: %g" % (1.38 * METRES_PER_UNIT**2)),
                      ("\n# How the simulated rig", "\nmotion_capture: {frame: {position_m: [%g, 0, 0], rpy_deg: [0, -90, 0]}, beam_deg: [0, 0]}\n"
                       "\n# How the simulated rig" % (54 * METRES_PER_UNIT))])


def fabric_rows(path):
    """The channels in the order in which the chambers follow each other in the scene."""
    rows = rows_of(path)
    for one in rows:
        one["pressure_1_kpa"], one["pressure_2_kpa"] = one["pressure_2_kpa"], one["pressure_1_kpa"]
    return rows


def fabric_scene(path):
    """Two of four chambers in one body. Sizes are guesses."""
    return new_scene(path, ["--chambers", "--muscles", "4", "--length-m", "0.28", "--contraction", "0.3", "--radius-m", "0.03",
                            "--max-pressure-kpa", "75", "--tag-size-m", "0"], [])


def predict(scene, rows, held_out, folder):
    """Squares of the errors on the trials `held_out`, fitted to the others: (count, with offset, without, of a cubic)."""
    fitted = folder / "fitted.yaml"
    seen = write([row for row in rows if row["trial"] not in held_out], folder / "seen.csv")
    unseen = write([row for row in rows if row["trial"] in held_out], folder / "unseen.csv")
    helix_arm("calibrate", scene, seen, "--fit", FIT, "--out", fitted)
    result = helix_arm("evaluate", fitted, unseen)
    return (result["rows"], *(result[key]**2 * result["rows"] for key in ("rms_m", "rms_without_offset_m", "baseline_rms_m")))


def row(name, scene, rows, folds, folder, scale=1e3):
    found = [predict(scene, rows, held_out, folder) for held_out in folds]
    count = sum(one[0] for one in found)
    errors = [scale * (sum(one[i] for one in found) / count)**0.5 for i in (1, 2, 3)]
    print("%-42s %8.2f %16.2f %8.2f" % (name, *errors), flush=True)


def row_of_parts(name, scene, rows, folder):
    """One trial or few: calibrate leaves out tenths of them by itself."""
    result = helix_arm("calibrate", scene, write(rows, folder / "all.csv"), "--fit", FIT, "--out", folder / "fitted.yaml")
    errors = [1e3 * result["series"][key] for key in ("held_out_rms_m", "baseline_held_out_rms_m")]
    print("%-42s %8.2f %16s %8.2f" % (name, errors[0], "", errors[1]), flush=True)


def main(arguments):
    if len(arguments) not in (1, 2):
        sys.exit(__doc__.split("\n\n")[1])
    data, only = Path(arguments[0]), "".join(arguments[1:])
    print("%-42s %8s %16s %8s" % ("trials that the fit has not seen", "RMS", "about offsets", "cubic"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def path_of(arm, file):
            return data / file if arm.startswith(only) and (data / file).exists() else None

        path = path_of("three chambers", "three_chamber_steps.csv")
        if path:
            row("three chambers, even trials from odd [mm]", data / "three_chamber_guess.yaml", rows_of(path), ["2468"],
                folder)
        path = path_of("two sections", "two_section_steps.csv")
        if path:
            row("two sections, each trial left out [mm]", two_section_scene(folder / "two.yaml"), rows_of(path), "12345",
                folder)
        path = path_of("Koopman arm", "koopman_arm.csv")
        if path:
            even = ["2", "4", "6", "8", "10", "12"]
            row("Koopman arm, even trials from odd [units]", koopman_scene(folder / "koopman.yaml"), koopman_rows(path), [even],
                folder, 1 / METRES_PER_UNIT)
        path = path_of("fabric arm", "fabric_two_chambers.csv")
        if path:
            row_of_parts("fabric arm, each tenth left out [mm]", fabric_scene(folder / "fabric.yaml"), fabric_rows(path), folder)


if __name__ == "__main__":
    main(sys.argv[1:])
