#!/usr/bin/env python3
"""Makes each usual mistake in simulated walks, and asserts that `commission` names it and `--out` corrects it.

usage: commission_table.py --command HELIX_ARM [--seeds N] [--sets demo,four,two] [--ctest]
  --ctest   each verdict and cause once, on another set than the last, and exchanged hoses on each; with HELIX_ARM_TEST_SIZE=all, all
Tags are misplaced by 1 mm, muscles have a play of 4 kPa, corners come from rendered pictures. A hose that is elsewhere is made by
the captures of other pressures. Prints each mistake that is not named first. Exits with 1 if fewer than 90 % are, or a sound rig is
not good.
"""
import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from suspect_table import HEIGHT, WIDTH, corners, from_the_tip, is_full_size, pressures, table_of, tags, turned, write_table

NEW = ["--defaults", "--regulator", "festo_vtem", "--length-m", "0.3"]
SETS = {"demo": (None, (3,)), "four": ([*NEW, "--muscles", "4"], (4,)), "two": ([*NEW, "--sections", "2"], (3, 3))}
RIG = ["simulation.mounts.tag_translation_m=0.001", "simulation.arm.response={play_kpa: [4], play_weight: [0.7]}"]


def plan(rings):
    """The walk's pressures, in halves of its largest: as procedures::walkPlan()."""
    count, first = sum(rings), 0
    unit = [[int(i == k) for i in range(count)] for k in range(count)]
    rows = [[0] * count] + [[half * one for one in row] for row in unit for half in (1, 2)]
    for ring in rings:
        pairs = [(first + i, first + (i + 1) % ring) for i in range(ring)]
        rows += [[2 * (a + b) for a, b in zip(unit[i], unit[k])] for i, k in pairs]
        first += ring
    return rows + [[0] * count]


def hoses(true):
    """From the commanded pressures to those in the muscles, both of the plan or near to it."""
    def apply(rows, steps):
        captures = {}
        for row in rows:
            captures.setdefault(int(row["capture"]), []).append(row)
        out = []
        for number, step in enumerate(steps, 1):
            wanted = true(list(step))
            near = min(range(len(steps)), key=lambda k: sum((a - b) ** 2 for a, b in zip(steps[k], wanted)))
            commanded = {key: value for key, value in captures[number][0].items() if key.startswith(("capture", "pressure"))}
            out += [{**row, **commanded} for row in captures[near + 1]]
        return out
    return apply


def each(change):
    def apply(rows, steps):
        for row in rows:
            change(row, DEMO)
        return rows
    return apply


DEMO = [(3, 7, 0)]  # the layout of the demo's tags, as for a mistake of suspect_table
SOUND = each(lambda row, layout: None)
# Mistake, changes of the scene, and what tells it: the cause that comes first, or (list, index, verdict). All sets, then one section.
HOSES = (
    (SOUND, [], "good"),
    (hoses(lambda p: [p[1], p[0], *p[2:]]), [], ("channels", 0, "answers_as")),
    (hoses(lambda p: [p[-1], *p[1:-1], p[0]]), [], ("channels", -1, "answers_as")),
    (hoses(lambda p: [p[2], p[0], p[1], *p[3:]]), [], ("channels", 2, "answers_as")),
    (hoses(lambda p: [0, *p[1:]]), [], ("channels", 0, "dead")), (hoses(lambda p: [p[0], 0, *p[2:]]), [], ("channels", 1, "dead")),
    (hoses(lambda p: [p[0] / 2, *p[1:]]), [], ("channels", 0, "weak")),
    (each(pressures(lambda p: [p[1], p[0], *p[2:]])), [], ("sensors", 0, "reads_as")),
    (each(pressures(lambda p: [one / 6.894757 for one in p])), [], ("sensors", 2, "gain")),
    (each(pressures(lambda p: [0.7 * p[0], *p[1:]])), [], ("sensors", 0, "gain")),
    (each(pressures(lambda p: [p[0], p[1] + 20, *p[2:]])), [], ("sensors", 1, "offset")),
)
VIEWS = (
    (each(tags(lambda muscle, row, *_: (muscle, {2: 4, 4: 2}.get(row, row)))), [], "tag_rows_exchanged"),
    (each(from_the_tip), [], "tag_rows_reversed"),
    (each(turned(2)), [], "tags_turned"), (each(turned(1, 1)), [], "tags_turned"),
    (each(turned(2, muscle=0)), [], "tags_turned"),
    (SOUND, ["tags.size_m=0.0395"], "tag_size"), (SOUND, ["tags.size_m=0.025"], "tag_size"),
    (each(corners(lambda at, *_: [(WIDTH - 1 - x, HEIGHT - 1 - y) for x, y in at])), [], "picture_turned"),
    (SOUND, ["arm.base.position_m=[0.05, 0, 0.6]"], "camera_moved"), (SOUND, ["arm.base.position_m=[0, 0, 0.63]"], "camera_moved"),
    (SOUND, ["arm.sections.0.ring.length_scale=%s"], "muscle_length"),
)
EXCHANGED = ("channels", 0, "answers_as")
CORRECTED = ("tag_rows_exchanged", "tags_turned", "tag_size", "camera_moved")


