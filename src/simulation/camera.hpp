#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/simulation/config.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "vision/charuco_board.hpp"

namespace helix_arm::simulation {

/// Print on a flat card, row by row from its top left.
struct CardPrint {
  cv::Mat cells;               ///< (CV_8UC1) 0 or 255
  std::vector<double> across;  ///< width of each column of cells [units]
  std::vector<double> down;    ///< height of each row [units]
  double unit = 0;             ///< [m]
};

/// Renders the tags and the body of an arm as a webcam sees them: with lens distortion, blur,
/// noise, exposure, clutter and occluders.
///
/// The same seed and calls give the same pictures.
class SimulatedCamera {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedCamera(const estimation::ArmView& view, const vision::TagFamily& family,
                  const ArmBody& body, const SimulatedCameraConfig& config);
  /// @param prints  in the place of the tags of the view, one of each. @throws likewise.
  SimulatedCamera(const estimation::ArmView& view, const std::vector<CardPrint>& prints,
                  const ArmBody& body, const SimulatedCameraConfig& config);
  ~SimulatedCamera();
  SimulatedCamera(SimulatedCamera&&) noexcept;
  SimulatedCamera& operator=(SimulatedCamera&&) noexcept;

  /// The next picture (CV_8UC1) of an arm of this shape; valid until the next call.
  const cv::Mat& render(const model::Shape& shape);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

/// Poses of a board, seen from the camera, as a person would hold it: near, all over the picture,
/// tilted to each side. Board frame: origin in its centre, x right, y up, z to the reader.
/// @param count  >= 0.
std::vector<lie::SE3> boardPoses(const estimation::Camera& camera, int count, std::uint32_t seed);

/// A camera that sees a board and no arm: the board is its layout, on the base, which is the
/// camera.
/// @param X_CP  pose of the board, seen from the camera.
/// @throws std::invalid_argument naming the value and its rule.
SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::TagBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config);
/// The same with a ChArUco board.
SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::CharucoBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config);

/// Shape for a camera without an arm in view: an arm of one section, out of sight.
inline const model::Twists kArmOutOfView = model::Twists::Identity(6, 1) * 0.4;

}  // namespace helix_arm::simulation
