#pragma once

#include <memory>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// How a picture is searched where it is known about where the tags must be. Each falls back to the
/// ones before it, within the same picture.
enum class TrackingMode {
  kFull,     ///< the whole picture, always
  kRegions,  ///< the surroundings of each expected tag
  kEdges,    ///< the edges of each expected tag, and its bits
};

/// Where a tag is expected.
struct ExpectedTag {
  int id;
  estimation::Corners corners;  ///< [px]
  /// It was seen in the last picture: not to find it again is reason to search the whole one.
  bool seen_before;
};

struct TrackResult {
  std::vector<TagDetection> tags;  ///< sorted by id
  int by_edges = 0, by_regions = 0;
  bool whole_picture = false;  ///< the whole was searched; all tags are from there
};

/// Finds tags again from one picture to the next.
class TagTracker {
 public:
  TagTracker(const DetectorConfig& config, TrackingMode mode);
  ~TagTracker();
  TagTracker(TagTracker&&) noexcept;
  TagTracker& operator=(TagTracker&&) noexcept;

  const TagFamily& family() const;

  /// @param expected  empty: the whole picture is searched.
  const TrackResult& track(const cv::Mat& gray, const std::vector<ExpectedTag>& expected);
  /// The whole picture.
  const TrackResult& search(const cv::Mat& gray);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::vision
