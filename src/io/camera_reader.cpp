#include "camera_reader.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/io/number.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "pose_reader.hpp"

namespace helix_arm::io {

const Eigen::Matrix3d kOpticalInBody =
    (Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished();

namespace {

bool wholeAndPositive(double x) { return x > 0 && x == std::floor(x); }

const NumberRule kPixels{"a whole number > 0", wholeAndPositive, 1, 20000, " px"};
const NumberRule kFocalLength = within(kPositive, 1, 1e6, " px");
const NumberRule kPixelCoordinate = within(kFinite, -1e5, 1e5, " px");
const NumberRule kDistortion = within(kFinite, -1e4, 1e4);
// A camera farther away than this was given in mm.
const NumberRule kPlace = within(kFinite, -100, 100, " m");
const NumberRule kFrameRate = within(kPositive, 0.01, 1000, " Hz");

std::array<double, 8> readDistortion(const MapReader& camera) {
  std::array<double, 8> distortion = {};
  if (!camera.has("distortion")) return distortion;
  const auto given = camera.numbers("distortion", 0, kDistortion);
  if (!given) return distortion;
  if (given->size() != 4 && given->size() != 5 && given->size() != 8) {
    camera.complain("distortion", "has " + std::to_string(given->size()) +
                                      " entries; expected 4, 5 or 8: k1 k2 p1 p2 k3 k4 k5 k6");
    return distortion;
  }
  std::copy(given->begin(), given->end(), distortion.begin());
  return distortion;
}

vision::WebcamConfig readWebcam(const Value& value, const std::string& path,
                                const estimation::Camera& model, FaultList& faults) {
  constexpr int kLargest = 1'000'000;
  const MapReader keys(value, path, {"device", "fourcc", "fps", "focus", "exposure"}, faults);
  vision::WebcamConfig webcam;
  webcam.width = model.width;
  webcam.height = model.height;
  if (keys.has("device")) {
    webcam.device = keys.text("device", "the path of a device").value_or(webcam.device);
  }
  if (keys.has("fourcc")) {
    webcam.fourcc = keys.choice("fourcc", {"MJPG", "YUYV", "UYVY", "GREY"}).value_or(webcam.fourcc);
  }
  webcam.fps = keys.number("fps", kFrameRate, webcam.fps);
  webcam.focus = static_cast<int>(keys.integer("focus", 0, kLargest, webcam.focus));
  webcam.exposure = static_cast<int>(keys.integer("exposure", 0, kLargest, webcam.exposure));
  return webcam;
}

}  // namespace

std::optional<CameraConfig> readCamera(const MapReader& scene, const Value& document,
                                       FaultList& faults) {
  const Value* value = document.find("camera");
  if (value == nullptr) return std::nullopt;
  const MapReader keys(
      *value, scene.path("camera"),
      {"size_px", "focal_px", "centre_px", "distortion", "position_m", "rpy_deg", "webcam"},
      faults);
  CameraConfig camera;
  if (const auto size = keys.numbers("size_px", 2, kPixels)) {
    camera.model.width = static_cast<int>((*size)[0]);
    camera.model.height = static_cast<int>((*size)[1]);
    const double pixels = (*size)[0] * (*size)[1];
    if (pixels > vision::JpegDecoder::kMaxPixels) {
      keys.complain("size_px", "makes " + formatNumber(pixels) + " pixels; expected at most " +
                                   formatNumber(vision::JpegDecoder::kMaxPixels));
    }
  }
  if (const auto focal = keys.numbers("focal_px", 2, kFocalLength)) {
    camera.model.fx = (*focal)[0];
    camera.model.fy = (*focal)[1];
  }
  if (const auto centre = keys.numbers("centre_px", 2, kPixelCoordinate)) {
    camera.model.cx = (*centre)[0];
    camera.model.cy = (*centre)[1];
  }
  camera.model.distortion = readDistortion(keys);
  keys.required("position_m", "the position of the camera in the world [m]");
  keys.required("rpy_deg", "the rotation of its frame, whose x axis is the optical axis [degrees]");
  camera.X_WC = readPose(keys, kPlace);
  camera.X_WC.rotation *= kOpticalInBody;
  if (const Value* webcam = value->find("webcam")) {
    camera.webcam = readWebcam(*webcam, keys.path("webcam"), camera.model, faults);
  }
  return camera;
}

}  // namespace helix_arm::io