def mistakes_of(options):
    """Those of each set."""
    out = {scene: HOSES + (VIEWS if len(SETS[scene][1]) == 1 else ()) for scene in options.sets.split(",")}
    if options.ctest and not is_full_size():
        places = {}
        for scene, mistakes in out.items():
            for mistake in mistakes:
                told = mistake[2] if isinstance(mistake[2], str) else (mistake[2][0], mistake[2][2])
                places.setdefault(told, []).append((scene, mistake))
        chosen = [some[n % len(some)] for n, some in enumerate(places.values())]
        out = {scene: [one for one in mistakes if (scene, one) in chosen or one[2] == EXCHANGED] for scene, mistakes in out.items()}
    return out


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--command", required=True)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--sets", default="demo,two")
    parser.add_argument("--ctest", action="store_true")
    options = parser.parse_args()

    def run(*arguments):
        return subprocess.run([options.command, *map(str, arguments)], stdout=subprocess.PIPE, universal_newlines=True, check=False)

    named = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data, out = folder / "wrong.csv", folder / "out.yaml"
        for scene, mistakes in mistakes_of(options).items():
            new, rings = SETS[scene]
            path = folder / (scene + ".yaml") if new else scene
            if new:
                run("new", "--out", path, *new)
            for seed in range(1, options.seeds + 1):
                walk = folder / ("%s_%d" % (scene, seed))
                rig = [word for change in [*RIG, "simulation.mounts.seed=%d" % seed] for word in ("--set", change)]
                run("simulate", path, "--walk", "--seed", seed, "--out", walk, *rig)
                for mistake, changes, told in mistakes:
                    rows = mistake(table_of(walk / "tag_corners.csv"), plan(rings))
                    write_table(data, rows[0].keys(), rows)
                    scales = str([1.05] + [1] * (sum(rings) - 1))
                    words = [word for change in changes for word in ("--set", change.replace("%s", scales))]
                    done = run("commission", path, "--data", data, "--format", "json", "--out", out, *words)
                    found = json.loads(done.stdout)
                    first = found["suspects"][0]["cause"] if found["suspects"] else "good" if found["good"] else ""
                    named.append(first == told if isinstance(told, str) else found[told[0]][told[1]]["verdict"] == told[2])
                    if not named[-1]:
                        print(scene, seed, told, found["reason"], flush=True)
                        if told == "good":
                            sys.exit("a sound rig is not good")
                    elif told in CORRECTED and not json.loads(run("commission", out, "--data", data, "--format", "json").stdout)["good"]:
                        sys.exit("%s is not corrected by --out" % told)
                    elif told == EXCHANGED and ("slots: [1, 0, 2" in out.read_text() if out.exists() else False) != bool(new):
                        sys.exit("exchanged channels: the slots of the regulator are not exchanged in --out, or there are none")
                    if (done.returncode == 0) != (found["good"] or out.exists()):
                        sys.exit("exit code %d does not tell whether --out was written" % done.returncode)
                    out.unlink(missing_ok=True)
    print("named first in %.1f %% of %d" % (100 * sum(named) / len(named), len(named)))
    sys.exit(sum(named) < 0.9 * len(named))


if __name__ == "__main__":
    main()
