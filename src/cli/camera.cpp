#include <algorithm>
#include <chrono>
#include <iostream>
#include <thread>

#include "basics/pi.hpp"
#include "basics/quote.hpp"
#include "command.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "io/document/atomic_file.hpp"
#include "procedures/camera_placing.hpp"
#include "regulator/regulator_io.hpp"
#include "vision/camera_calibration.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::cli {

namespace {

using procedures::CameraPlacing;
using regulator::steadyNow;
using vision::CalibratedView;
using vision::CameraCalibration;
using vision::CameraParameter;

constexpr double kDegrees = 180 / basics::kPi;
constexpr double kLongest = 3600;  // [s]
constexpr int kWebcamPictures = 20;
constexpr double kPatience = 5;  // for the first or next picture of a webcam [s]
constexpr std::chrono::milliseconds kBetweenTries(20);

// The word in place of files that means a camera at this machine.
constexpr char kWebcam[] = "webcam";

// Source of the pictures of `helix_arm camera`.
struct CameraSource {
  std::vector<std::string> sources;  // files and folders, or kWebcam alone
  vision::WebcamConfig webcam;
  std::optional<cv::Size> expected;  // size of pictures in files; absent: any
  double seconds = 120;              // longest time for a webcam [s]

  bool isWebcam() const { return sources.size() == 1 && sources[0] == kWebcam; }
};

// Why a picture could not be used: {file, reason}, the reason without its name.
json faultOf(const vision::Frame& frame) {
  std::string reason = frame.fault;
  // For a video, the name has the number of the frame behind #, which the fault may lack.
  for (const std::string& name : {frame.name, frame.name.substr(0, frame.name.rfind('#'))}) {
    if (reason.compare(0, name.size() + 2, name + ": ") != 0) continue;
    reason.erase(0, name.size() + 2);
    break;
  }
  return {{"file", frame.name}, {"reason", reason}};
}

std::string faultLine(const json& fault) {
  return fault["file"].get<std::string>() + ": " + fault["reason"].get<std::string>();
}

// How reading ended.
struct PicturesRead {
  int pictures = 0;
  json faults = json::array();
  bool interrupted = false;  // by Ctrl-C
};

struct CameraArguments {
  std::string scene;  // calibrate: empty for none
  CameraSource source;
  std::string out;           // empty: nothing is written
  BoardArguments board;      // calibrate
  std::string device, size;  // calibrate: of a webcam without scene
  std::optional<int> focus;  // calibrate: likewise
  int coefficients = 5;      // calibrate
  int views = 25;            // calibrate: of a webcam or a video
  InputArguments input;      // place
};

// Gets each picture and whether it follows the last one in time; returns false if it wants no more.
using TakePicture = std::function<bool(const vision::Frame&, bool)>;

void readWebcam(const CameraSource& source, const TakePicture& take, PicturesRead& read) {
  const auto camera = vision::FrameSource::webcam(source.webcam);
  const double begin = steadyNow();
  double last = begin, retry = begin;
  vision::Frame frame;
  while (!interrupted() && steadyNow() - begin < source.seconds) {
    if (steadyNow() < retry) {
      std::this_thread::sleep_for(kBetweenTries);
      continue;
    }
    if (camera->next(frame) == vision::FrameStatus::kFrame) {
      last = steadyNow();
      ++read.pictures;
      if (!take(frame, true)) return;
      continue;
    }
    retry = steadyNow() + frame.retry_after;
    if (steadyNow() - last < kPatience) continue;
    read.faults.push_back(faultOf(frame));
    return;
  }
  // The time was shorter than the patience.
  if (read.pictures == 0 && !frame.fault.empty()) read.faults.push_back(faultOf(frame));
}

// Why there is not a single picture, naming the first file or device; nothing if there is one.
std::optional<std::string> whyNoPicture(const PicturesRead& read) {
  if (read.pictures > 0 || read.faults.empty()) return std::nullopt;
  const std::size_t others = read.faults.size() - 1;
  return "no picture could be read: " + faultLine(read.faults.front()) +
         (others > 0 ? ", and " + std::to_string(others) + " others" : "");
}

// Reads pictures until they end, until `take` wants no more, until the time is over or until
// Ctrl-C. A webcam that gives no picture for 5 s ends it too.
// @throws CallerError on kWebcam beside files, std::invalid_argument on a missing file.
PicturesRead readPictures(const CameraSource& source, const TakePicture& take) {
  PicturesRead read;
  const InterruptWatch watch;
  if (source.isWebcam()) {
    readWebcam(source, take, read);
    read.interrupted = interrupted();
    return read;
  }
  refuseIf(std::find(source.sources.begin(), source.sources.end(), kWebcam) != source.sources.end(),
           "--source has webcam beside files; give either");
  std::vector<std::unique_ptr<vision::FrameSource>> files;
  for (const std::string& path : source.sources) {
    files.push_back(vision::FrameSource::files(path, source.expected));
  }
  vision::Frame frame;
  for (const auto& file : files) {
    for (vision::FrameStatus status; (status = file->next(frame)) != vision::FrameStatus::kEnd;) {
      read.interrupted = interrupted();
      if (read.interrupted) return read;
      if (status == vision::FrameStatus::kFault) {
        read.faults.push_back(faultOf(frame));
        continue;
      }
      ++read.pictures;
      if (!take(frame, file->continuous())) return read;
    }
  }
  return read;
}

// On stderr.
void tellFaults(const PicturesRead& read) {
  for (const json& fault : read.faults) std::cerr << basics::printable(faultLine(fault)) << "\n";
}

CameraSource sourceOf(const CameraArguments& arguments, const std::optional<io::Scene>& scene) {
  CameraSource source = arguments.source;
  const bool given = !arguments.device.empty() || !arguments.size.empty() || arguments.focus;
  refuseIf(given && !source.isWebcam(), "--device, --size and --focus go with --source webcam");
  if (scene) {
    source.webcam.width = scene->camera->model.width;
    source.webcam.height = scene->camera->model.height;
    if (scene->camera->webcam) source.webcam = *scene->camera->webcam;
  }
  if (!arguments.device.empty()) source.webcam.device = arguments.device;
  if (arguments.focus) source.webcam.focus = *arguments.focus;
  if (!arguments.size.empty()) {
    const Eigen::Vector2d size = numberList("--size", arguments.size, 2);
    constexpr int kMost = estimation::Camera::kMaxSide;
    refuseIf(
        size.minCoeff() < 1 || size.maxCoeff() > kMost || size != size.array().floor().matrix(),
        "--size is ", arguments.size, "; expected whole numbers from 1 to ", kMost);
    source.webcam.width = static_cast<int>(size[0]);
    source.webcam.height = static_cast<int>(size[1]);
  }
  return source;
}

// Collects the boards of all pictures.
class Views {
 public:
  Views(const CalibrationBoard& board, int wanted)
      : board_(board),
        parts_(std::visit([](const auto& one) { return one.parts(); }, board)),
        wanted_(wanted) {
    const auto* tags = std::get_if<vision::TagBoard>(&board);
    if (tags == nullptr) return;
    vision::DetectorConfig config;
    config.family = tags->family;
    config.quad_decimate = 1;  // time does not matter here, corners do
    detector_.emplace(config);
  }

