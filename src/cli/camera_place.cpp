#include <cmath>
#include <iomanip>
#include <iostream>

#include "arguments.hpp"
#include "camera_actions.hpp"
#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/camera_change.hpp"
#include "helix_arm/procedures/camera_placing.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using procedures::CameraPlacing;

constexpr int kWebcamPictures = 20;
constexpr double kDegrees = 180 / basics::kPi;

struct Placed {
  const io::Scene& scene;
  PicturesRead read;
  CameraPlacing placing;
  std::string out;

  Eigen::VectorXd errors() const { return placing.covariance.diagonal().cwiseMax(0).cwiseSqrt(); }
};

// Any shape balances an arm at rest, or the caller must say another pressure.
model::Shape shapeOf(const io::Scene& scene, const Eigen::VectorXd& inputs) {
  const statics::Solution solution = scene.model.solve(inputs);
  if (solution.converged()) return solution.shape;
  throw CallerError("no shape of scene " + scene.name +
                    " balances its load at these pressures; take the pictures at others, and give "
                    "them with --pressure-kpa");
}

json reportOf(const Placed& result) {
  const CameraPlacing& placing = result.placing;
  json tags = json::array();
  for (std::size_t i = 0; i < placing.fit.tags.size(); ++i) {
    tags.push_back({{"id", placing.tags[i]}, {"rms_px", placing.fit.tags[i].rms}});
  }
  json out{{"scene", result.scene.name},
           {"success", placing.success},
           {"reason", placing.reason.empty() ? json() : json(placing.reason)},
           {"pictures", result.read.pictures},
           {"faults", faultsJson(result.read)},
           {"tags", tags},
           {"outlier_tags", placing.outliers},
           {"warnings", placing.warnings},
           {"out", result.out.empty() ? json() : json(result.out)}};
  for (const char* key : {"position_m", "rpy_deg", "pose", "standard_error", "covariance",
                          "moved_m", "turned_rad", "bleed_m", "rms_px", "shape_deviations"}) {
    out[key] = nullptr;
  }
  if (!placing.success) return out;
  const io::CameraPlace place = io::cameraPlaceOf(placing.X_WC);
  const Eigen::VectorXd errors = result.errors();
  out["position_m"] = toJson(Eigen::VectorXd(place.position));
  out["rpy_deg"] = toJson(Eigen::VectorXd(place.rpy_deg));
  out["pose"] = toJson(placing.X_WC);
  out["standard_error"] = {{"position_m", toJson(Eigen::VectorXd(errors.head(3)))},
                           {"rotation_rad", toJson(Eigen::VectorXd(errors.tail(3)))}};
  out["covariance"] = rowsJson(placing.covariance);
  out["moved_m"] = placing.moved;
  out["turned_rad"] = placing.turned;
  out["bleed_m"] = placing.fit.bleed;
  out["rms_px"] = placing.fit.rms;
  out["shape_deviations"] = placing.fit.shape_deviations;
  return out;
}

void printText(const Placed& result) {
  const CameraPlacing& placing = result.placing;
  if (!placing.success) {
    std::cout << "not placed: " << placing.reason << "\n";
    return;
  }
  const io::CameraPlace place = io::cameraPlaceOf(placing.X_WC);
  const Eigen::VectorXd errors = result.errors();
  std::cout << result.scene.name << ": camera placed by " << placing.tags.size() << " tags in "
            << result.read.pictures << (result.read.pictures == 1 ? " picture" : " pictures")
            << ", RMS " << std::setprecision(2) << placing.fit.rms << " px\n"
            << "position_m: " << bracketed(place.position) << " +- " << std::fixed
            << std::setprecision(1) << 1e3 * errors.head(3).maxCoeff() << " mm\n"
            << "rpy_deg: " << bracketed(place.rpy_deg) << " +- " << std::setprecision(2)
            << kDegrees * errors.tail(3).maxCoeff() << " deg\n"
            << "from the scene's pose: " << std::setprecision(1) << 1e3 * placing.moved << " mm, "
            << std::setprecision(2) << kDegrees * placing.turned << " deg\n";
  for (const std::string& warning : placing.warnings) std::cout << "warning: " << warning << "\n";
  if (!result.out.empty()) std::cout << "written: " << result.out << "\n";
}

void printCsv(const Placed& result) {
  CsvTable table;
  if (!result.placing.success) {
    std::cerr << result.placing.reason << "\n";
    return;
  }
  const io::CameraPlace place = io::cameraPlaceOf(result.placing.X_WC);
  const Eigen::VectorXd errors = result.errors();
  CsvTable::Row row{{"scene", result.scene.name}};
  const char* const axes[] = {"x", "y", "z"};
  const char* const angles[] = {"roll_deg", "pitch_deg", "yaw_deg"};
  for (int i = 0; i < 3; ++i) {
    row.emplace_back(std::string("position_") + axes[i] + "_m", exact(place.position[i]));
  }
  for (int i = 0; i < 3; ++i) row.emplace_back(angles[i], exact(place.rpy_deg[i]));
  for (int i = 0; i < 3; ++i) {
    row.emplace_back(std::string("error_") + axes[i] + "_m", exact(errors[i]));
  }
  for (int i = 0; i < 3; ++i) {
    row.emplace_back(std::string("error_about_") + axes[i] + "_rad", exact(errors[3 + i]));
  }
  row.emplace_back("rms_px", exact(result.placing.fit.rms));
  table.add(row);
  table.print(std::cout);
}

CameraSource sourceOf(const CameraArguments& arguments, const io::Scene& scene) {
  CameraSource source;
  source.sources = arguments.sources;
  if (arguments.seconds) source.seconds = *arguments.seconds;
  source.expected = cv::Size(scene.camera->model.width, scene.camera->model.height);
  if (source.isWebcam()) {
    if (!scene.camera->webcam) {
      throw CallerError("scene " + scene.name +
                        " has no camera.webcam; add it, or give pictures as --source");
    }
    source.webcam = *scene.camera->webcam;
  }
  return source;
}

}  // namespace

int placeCameraOf(const CameraArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  if (!scene.camera || !scene.tags) {
    throw CallerError("scene " + scene.name + " has no " + (scene.camera ? "tags" : "camera") +
                      "; expected a scene with the sections camera and tags");
  }
  if (!arguments.out.empty()) requireYaml(arguments.out);
  const bool at_rest = arguments.pressure_kpa.empty() && arguments.input.empty();
  const Eigen::VectorXd inputs = at_rest ? scene.arm.inputAt(0)
                                         : inputsOf(scene, "--pressure-kpa", arguments.pressure_kpa,
                                                    "--input", arguments.input);
  const model::Shape shape = shapeOf(scene, inputs);
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
    result.placing = procedures::placeCamera(scene, shape, pictures);
  }
  if (result.placing.success && !arguments.out.empty()) {
    io::writeFileAtomically(arguments.out,
                            io::sceneTextWithCamera(arguments.scene, overridesOf(global),
                                                    {std::nullopt, result.placing.X_WC}));
    result.out = arguments.out;
  }
  if (global.format == Format::kJson) printJson(reportOf(result));
  if (global.format == Format::kCsv) printCsv(result);
  if (global.format == Format::kText) printText(result);
  return result.placing.success ? kDone : kNotPossible;
}

}  // namespace helix_arm::cli
