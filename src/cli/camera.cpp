#include <iostream>
#include <memory>

#include "arguments.hpp"
#include "camera_actions.hpp"
#include "helix_arm/basics/quote.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

constexpr double kLongest = 3600;  // [s]

void addSource(CLI::App* action, CameraArguments& arguments) {
  action
      ->add_option("--source", arguments.sources,
                   "webcam, or pictures, folders of pictures and videos")
      ->required()
      ->expected(1, -1)
      ->type_name("webcam|FILES");
  action
      ->add_option("--seconds", arguments.seconds,
                   "longest time to look through a webcam [s], default 120")
      ->type_name("S")
      ->check(CLI::Range(0.1, kLongest));
}

}  // namespace

void tellFaults(const PicturesRead& read) {
  for (const PictureFault& fault : read.faults) {
    std::cerr << basics::printable(fault.name + ": " + fault.reason) << "\n";
  }
}

json faultsJson(const PicturesRead& read) {
  json faults = json::array();
  for (const PictureFault& fault : read.faults) {
    faults.push_back({{"file", fault.name}, {"reason", fault.reason}});
  }
  return faults;
}

Subcommand addCamera(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "camera", "calibrate a camera with a printed board, and place it by the arm's tags");
  command->require_subcommand(1);
  const auto arguments = std::make_shared<CameraArguments>();

  CLI::App* calibrate = command->add_subcommand(
      "calibrate",
      "intrinsics of a camera from pictures of the board that tags --board prints, or of "
      "another ChArUco board");
  addSource(calibrate, *arguments);
  addBoardOption(*calibrate, arguments->board,
                 "tags: AprilTags as helix_arm tags --board prints them; charuco: a ChArUco board, "
                 "as helix_arm tags --board charuco prints it or as the options say");
  addScene(*calibrate, "--scene", arguments->scene,
           "scene with a camera: gives its webcam, and with --out gets the intrinsics")
      ->type_name("SCENE");
  calibrate
      ->add_option("--out", arguments->out,
                   "file to write: a camera_info YAML or, with --scene, that scene with the new "
                   "intrinsics")
      ->type_name("FILE.yaml");
  calibrate
      ->add_option("--coefficients", arguments->coefficients,
                   "number of coefficients of distortion: 0, 2, 4, 5 or 8")
      ->check(CLI::IsMember({0, 2, 4, 5, 8}))
      ->capture_default_str();
  calibrate
      ->add_option("--views", arguments->views,
                   "number of views to choose from a webcam or a video")
      ->check(CLI::Range(5, 200))
      ->capture_default_str();
  calibrate
      ->add_option("--device", arguments->device, "webcam, default the scene's, else /dev/video0")
      ->type_name("PATH");
  calibrate
      ->add_option("--size", arguments->size,
                   "its picture size [px], default the scene's, else 1280,720")
      ->type_name("W,H");
  calibrate
      ->add_option("--focus", arguments->focus,
                   "its fixed focus, in the driver's units, default the scene's, else 0")
      ->check(CLI::Range(0, 1'000'000));
  calibrate->footer(
      "Pictures are all used; of a webcam or a video those in which the board rests at a new\n"
      "place. Hold the board close, at the edges and corners, and tilted to each side.\n"
      "json: scene (null without), board (tags or charuco), charuco (null, or dictionary,\n"
      "columns, rows, square_size_m, marker_size_m, legacy_pattern), success, reason, size_px,\n"
      "pictures (number), faults [{file, reason}], parameters {name: {value, standard_error, "
      "unit}}, rms_px, coverage\n"
      "(part of the picture's 8 x 6 cells that hold corners), reach (largest distance of a corner\n"
      "from the principal point, relative to the picture's corner), tilted_views, views [{file,\n"
      "tags (null with charuco), corners, used, reason, rms_px, distance_m, tilt_deg}], warnings, "
      "out.\n"
      "csv: one row per parameter. Exit code 1 if the views do not determine the camera; the\n"
      "reason is in the result, and nothing is written. 130 on Ctrl-C.");

  CLI::App* place = command->add_subcommand(
      "place", "pose of the scene's camera from pictures of the arm at rest");
  addScene(*place, "SCENE", arguments->scene, "scene file with camera and tags")->required();
  addSource(place, *arguments);
  place->add_option("--out", arguments->out, "scene file to write, with the camera at its place")
      ->type_name("SCENE2");
  place->add_option("--pressure-kpa", arguments->pressure_kpa,
                    "gauge pressures at which the arm was seen [kPa], one per actuator: a,b,c; "
                    "default: at rest");
  place->add_option("--input", arguments->input,
                    "the same in SI units: pressures [Pa], spool angles [rad]");
  place->footer(
      "Camera and arm must stand still. The tag nearest to the base counts as exact; the other\n"
      "tags are known as well as tags.placement_prior says, the arm's shape to 2 % of its length\n"
      "and 0.1 rad per section.\n"
      "json: scene, success, reason, pictures (number), faults [{file, reason}], tags [{id, "
      "rms_px}],\n"
      "outlier_tags (left out), position_m, rpy_deg (as in the scene), pose (optical frame in\n"
      "the world),\n"
      "standard_error {position_m [3], rotation_rad [3]} and covariance (6 x 6), along and about\n"
      "the axes of the world, moved_m and turned_rad (from the scene's pose), bleed_m, rms_px,\n"
      "shape_deviations, warnings, out. Values are null without success.\n"
      "csv: one row. Exit code 1 if the pictures do not give the pose; the reason is in the\n"
      "result, and nothing is written. 130 on Ctrl-C.");
  return {command, [arguments, calibrate](const GlobalOptions& global) {
            return calibrate->parsed() ? calibrateCameraOf(*arguments, global)
                                       : placeCameraOf(*arguments, global);
          }};
}

}  // namespace helix_arm::cli