  // False once there are enough.
  bool take(const vision::Frame& frame, bool continuous) {
    if (!size_) {
      size_ = frame.gray.size();
      picker_.emplace(*size_, parts_);
    }
    if (*size_ != frame.gray.size()) {
      other_size_ = frame.name;
      return false;
    }
    const vision::BoardObservation observation = find(frame);
    if (static_cast<int>(observation.corners.size()) >= parts_.leastCorners()) {
      seen_ = true;
      without_.clear();
    } else if (!seen_) {
      without_.push_back(frame.gray.clone());
      if (without_.size() > kMostWithout) without_.erase(without_.begin());
    }
    if (!continuous) {
      single_.push_back(observation);
      return true;
    }
    if (picker_->offer(observation)) {
      std::cerr << "view " << picker_->chosen().size() << " of " << wanted_ << ": "
                << std::lround(100 * picker_->coverage().fraction())
                << " % covered, missing most: " << picker_->coverage().emptiest() << "\n";
    }
    return static_cast<int>(picker_->chosen().size()) < wanted_;
  }

  // If no picture shows the board, the remedy says what they show of it.
  vision::BoardParts parts() const {
    vision::BoardParts parts = parts_;
    if (seen_ || without_.empty()) return parts;
    if (const auto* charuco = std::get_if<vision::CharucoBoard>(&board_)) {
      parts.remedy = vision::whyNoCharuco(*charuco, without_);
    } else {
      parts.remedy += "; a ChArUco board is read with --board charuco";
    }
    return parts;
  }
  std::vector<vision::BoardObservation> all() const {
    std::vector<vision::BoardObservation> observations = single_;
    if (picker_)
      observations.insert(observations.end(), picker_->chosen().begin(), picker_->chosen().end());
    return observations;
  }
  cv::Size size() const { return size_.value_or(cv::Size()); }
  // A picture whose size is not that of the first; empty if there is none.
  const std::string& otherSize() const { return other_size_; }

