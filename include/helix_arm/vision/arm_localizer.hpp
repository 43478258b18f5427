#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/body_check.hpp"
#include "helix_arm/localization/rig_memory.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// Result of searching one picture.
enum class ObservationState {
  kMeasured,    ///< the shape is measured
  kNoTags,      ///< no tag of the arm is visible
  kTooFewTags,  ///< the visible tags do not determine the shape
  kNoFit,       ///< no shape of the arm fits the visible tags
};
/// "measured", "no_tags", "too_few_tags" or "no_fit".
const char* nameOf(ObservationState state);

/// The tags of one picture, or the bodies at one time, and the shape fitted to them.
struct Observation {
  ObservationState state = ObservationState::kNoTags;
  std::string
      fault;  ///< known mistake in the poses of bodies, with its remedy; no_fit is its state
  std::vector<TagDetection> detections;  ///< all detections, sorted by id
  /// Poses of the detections of bodies, whose ids are their indices; seen from C. Empty: tags.
  std::vector<estimation::BodyPose> poses;
  std::vector<int> unknown_ids;   ///< tags that this arm does not have
  std::vector<int> repeated_ids;  ///< detected more than once; none of them is used
  /// Outside the valid range of the lens distortion, or bodies with a mistake; not used.
  std::vector<int> unusable_ids;
  int by_edges = 0, by_regions = 0;
  bool whole_picture = false;
  estimation::TwistFit fit;                   ///< valid only if the state is kMeasured
  std::optional<estimation::BaseMove> moved;  ///< camera or base; nothing: as expected
};

/// Measures the shape in pictures: tracks the tags from the positions that the last shape, or the
/// model's, predicts, and fits the shape to their corners. With a layout of bodies, measures it
/// from their poses. Not thread-safe.
class ArmLocalizer {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  ArmLocalizer(const estimation::ArmView& view, const LocalizerConfig& config);
  ~ArmLocalizer();
  ArmLocalizer(ArmLocalizer&&) noexcept;
  ArmLocalizer& operator=(ArmLocalizer&&) noexcept;

  /// @param gray   (CV_8UC1) of the camera's size.
  /// @param model  approximate shape of the arm; its change since the last picture helps to predict
  /// the tags.
  /// @throws std::invalid_argument on a picture of another size or type.
  const Observation& locate(const cv::Mat& gray, const model::Shape& model);

  /// @param seen   poses of bodies in the frame C of the view, each at most once.
  /// @param model  approximate shape of the arm.
  /// @throws std::invalid_argument if the layout has no bodies.
  const Observation& locate(const std::vector<estimation::BodyPose>& seen,
                            const model::Shape& model);

  /// Forgets the last picture. What was learnt of base and border shift stays.
  void reset();
  /// Forgets the last picture, and what was learnt.
  void forget();

  const estimation::ArmView& view() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::vision
