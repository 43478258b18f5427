#include <cmath>
#include <iomanip>
#include <iostream>

#include "arguments.hpp"
#include "camera_actions.hpp"
#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/camera_change.hpp"
#include "helix_arm/vision/camera_calibration.hpp"
#include "helix_arm/vision/charuco_reader.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using vision::CalibratedView;
using vision::CameraCalibration;
using vision::CameraParameter;

constexpr double kPerDegree = 180 / basics::kPi;

CameraSource sourceOf(const CameraArguments& arguments, const std::optional<io::Scene>& scene) {
  CameraSource source;
  source.sources = arguments.sources;
  if (arguments.seconds) source.seconds = *arguments.seconds;
  const bool given = !arguments.device.empty() || !arguments.size.empty() || arguments.focus;
  if (given && !source.isWebcam()) {
    throw CallerError("--device, --size and --focus go with --source webcam");
  }
  if (scene) {
    source.webcam.width = scene->camera->model.width;
    source.webcam.height = scene->camera->model.height;
    if (scene->camera->webcam) source.webcam = *scene->camera->webcam;
  }
  if (!arguments.device.empty()) source.webcam.device = arguments.device;
  if (arguments.focus) source.webcam.focus = *arguments.focus;
  if (!arguments.size.empty()) {
    const std::vector<double> size = numberList("--size", arguments.size, 2);
    const auto fits = [](double side) {
      return side >= 1 && side <= estimation::Camera::kMaxSide && side == std::floor(side);
    };
    if (!fits(size[0]) || !fits(size[1])) {
      throw CallerError("--size is " + arguments.size + "; expected whole numbers from 1 to " +
                        std::to_string(estimation::Camera::kMaxSide));
    }
    source.webcam.width = static_cast<int>(size[0]);
    source.webcam.height = static_cast<int>(size[1]);
  }
  return source;
}

// Finds a board of either kind in a picture.
class BoardFinder {
 public:
  explicit BoardFinder(const CalibrationBoard& board) : board_(board) {
    const auto* tags = std::get_if<vision::TagBoard>(&board);
    if (tags == nullptr) return;
    vision::DetectorConfig config;
    config.family = tags->family;
    config.quad_decimate = 1;  // time does not matter here, corners do
    detector_.emplace(config);
  }

  vision::BoardObservation find(const vision::Frame& frame) {
    if (const auto* tags = std::get_if<vision::TagBoard>(&board_)) {
      return vision::boardObservation(*tags, frame.name, frame.gray.size(),
                                      detector_->detect(frame.gray));
    }
    return vision::charucoObservation(std::get<vision::CharucoBoard>(board_), frame.name,
                                      frame.gray);
  }

 private:
  const CalibrationBoard& board_;
  std::optional<vision::TagDetector> detector_;  // of a board of tags
};

// Collects the boards of all pictures.
class Views {
 public:
  Views(const CalibrationBoard& board, int wanted)
      : board_(board), finder_(board), parts_(partsOf(board)), wanted_(wanted) {}

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
    const vision::BoardObservation observation = finder_.find(frame);
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

  // With the likely cause as remedy, if no picture shows the board.
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

  static vision::BoardParts partsOf(const CalibrationBoard& board) {
    return std::visit([](const auto& one) { return one.parts(); }, board);
  }

