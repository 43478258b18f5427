#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "rig.hpp"

namespace helix_arm::simulation {

/// How the tags of a simulated arm are seen.
enum class VisionKind {
  kCorners,   ///< the corners of the visible tags with noise, fitted: fast, for statistics
  kRendered,  ///< pictures that are rendered, compressed and searched, as on the rig
};

/// Configuration of a SimulatedVision.
struct SimulatedVisionConfig {
  VisionKind kind = VisionKind::kCorners;
  double corner_noise = 0.3;  ///< standard deviation of each coordinate, for kCorners, >= 0 [px]
  std::uint32_t seed = 1;     ///< of that noise
  /// Length that a tag's longest side must have to be found, for kCorners, >= 0 [px].
  double least_side = 0;
};

/// A measured shape.
struct MeasuredShape {
  model::Twists twists;        ///< (6 x sections)
  Eigen::MatrixXd covariance;  ///< (6 sections x 6 sections)
  lie::SE3 tip;                ///< of the fitted shape
  std::vector<int> tags;       ///< indices in the layout, ascending; outliers too
};

/// Measures simulated shapes as the vision node does, without node or clock: from tags, or from the
/// poses of bodies. The same seeds and calls give the same measurements.
class SimulatedVision {
 public:
  /// @param camera   the true camera and tags.
  /// @param nominal  what is known of them.
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedVision(const CameraSetup& camera, const estimation::ArmView& nominal,
                  const vision::LocalizerConfig& localizer, const SimulatedVisionConfig& config);
  ~SimulatedVision();
  SimulatedVision(SimulatedVision&&) noexcept;
  SimulatedVision& operator=(SimulatedVision&&) noexcept;

  /// A picture of an arm of the true shape; nothing if its shape cannot be measured.
  /// @param model  approximate shape, as the model's.
  std::optional<MeasuredShape> look(const model::Shape& truth, const model::Shape& model);
  /// Why the last look() that measured nothing did not.
  const std::string& whyUnseen() const;
  /// Motion of camera and base that the pictures so far show: see estimation::BaseWatch.
  const std::optional<estimation::BaseMove>& moved() const;
  /// From now on pictures are displaced by this, as by a camera that has turned [px].
  void shift(const Eigen::Vector2d& pixels);
  /// Whether from now on each picture is the last one again, as of a camera that hangs. Rendered
  /// ones are then refused as those of the vision node (vision::FrozenWatch).
  void freeze(bool frozen);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::simulation
