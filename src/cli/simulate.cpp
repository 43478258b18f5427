#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <stdexcept>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "io/document/number.hpp"
#include "measurements.hpp"
#include "procedures/commissioning.hpp"
#include "simulation/camera.hpp"
#include "simulation/rig.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMostCaptures = 100000;
constexpr int kFewestDigits = 4;  // of a picture's number

struct SimulateOptions {
  std::string scene, out, inputs;
  int count = 20;
  std::uint32_t seed = 1;
  bool rest = false, walk = false;
  BoardArguments board;
};

// Files that were written.
struct SimulatedSet {
  fs::path directory;
  int captures;
  int tags;  // a capture
  bool pictures;
};

fs::path makeDirectory(const std::string& out) {
  const fs::path directory(out);
  std::error_code error;
  fs::create_directories(directory, error);
  const bool usable = !error && fs::is_empty(directory, error);
  refuseIf(!usable, "--out ", out,
           error ? " cannot be created: " + error.message() : " is not empty",
           "; expected a folder that is empty or absent");
  return directory;
}

void writeFile(const fs::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text << std::flush;
  refuseIf(!file, path.string(), " cannot be written: ", std::strerror(errno),
           "; free disk space, or choose another folder with --out");
}

// The scene with its overrides, and the options that no scene contains.
void writeScene(const fs::path& path, const SimulateOptions& options, const GlobalOptions& global) {
  const std::string captures = options.inputs.empty()
                                   ? basics::format("--count %d", options.count)
                                   : "--inputs " + basics::printable(options.inputs);
  writeFile(path, io::sceneText(options.scene, overridesOf(global)) + "\n# Simulated with " +
                      captures + basics::format(" --seed %u\n", options.seed));
}

// Uniform within the limits of the muscles.
Eigen::VectorXd drawPressure(const model::Arm& arm, std::mt19937_64& generator) {
  Eigen::VectorXd pressure(arm.actuatorCount());
  for (int i = 0; i < pressure.size(); ++i) {
    const model::Range& limits = arm.actuator(i).limits;
    pressure[i] = std::uniform_real_distribution<double>(limits.lower, limits.upper)(generator);
  }
  return pressure;
}

json captureJson(int capture, const Eigen::VectorXd& pressure) {
  return {{"capture", capture}, {"pressure_kpa", pressure / 1e3}};
}

std::string pictureName(int capture) {
  return basics::format("picture_%0*d.jpg", kFewestDigits, capture);
}

// Measured by an instrument that sees all tags, with the noise vision.tag_position_noise_m.
lie::SE3 measured(const lie::SE3& X_BT, const estimation::TwistFitOptions& noise,
                  std::mt19937_64& generator, std::normal_distribution<double>& normal) {
  Eigen::Vector3d shift;
  lie::Vector6 turn = lie::Vector6::Zero();
  for (int i = 0; i < 3; ++i) {
    shift[i] = noise.position_noise * normal(generator);
    turn[3 + i] = noise.rotation_noise * normal(generator);
  }
  lie::SE3 pose = X_BT * lie::SE3::exp(turn);
  pose.translation += shift;
  return pose;
}

// Tags of the scene that the detector finds exactly once in a written picture.
std::vector<io::TagCorners> tagsSeen(const estimation::TagLayout& layout,
                                     const std::vector<std::uint8_t>& jpeg,
                                     vision::TagDetector& detector) {
  cv::Mat picture;
  if (const auto fault = vision::JpegDecoder().decode(jpeg.data(), jpeg.size(), picture)) {
    throw std::logic_error("the simulated picture cannot be read: " + *fault);
  }
  const std::vector<vision::TagDetection> found = detector.detect(picture);
  std::vector<io::TagCorners> tags;
  for (const vision::TagDetection& tag : found) {
    const auto same = std::count_if(found.begin(), found.end(),
                                    [&tag](const auto& other) { return other.id == tag.id; });
    if (same == 1 && layout.find(tag.id) >= 0) tags.push_back({tag.id, tag.corners});
  }
  return tags;
}

std::string truthComment(const io::Scene& scene) {
  return "# Truth of the simulated arm of scene " + scene.name +
         ": twists of its sections (their means where it is loaded) and its tip, seen from its "
         "base. Gauge pressure [kPa].\n";
}

std::string poseComment(const io::Scene& scene) {
  const estimation::TwistFitOptions& noise = scene.vision.fit;
  return "# Simulated tag poses of scene " + scene.name +
         ", seen from its tags.frame (without it from the base). Gauge pressure [kPa], position "
         "[m], unit quaternion.\n"
         "# Standard deviation of the positions " +
         io::formatNumber(noise.position_noise) + " m, of the rotations " +
         io::formatNumber(noise.rotation_noise) + " rad, each axis.\n";
}