  const CalibrationBoard& board_;
  BoardFinder finder_;
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

json reportOf(const Calibrated& result) {
  const CameraCalibration& calibration = result.calibration;
  const bool charuco = std::holds_alternative<vision::CharucoBoard>(result.board);
  json parameters = json::object(), views = json::array();
  for (const CameraParameter& one : calibration.parameters) {
    parameters[one.name] = {
        {"value", one.value}, {"standard_error", one.standard_error}, {"unit", one.unit}};
  }
  for (const CalibratedView& view : calibration.views) {
    const bool fitted = view.distance > 0;
    views.push_back({{"file", view.name},
                     {"tags", charuco ? json() : json(view.parts)},
                     {"corners", view.corners},
                     {"used", view.used},
                     {"reason", view.reason.empty() ? json() : json(view.reason)},
                     {"rms_px", fitted ? json(view.rms) : json()},
                     {"distance_m", fitted ? json(view.distance) : json()},
                     {"tilt_deg", fitted ? json(kPerDegree * view.tilt) : json()}});
  }
  return {{"scene", result.scene ? json(result.scene->name) : json()},
          {"board", charuco ? "charuco" : "tags"},
          {"charuco", charuco ? boardJson(result.board) : json()},
          {"success", calibration.success},
          {"reason", calibration.reason.empty() ? json() : json(calibration.reason)},
          {"size_px", {result.size.width, result.size.height}},
          {"pictures", result.read.pictures},
          {"faults", faultsJson(result.read)},
          {"parameters", parameters},
          {"rms_px", calibration.rms},
          {"coverage", calibration.coverage},
          {"reach", calibration.reach},
          {"tilted_views", calibration.tilted_views},
          {"views", views},
          {"warnings", calibration.warnings},
          {"out", result.out.empty() ? json() : json(result.out)}};
}

void printText(const Calibrated& result) {
  const CameraCalibration& calibration = result.calibration;
  if (!calibration.success) std::cout << "not calibrated: " << calibration.reason << "\n";
  int used = 0;
  for (const CalibratedView& view : calibration.views) {
    used += view.used ? 1 : 0;
    if (!view.used) std::cout << view.name << " is left out: " << view.reason << "\n";
  }
  if (calibration.parameters.empty()) return;
  std::cout << used << " of " << calibration.views.size() << " views, RMS " << std::setprecision(3)
            << calibration.rms << " px, " << std::lround(100 * calibration.coverage)
            << " % of the picture covered, " << calibration.tilted_views << " views tilted\n";
  for (const CameraParameter& one : calibration.parameters) {
    std::cout << one.name << " = " << std::setprecision(7) << one.value << " +- "
              << std::setprecision(2) << one.standard_error << " " << one.unit << "\n";
  }
  for (const std::string& warning : calibration.warnings)
    std::cout << "warning: " << warning << "\n";
  if (!result.out.empty()) std::cout << "written: " << result.out << "\n";
}

void printCsv(const CameraCalibration& calibration) {
  CsvTable table;
  for (const CameraParameter& one : calibration.parameters) {
    table.add({{"parameter", one.name},
               {"value", exact(one.value)},
               {"standard_error", exact(one.standard_error)},
               {"unit", one.unit}});
  }
  table.print(std::cout);
}

void write(const CameraArguments& arguments, const GlobalOptions& global,
           const estimation::Camera& camera) {
  const std::string text =
      arguments.scene.empty()
          ? io::cameraInfoText(camera, "camera")
          : io::sceneTextWithCamera(arguments.scene, overridesOf(global), {camera, std::nullopt});
  io::writeFileAtomically(arguments.out, text);
}

}  // namespace

int calibrateCameraOf(const CameraArguments& arguments, const GlobalOptions& global) {
  Calibrated result;
  if (arguments.scene.empty() && !global.overrides.empty()) {
    throw CallerError("--set changes a key of a scene, and none is given; leave out --set");
  }
  if (!arguments.scene.empty()) {
    result.scene = loadScene(arguments.scene, global);
    if (!result.scene->camera) {
      throw CallerError("scene " + result.scene->name +
                        " has no camera; add the section camera, with its approximate pose and "
                        "focal length");
    }
  }
  if (!arguments.out.empty()) requireYaml(arguments.out);
  result.board = boardOf(arguments.board);
  Views views(result.board, arguments.views);
  result.read = readPictures(
      sourceOf(arguments, result.scene),
      [&views](const vision::Frame& frame, bool next) { return views.take(frame, next); });
  tellFaults(result.read);
  if (result.read.interrupted) return kInterrupted;
  result.size = views.size();
  if (!views.otherSize().empty()) {
    throw CallerError(views.otherSize() + " is not of the first picture's size, " +
                      std::to_string(result.size.width) + " x " +
                      std::to_string(result.size.height) +
                      " px; a camera is calibrated at one size");
  }
  vision::CameraCalibrationOptions options;
  options.coefficients = arguments.coefficients;
  if (const auto reason = whyNoPicture(result.read)) {
    result.calibration.reason = *reason;
  } else {
    result.calibration = vision::calibrateCamera(views.parts(), result.size, views.all(), options);
  }
  if (result.calibration.success && !arguments.out.empty()) {
    write(arguments, global, result.calibration.camera);
    result.out = arguments.out;
  }
  if (global.format == Format::kJson) printJson(reportOf(result));
  if (global.format == Format::kCsv) printCsv(result.calibration);
  if (global.format == Format::kText) printText(result);
  if (!result.calibration.success && global.format == Format::kCsv) {
    std::cerr << result.calibration.reason << "\n";
  }
  return result.calibration.success ? kDone : kNotPossible;
}

}  // namespace helix_arm::cli
