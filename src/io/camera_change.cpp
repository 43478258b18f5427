#include "helix_arm/io/camera_change.hpp"

#include <sstream>

#include "camera_reader.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/number.hpp"
#include "pose_reader.hpp"
#include "scene_document.hpp"
#include "value_writer.hpp"

namespace helix_arm::io {
namespace {

constexpr std::size_t kPlumbBob = 5;  // coefficients

// Up to the last that is not 0, in one of the sizes that are known.
std::size_t coefficientsOf(const estimation::Camera& camera) {
  for (std::size_t i = kPlumbBob; i < camera.distortion.size(); ++i) {
    if (camera.distortion[i] != 0) return camera.distortion.size();
  }
  return kPlumbBob;
}

Eigen::VectorXd distortionOf(const estimation::Camera& camera) {
  return Eigen::Map<const Eigen::VectorXd>(camera.distortion.data(),
                                           static_cast<Eigen::Index>(coefficientsOf(camera)));
}

void putIntrinsics(const estimation::Camera& camera, Value& map) {
  setValue(map, "size_px", numbersValue(Eigen::Vector2d(camera.width, camera.height)));
  setValue(map, "focal_px", numbersValue(Eigen::Vector2d(camera.fx, camera.fy)));
  setValue(map, "centre_px", numbersValue(Eigen::Vector2d(camera.cx, camera.cy)));
  if (camera.distorts()) {
    setValue(map, "distortion", numbersValue(distortionOf(camera)));
  } else {
    eraseValue(map, "distortion");
  }
}

void addMatrix(const char* name, int rows, const Eigen::VectorXd& entries, std::ostream& out) {
  out << name << ":\n  rows: " << rows << "\n  cols: " << entries.size() / rows << "\n  data: [";
  for (Eigen::Index i = 0; i < entries.size(); ++i) {
    out << (i > 0 ? ", " : "") << formatNumber(entries[i]);
  }
  out << "]\n";
}

}  // namespace

CameraPlace cameraPlaceOf(const lie::SE3& X_WC) {
  return {X_WC.translation, rpyDegOf(X_WC.rotation * kOpticalInBody.transpose())};
}

std::string sceneTextWithCamera(const std::string& path, const std::vector<Override>& overrides,
                                const CameraChange& change) {
  FaultList faults(path);
  Value document = readSceneDocument(path, overrides, faults).document;
  const Scene scene = makeScene(document, faults);
  basics::require(scene.camera.has_value(), "scene ", scene.name,
                  " has no camera; expected one with a section camera");
  Value& camera = *findValue(document, "camera");
  if (change.intrinsics) putIntrinsics(*change.intrinsics, camera);
  if (change.X_WC) {
    const CameraPlace place = cameraPlaceOf(*change.X_WC);
    setValue(camera, "position_m", numbersValue(place.position));
    setValue(camera, "rpy_deg", numbersValue(place.rpy_deg));
  }
  std::string text = "# The camera of this scene was calibrated or placed by helix_arm camera.\n" +
                     writeDocument(document);
  FaultList faults_after(path + ", with the new camera,");
  const std::optional<Value> written = parseScene(text, faults_after);
  faults_after.throwIfAny();
  makeScene(*written, faults_after);
  return text;
}

std::string cameraInfoText(const estimation::Camera& camera, const std::string& name) {
  std::ostringstream out;
  const bool rational = coefficientsOf(camera) > kPlumbBob;
  Eigen::VectorXd K(9), R(9), P(12);
  K << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  R << 1, 0, 0, 0, 1, 0, 0, 0, 1;
  P << camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0;
  out << "image_width: " << camera.width << "\nimage_height: " << camera.height
      << "\ncamera_name: " << name << "\n";
  addMatrix("camera_matrix", 3, K, out);
  out << "distortion_model: " << (rational ? "rational_polynomial" : "plumb_bob") << "\n";
  addMatrix("distortion_coefficients", 1, distortionOf(camera), out);
  addMatrix("rectification_matrix", 3, R, out);
  addMatrix("projection_matrix", 3, P, out);
  return out.str();
}

}  // namespace helix_arm::io