std::string cornerComment(const io::Scene& scene) {
  return "Corners of the tags found in the pictures of scene " + scene.name +
         ", in the order bottom left, bottom right, top right, top left as one reads the tag.\n"
         "Gauge pressure [kPa], pixels with (0, 0) the centre of the top-left one.";
}

// Pictures of the calibration board by the camera of the scene.
SimulatedSet simulateBoard(const SimulateOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  refuseIf(!scene.camera, "scene ", scene.name, " has no camera; add the section camera");
  const CalibrationBoard board = boardOf(options.board);
  vision::JpegEncoder encoder(scene.simulation.camera.jpeg_quality);
  simulation::SimulatedCameraConfig config = scene.simulation.camera;
  const fs::path directory = makeDirectory(options.out);
  int number = 0;
  for (const lie::SE3& pose :
       simulation::boardPoses(scene.camera->model, options.count, options.seed)) {
    config.seed = options.seed + static_cast<std::uint32_t>(number);
    simulation::SimulatedCamera camera = std::visit(
        [&](const auto& one) {
          return simulation::boardCamera(scene.camera->model, one, pose, config);
        },
        board);
    const auto jpeg = encoder.encode(camera.render(simulation::kArmOutOfView));
    writeFile(directory / pictureName(++number), {jpeg.begin(), jpeg.end()});
  }
  const int tags = std::visit([](const auto& one) { return one.count(); }, board);
  return {directory, number, tags, true};
}

// (captures x actuators) [Pa]; empty: drawn.
Eigen::MatrixXd givenPressures(const SimulateOptions& options, const io::Scene& scene) {
  if (!options.inputs.empty()) return inputRowsOf(scene, tableOf(options.inputs));
  if (options.walk) return procedures::walkPlan(scene.arm);
  if (!options.rest) return {};
  return scene.arm.inputAt(0).transpose().replicate(options.count, 1);
}

// Rows of captures, and of the tags in each.
void writeTables(const io::Scene& scene, const fs::path& directory, const json& truth,
                 const json& poses) {
  Columns columns{"capture", "pressure_kpa", "twist", "tip"};
  if (truth.front().contains("visible_tags")) columns.push_back("visible_tags");
  writeFile(directory / "truth.csv",
            csvText(truthComment(scene), {{"rows", truth}}, {columns, "rows", {}, &scene.arm}));
  if (poses.empty()) return;
  columns = {"capture", "pressure_kpa", "tag", "position_m", "quaternion_xyzw"};
  writeFile(directory / "tag_poses.csv",
            csvText(poseComment(scene), {{"rows", poses}}, {columns, "rows"}));
}

SimulatedSet simulate(const SimulateOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  requirePressureDriven(scene);
  const Eigen::MatrixXd given = givenPressures(options, scene);
  const int captures = given.size() > 0 ? static_cast<int>(given.rows()) : options.count;
  std::optional<simulation::CameraSetup> camera = scene.cameraSetup();
  if (camera) camera->config.seed = options.seed;
  // Bodies are seen from their frame at its true place.
  const lie::SE3 X_FB = scene.hasBodies() ? camera->view.X_CB : scene.X_BF.inverse();
  simulation::SimulatedRig rig(scene.model, procedures::simulatedRegulatorOf(scene),
                               scene.simulation.arm, camera);
  vision::JpegEncoder encoder(scene.simulation.camera.jpeg_quality);
  std::mt19937_64 generator(options.seed);
  std::normal_distribution<double> normal;
  const fs::path directory = makeDirectory(options.out);

  writeScene(directory / "scene.yaml", options, global);
  json truth = json::array(), poses = json::array();
  std::optional<estimation::TagLayout> layout;
  if (scene.tags) layout = simulation::deviate(*scene.tags, scene.arm, scene.simulation.mounts);
  std::vector<io::TagCornerCapture> corners;
  vision::TagDetector detector(scene.vision.detector);

  for (int capture = 1; capture <= captures; ++capture) {
    rig.command(given.size() > 0 ? Eigen::VectorXd(given.row(capture - 1))
                                 : drawPressure(scene.arm, generator));
    rig.step(std::numeric_limits<double>::infinity());
    const model::Shape shape = rig.shape();
    json row = captureJson(capture, rig.pressure());
    row["twist"] = shape.twists().transpose();
    row["tip"] = model::tipPose(shape);
    if (rig.hasCamera()) {
      row["visible_tags"] = estimation::visibleTags(camera->view, shape).size();
      const auto jpeg = encoder.encode(rig.render());
      writeFile(directory / pictureName(capture), {jpeg.begin(), jpeg.end()});
      corners.push_back({capture, rig.pressure(), tagsSeen(*layout, jpeg, detector)});
    }
    truth.push_back(row);
    if (!layout) continue;
    const auto exact_poses = estimation::tagPoses(*layout, shape);
    for (std::size_t i = 0; i < exact_poses.size(); ++i) {
      poses.push_back(captureJson(capture, rig.pressure()));
      poses.back()["tag"] = layout->tags[i].id;
      poses.back().update(
          json(measured(X_FB * exact_poses[i], scene.vision.fit, generator, normal)));
    }
  }
  writeTables(scene, directory, truth, poses);
  if (rig.hasCamera()) {
    writeFile(directory / "tag_corners.csv",
              io::tagCornerCsv(corners, scene.arm.actuatorCount(), cornerComment(scene)));
  }
  return {directory, captures, scene.tags ? static_cast<int>(scene.tags->tags.size()) : 0,
          rig.hasCamera()};
}

