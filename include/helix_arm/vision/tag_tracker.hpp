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
  kRegions,  ///< the surroundings of each expected tag, as far as half its size
  /// The edges of each expected tag, and its bits. It may be off by a quarter of its shorter side,
  /// but no more than 12 px. Families with bits outside their border are looked for in regions.
  kEdges,
};

/// Where a tag is expected.
struct ExpectedTag {
  int id;
  estimation::Corners corners;  ///< [px]
  /// It was seen in the last picture: not to find it again is reason to search the whole one.
  bool seen_before;
};

struct TrackResult {
  /// Sorted by id; the same id twice where the picture holds it twice and its whole was searched.
  std::vector<TagDetection> tags;
  int by_edges = 0, by_regions = 0;  ///< how many of them the edges and regions gave
  bool whole_picture = false;        ///< it was searched: all other tags are from there
};

/// Finds tags again from one picture to the next. Not for two threads at once.
///
/// An expected tag is tracked only with corners that are true: it is left out where what lies along
/// its sides, or hides part of it, displaces them. A tag that is not expected is seen only where
/// the whole picture is searched: when nothing is expected, when nothing is found, when a tag of
/// the last picture is lost, every 30 pictures while other expected tags are missing, and every 90
/// otherwise. Of the missing ones, each picture looks for all by their edges but for one only, in
/// turn, in its region, so that hidden tags stay cheap.
class TagTracker {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  TagTracker(const DetectorConfig& config, TrackingMode mode);
  ~TagTracker();
  TagTracker(TagTracker&&) noexcept;
  TagTracker& operator=(TagTracker&&) noexcept;

  const TagFamily& family() const;

  /// @param gray      (CV_8UC1); an empty one holds no tags.
  /// @param expected  empty: the whole picture is searched. Corners may have any values, and tags
  /// that the family does not have are never found.
  /// @return valid until the next call.
  /// @throws std::invalid_argument on another type of picture.
  const TrackResult& track(const cv::Mat& gray, const std::vector<ExpectedTag>& expected);
  /// The whole picture, and all that the detector finds there.
  const TrackResult& search(const cv::Mat& gray);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::vision
