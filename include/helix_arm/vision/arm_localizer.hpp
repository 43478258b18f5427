#pragma once

#include <memory>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_sight.hpp"
#include "helix_arm/estimation/twist_fit.hpp"
#include "helix_arm/vision/tag_tracker.hpp"

namespace helix_arm::vision {

/// What a picture gave.
enum class SightState {
  kMeasured,    ///< the shape is measured
  kNoTags,      ///< no tag of the arm is in sight
  kTooFewTags,  ///< the tags in sight do not determine the shape
  kNoFit,       ///< no shape of the arm fits the tags in sight
};
/// "measured", "no_tags", "too_few_tags" or "no_fit".
const char* nameOf(SightState state);

struct LocalizerConfig {
  DetectorConfig detector;
  TrackingMode tracking = TrackingMode::kEdges;
  estimation::TwistFitOptions fit;
  int min_tags = 2;  ///< fewer tags of the arm in sight make no measurement, >= 2

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// The tags of one picture and the shape they tell of.
struct Sight {
  SightState state = SightState::kNoTags;
  std::vector<TagDetection> detections;  ///< all of them, sorted by id
  std::vector<int> foreign_ids;          ///< not tags of this arm
  std::vector<int> repeated_ids;         ///< seen more than once: none of them is used
  std::vector<int> unusable_ids;         ///< where the lens folds the picture: not used either
  int by_edges = 0, by_regions = 0;
  bool whole_picture = false;
  estimation::TwistFit fit;  ///< of meaning where the state is kMeasured
};

/// From picture to shape: tracks the tags from where the last shape, or the model's, puts them,
/// and fits the shape to their corners. Not for two threads at once.
class ArmLocalizer {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  ArmLocalizer(const estimation::ArmView& view, const LocalizerConfig& config);
  ~ArmLocalizer();
  ArmLocalizer(ArmLocalizer&&) noexcept;
  ArmLocalizer& operator=(ArmLocalizer&&) noexcept;

  /// @param gray   (CV_8UC1) of the camera's size.
  /// @param model  shape that the arm should about have; its change since the last picture helps to
  /// tell where the tags went.
  /// @throws std::invalid_argument on a picture of another size or type.
  const Sight& locate(const cv::Mat& gray, const model::Shape& model);

  /// Forgets the last picture.
  void reset();

  const estimation::ArmView& view() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::vision