int run(const SimulateOptions& options, const GlobalOptions& global) {
  checkBoard(options.board);
  refuseIf(options.board.given() && (options.rest || options.walk),
           options.walk ? "--walk" : "--rest",
           " is of the arm, and --board shows none; leave out either");
  refuseIf(!options.inputs.empty() && (options.board.given() || options.rest || options.walk),
           "--inputs gives the pressures of the arm; leave out --rest, --walk and --board");
  const SimulatedSet set =
      options.board.given() ? simulateBoard(options, global) : simulate(options, global);
  const auto pathOf = [&set](const char* file, bool written) {
    return valueIf(written, (set.directory / file).string());
  };
  const bool arm = !options.board.given();
  const json report{{"out", set.directory.string()},
                    {"seed", options.seed},
                    {"captures", set.captures},
                    {"pictures", set.pictures ? set.captures : 0},
                    {"tags", set.tags},
                    {"scene", pathOf("scene.yaml", arm)},
                    {"truth", pathOf("truth.csv", arm)},
                    {"tag_poses", pathOf("tag_poses.csv", arm && set.tags > 0)},
                    {"tag_corners", pathOf("tag_corners.csv", arm && set.pictures)}};
  json shown = report;
  shown["pictures"] = json();
  if (set.pictures) {
    shown["pictures"] = pictureName(1) + " to " + pictureName(set.captures);
  } else {
    shown["notes"] = {std::string("no pictures: the scene has no ") +
                      (set.tags > 0 ? "camera" : "tags to see")};
  }
  printResult(global.format, report, shown, Csv{{"out", "seed", "captures", "pictures", "tags"}});
  return kDone;
}

}  // namespace

void addSimulate(Commands& commands) {
  auto [command, options] = commands.add<SimulateOptions>(
      "simulate", "write a simulated data set and pictures with their true shapes", run);
  addScene(command, options.scene);
  addOption(command, "--out", options.out, "folder to write to; must be empty or absent", kRequired,
            TypeName{"DIR"});
  addOption(command, "--count", options.count, "number of captures", CLI::Range(1, kMostCaptures),
            kShowDefault);
  addOption(command, "--seed", options.seed, "seed of the pressures and of all noise",
            kShowDefault);
  addOption(command, "--inputs", options.inputs,
            "table of pressures, one capture per row, or stdin where it is -: columns "
            "pressure_1_kpa .. or pressure_1_pa ..; without it they are random",
            TypeName{"FILE"});
  command.add_flag("--rest", options.rest, "the arm at rest in every capture");
  command
      .add_flag("--walk", options.walk,
                "the steps of the walk of helix_arm commission, in place of --count")
      ->excludes("--rest");
  addBoardFlag(command, options.board,
               "instead, pictures of the calibration board (helix_arm tags --board) in the hands "
               "of a person, by the scene's camera: tags (default) or charuco");
  command.footer(
      R"(The arm deviates from the scene's as its key simulation.arm says, at rest at random
pressures, under its key load as computed by tier exact. Camera and tags are placed by
its key simulation.mounts.
DIR gets scene.yaml (with the changes of --set), truth.csv (twists and tip),
tag_poses.csv (all tags, with the noise of vision.tag_position_noise_m; if the scene has
tags) and, if it also has a camera, picture_0001.jpg .. and tag_corners.csv (what the
detector finds in them).
json: out, seed, captures, pictures, tags, and the paths scene, truth, tag_poses and
tag_corners (null if absent). With --board: pictures alone.)");
}

}  // namespace helix_arm::cli