 private:
  static constexpr std::size_t kMostWithout = 3;

  vision::BoardObservation find(const vision::Frame& frame) {
    if (const auto* charuco = std::get_if<vision::CharucoBoard>(&board_)) {
      return vision::charucoObservation(*charuco, frame.name, frame.gray);
    }
    return vision::boardObservation(std::get<vision::TagBoard>(board_), frame.name,
                                    frame.gray.size(), detector_->detect(frame.gray));
  }

  const CalibrationBoard& board_;
  std::optional<vision::TagDetector> detector_;  // of a board of tags
  const vision::BoardParts parts_;
  const int wanted_;
  std::optional<cv::Size> size_;
  std::optional<vision::BoardViews> picker_;
  std::vector<vision::BoardObservation> single_;
  std::string other_size_;
  bool seen_ = false;             // a board, in any picture
  std::vector<cv::Mat> without_;  // the last pictures, until one is seen
};

struct Calibrated {
  CalibrationBoard board;
  std::optional<io::Scene> scene;
  PicturesRead read;
  cv::Size size;
  CameraCalibration calibration;
  std::string out;
};

json parameterJson(const CameraParameter& one) {
  return {{"name", one.name},
          {"value", one.value},
          {"standard_error", one.standard_error},
          {"unit", one.unit}};
}

json reportOf(const Calibrated& result) {
  const CameraCalibration& calibration = result.calibration;
  const bool charuco = std::holds_alternative<vision::CharucoBoard>(result.board);
  json parameters = json::object();
  for (const CameraParameter& one : calibration.parameters) {
    parameters[one.name] = without(parameterJson(one), {"name"});
  }
  const json views = listJson(calibration.views, [charuco](const CalibratedView& view) -> json {
    const bool fitted = view.distance > 0;
    return {{"file", view.name},
            {"tags", valueIf(!charuco, view.parts)},
            {"corners", view.corners},
            {"used", view.used},
            {"reason", textOrNull(view.reason)},
            {"rms_px", valueIf(fitted, view.rms)},
            {"distance_m", valueIf(fitted, view.distance)},
            {"tilt_deg", valueIf(fitted, kDegrees * view.tilt)}};
  });
  return {{"scene", result.scene ? json(result.scene->name) : json()},
          {"board", charuco ? "charuco" : "tags"},
          {"charuco", valueIf(charuco, boardJson(result.board))},
          {"success", calibration.success},
          {"reason", textOrNull(calibration.reason)},
          {"size_px", {result.size.width, result.size.height}},
          {"pictures", result.read.pictures},
          {"faults", result.read.faults},
          {"parameters", parameters},
          {"rms_px", calibration.rms},
          {"coverage", calibration.coverage},
          {"reach", calibration.reach},
          {"tilted_views", calibration.tilted_views},
          {"views", views},
          {"warnings", calibration.warnings},
          {"out", textOrNull(result.out)}};
}

int calibrateCameraOf(const CameraArguments& arguments, const GlobalOptions& global) {
  Calibrated result;
  refuseIf(arguments.scene.empty() && !global.overrides.empty(),
           "--set changes a key of a scene, and none is given; leave out --set");
  if (!arguments.scene.empty()) {
    result.scene = loadScene(arguments.scene, global);
    refuseIf(!result.scene->camera, "scene ", result.scene->name,
             " has no camera; add the section camera, with its approximate pose and focal length");
  }
  requireYaml(arguments.out);
  result.board = boardOf(arguments.board);
  Views views(result.board, arguments.views);
  result.read = readPictures(
      sourceOf(arguments, result.scene),
      [&views](const vision::Frame& frame, bool next) { return views.take(frame, next); });
  tellFaults(result.read);
  if (result.read.interrupted) return kInterrupted;
  result.size = views.size();
  refuseIf(!views.otherSize().empty(), views.otherSize(), " is not of the first picture's size, ",
           result.size.width, " x ", result.size.height, " px; a camera is calibrated at one size");
  vision::CameraCalibrationOptions options;
  options.coefficients = arguments.coefficients;
  if (const auto reason = whyNoPicture(result.read)) {
    result.calibration.reason = *reason;
  } else {
    result.calibration = vision::calibrateCamera(views.parts(), result.size, views.all(), options);
  }
  if (result.calibration.success && !arguments.out.empty()) {
    const estimation::Camera& camera = result.calibration.camera;
    result.out = arguments.out;
    io::writeFileAtomically(
        result.out, result.scene ? io::sceneTextWithCamera(arguments.scene, overridesOf(global),
                                                           {camera, std::nullopt})
                                 : io::cameraInfoText(camera, "camera"));
  }
  const json report = reportOf(result);
  printResult(global.format, report, report, [&result](std::ostream& out) {
    CsvTable table(out, {{"name", "parameter"}, "value", "standard_error", "unit"});
    for (const CameraParameter& one : result.calibration.parameters) table.add(parameterJson(one));
  });
  if (!result.calibration.success && global.format == Format::kCsv) {
    std::cerr << result.calibration.reason << "\n";
  }
  return result.calibration.success ? kDone : kNotPossible;
}

struct Placed {
  const io::Scene& scene;
  PicturesRead read;
  CameraPlacing placing;
  std::string out;
};

json reportOf(const Placed& result) {
  const CameraPlacing& placing = result.placing;
  json tags = json::array();
  for (std::size_t i = 0; i < placing.fit.tags.size(); ++i) {
    tags.push_back({{"id", placing.tags[i]}, {"rms_px", placing.fit.tags[i].rms}});
  }
  json out{{"scene", result.scene.name},           {"success", placing.success},
           {"reason", textOrNull(placing.reason)}, {"pictures", result.read.pictures},
           {"faults", result.read.faults},         {"tags", tags},
           {"outlier_tags", placing.outliers},     {"suspects", placing.suspects},
           {"warnings", placing.warnings},         {"out", textOrNull(result.out)}};
  for (const char* key : {"position_m", "rpy_deg", "pose", "standard_error", "covariance",
                          "moved_m", "turned_rad", "bleed_m", "rms_px", "shape_deviations"}) {
    out[key] = nullptr;
  }
  if (!placing.success) return out;
  const io::CameraPlace place = io::cameraPlaceOf(placing.X_WC);
  const Eigen::VectorXd errors = placing.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  out["position_m"] = place.position;
  out["rpy_deg"] = place.rpy_deg;
  out["pose"] = placing.X_WC;
  out["standard_error"] = {{"position_m", errors.head(3)}, {"rotation_rad", errors.tail(3)}};
  out["covariance"] = placing.covariance;
  out["moved_m"] = placing.moved;
  out["turned_rad"] = placing.turned;
  out["bleed_m"] = placing.fit.border_shift;
  out["rms_px"] = placing.fit.rms;
  out["shape_deviations"] = placing.fit.shape_deviations;
  return out;
}

void printPlace(json report, std::ostream& out) {
  if (report["position_m"].is_null()) return;
  const char* const angles[] = {"roll_deg", "pitch_deg", "yaw_deg"};
  Columns columns{"scene", {"position_m", "position_@_m"}};
  for (std::size_t i = 0; i < 3; ++i) {
    report[angles[i]] = report["rpy_deg"][i];
    columns.push_back(angles[i]);
  }
  columns.emplace_back("standard_error/position_m", "error_@_m");
  columns.emplace_back("standard_error/rotation_rad", "error_about_@_rad");
  columns.push_back("rms_px");
  printCsv(report, {columns}, out);
}

CameraSource sourceOf(const CameraArguments& arguments, const io::Scene& scene) {
  CameraSource source = arguments.source;
  source.expected = cv::Size(scene.camera->model.width, scene.camera->model.height);
  if (source.isWebcam()) {
    refuseIf(!scene.camera->webcam, "scene ", scene.name,
             " has no camera.webcam; add it, or give pictures as --source");
    source.webcam = *scene.camera->webcam;
  }
  return source;
}

int placeCameraOf(const CameraArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  refuseIf(!scene.camera || !scene.tags, "scene ", scene.name, " has no ",
           scene.camera ? "tags" : "camera",
           "; expected a scene with the sections camera and tags");
  requireYaml(arguments.out);
  const statics::Solution model = scene.model.solve(inputsOrRest(scene, arguments.input));
  refuseIf(!model.converged(), "no shape of scene ", scene.name,
           " balances its load at these pressures; take the pictures at others, and "
           "give them with --pressure-kpa");
  const CameraSource source = sourceOf(arguments, scene);
  vision::TagDetector detector(scene.vision.detector);
  std::vector<std::vector<vision::TagDetection>> pictures;
  Placed result{scene, {}, {}, {}};
  result.read = readPictures(source, [&](const vision::Frame& frame, bool) {
    pictures.push_back(detector.detect(frame.gray));
    return !source.isWebcam() || pictures.size() < kWebcamPictures;
  });
  tellFaults(result.read);
  if (result.read.interrupted) return kInterrupted;
  if (const auto reason = whyNoPicture(result.read)) {
    result.placing.reason = *reason;
  } else {
    result.placing = procedures::placeCamera(scene, model.shape, pictures);
  }
  if (result.placing.success && !arguments.out.empty()) {
    io::writeFileAtomically(arguments.out,
                            io::sceneTextWithCamera(arguments.scene, overridesOf(global),
                                                    {std::nullopt, result.placing.X_WC}));
    result.out = arguments.out;
  }
  const json report = reportOf(result);
  printResult(global.format, report, without(report, {"pose", "suspects"}),
              [&report](std::ostream& out) { printPlace(report, out); });
  if (!result.placing.success && global.format == Format::kCsv) {
    std::cerr << result.placing.reason << "\n";
  }
  return result.placing.success ? kDone : kNotPossible;
}

void addSource(CLI::App& command, CameraArguments& arguments) {
  addOption(command, "--source", arguments.source.sources,
            "webcam, or pictures, folders of pictures and videos", kRequired)
      ->expected(1, -1)
      ->type_name("webcam|FILES");
  addOption(command, "--seconds", arguments.source.seconds,
            "longest time to look through a webcam [s], default 120", TypeName{"S"},
            CLI::Range(0.1, kLongest));
}

void addCalibrateCamera(Commands& commands) {
  auto [command, arguments] =
      commands.add("calibrate",
                   "intrinsics of a camera from pictures of the board that tags --board "
                   "prints, or of another ChArUco board",
                   calibrateCameraOf);
  addSource(command, arguments);
  addBoardOption(command, arguments.board,
                 "tags: AprilTags as helix_arm tags --board prints them; charuco: a ChArUco board, "
                 "as helix_arm tags --board charuco prints it or as the options say");
  addSceneOption(command, "--scene", arguments.scene,
                 "scene with a camera: gives its webcam, and with --out gets the intrinsics")
      ->type_name("SCENE");
  addOption(
      command, "--out", arguments.out,
      "file to write: a camera_info YAML or, with --scene, that scene with the new intrinsics",
      TypeName{"FILE.yaml"});
  addOption(command, "--coefficients", arguments.coefficients,
            "number of coefficients of distortion: 0, 2, 4, 5 or 8", CLI::IsMember({0, 2, 4, 5, 8}),
            kShowDefault);
  addOption(command, "--views", arguments.views,
            "number of views to choose from a webcam or a video", CLI::Range(5, 200), kShowDefault);
  addOption(command, "--device", arguments.device, "webcam, default the scene's, else /dev/video0",
            TypeName{"PATH"});
  addOption(command, "--size", arguments.size,
            "its picture size [px], default the scene's, else 1280,720", TypeName{"W,H"});
  addOption(command, "--focus", arguments.focus,
            "its fixed focus, in the driver's units, default the scene's, else 0",
            CLI::Range(0, 1'000'000));
  command.footer(
      R"(Pictures are all used; of a webcam or a video those in which the board rests at a new
place. Hold the board close, at the edges and corners, and tilted to each side.
json: scene (null without), board (tags or charuco), charuco (null, or dictionary,
columns, rows, square_size_m, marker_size_m, legacy_pattern), success, reason, size_px,
pictures (number), faults [{file, reason}], parameters {name: {value, standard_error, unit}}, rms_px, coverage
(part of the picture's 8 x 6 cells that hold corners), reach (largest distance of a corner
from the principal point, relative to the picture's corner), tilted_views, views [{file,
tags (null with charuco), corners, used, reason, rms_px, distance_m, tilt_deg}], warnings, out.
csv: one row per parameter. Exit code 1 if the views do not determine the camera; the
reason is in the result, and nothing is written. 130 on Ctrl-C.)");
}

