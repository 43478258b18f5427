#!/usr/bin/env python3
"""A recording of the nodes as arrays: measured pressures and shapes with their times, and the model at the same pressures.

usage: read_bag.py SCENE RECORDING.bag [--out recording.npz]
Needs the Python packages of ROS: source devel/setup.bash. The topics end in pressure_measured and measured.
"""
import argparse

import helix_arm
import numpy as np
import rosbag


def read(path, actuators):
    """Times [s] and values of both topics, in the order of the stamps."""
    pressures, tips = [], []
    with rosbag.Bag(path) as bag:
        for topic, message, _ in bag.read_messages():
            name = topic.rsplit("/", 1)[-1]
            if name == "pressure_measured":
                given = dict(zip(message.name or actuators, message.pressure))
                pressures.append([message.header.stamp.to_sec(), *(given[one] for one in actuators)])
            elif name == "measured":
                position = message.tip.position
                tips.append([message.header.stamp.to_sec(), position.x, position.y, position.z])
    if not pressures or not tips:
        raise SystemExit(f"{path} has {len(pressures)} pressures and {len(tips)} measured shapes; expected some of both")
    return np.array(sorted(pressures)), np.array(sorted(tips))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", help="shipped scene or path")
    parser.add_argument("bag")
    parser.add_argument("--out", default="recording.npz")
    arguments = parser.parse_args()

    scene = helix_arm.Scene.load(arguments.scene)
    pressures, tips = read(arguments.bag, scene.actuators)
    # The pressures at the times of the pictures. Readings have noise, so some lie outside the limits.
    at = np.column_stack([np.interp(tips[:, 0], pressures[:, 0], column) for column in pressures[:, 1:].T])
    at = np.clip(at, *scene.limits_pa.T)
    error = np.linalg.norm(scene.tips(at) - tips[:, 1:], axis=1)
    print(f"{len(pressures)} pressures, {len(tips)} measured shapes; the model's tip is off by "
          f"{1e3 * np.sqrt(np.mean(error**2)):.1f} mm RMS")
    np.savez_compressed(arguments.out, pressure_times_s=pressures[:, 0], pressures_pa=pressures[:, 1:], tip_times_s=tips[:, 0],
                        tips=tips[:, 1:], model_tips=scene.tips(at))


if __name__ == "__main__":
    main()