void addPlaceCamera(Commands& commands) {
  auto [command, arguments] = commands.add(
      "place", "pose of the scene's camera from pictures of the arm at rest", placeCameraOf);
  addScene(command, arguments.scene, "scene file with camera and tags");
  addSource(command, arguments);
  addOption(command, "--out", arguments.out, "scene file to write, with the camera at its place",
            TypeName{"SCENE2"});
  addInputOptions(
      command, arguments.input,
      "gauge pressures at which the arm was seen [kPa], one per actuator: a,b,c; default: at rest",
      "the same in SI units: pressures [Pa], spool angles [rad]");
  command.footer(
      R"(Camera and arm must stand still. The tag nearest to the base counts as exact; the other
tags are known as well as tags.placement_prior says, the arm's shape to 2 % of its length
and 0.1 rad per section.
json: scene, success, reason, pictures (number), faults [{file, reason}], tags [{id, rms_px}],
outlier_tags (left out), position_m, rpy_deg (as in the scene), pose (optical frame in
the world),
standard_error {position_m [3], rotation_rad [3]} and covariance (6 x 6), along and about
the axes of the world, moved_m and turned_rad (from the scene's pose), bleed_m, rms_px,
shape_deviations, suspects [{cause, where, explains, remedy}] (usual mistakes of tags and
pictures that explain why tags do not fit, best first; one that explains 90 % refuses the
place), warnings, out. Values are null without success.
csv: one row. Exit code 1 if the pictures do not give the pose; the reason is in the
result, and nothing is written. 130 on Ctrl-C.)");
}

}  // namespace

void addCamera(Commands& commands) {
  Commands camera = commands.group(
      "camera", "calibrate a camera with a printed board, and place it by the arm's tags");
  addCalibrateCamera(camera);
  addPlaceCamera(camera);
}

}  // namespace helix_arm::cli
