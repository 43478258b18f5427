#pragma once

#include <memory>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// Where a tag is expected.
struct ExpectedTag {
  int id;
  estimation::Corners corners;  ///< [px]
  /// True if it was seen in the last picture; if it is then not found, the whole picture is
  /// searched.
  bool seen_before;
};

struct TrackResult {
  /// Sorted by id. An id is repeated if the picture contains it twice and was searched as a whole.
  std::vector<TagDetection> tags;
  int by_edges = 0, by_regions = 0;  ///< number of tags found by edges and by regions
  bool whole_picture = false;        ///< the whole picture was searched; it gave all other tags
};

/// Finds tags again from one picture to the next. Not thread-safe.
///
/// A tag is omitted if something along its sides, or hiding part of it, displaces its corners.
/// Unexpected tags are found only when the whole picture is searched: when no tag is expected, when
/// none is found, when a tag of the last picture is lost, every 30 pictures while other expected
/// tags are missing, and every 90 otherwise. Missing tags are all searched by their edges in every
/// picture, but only one of them, in turn, by its region. This keeps hidden tags cheap.
class TagTracker {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  TagTracker(const DetectorConfig& config, TrackingMode mode);
  ~TagTracker();

  /// @param gray      (CV_8UC1); an empty picture has no tags.
  /// @param expected  if empty, the whole picture is searched. Corners may have any values. Tags
  /// that the family does not have are never found.
  /// @return valid until the next call.
  /// @throws std::invalid_argument on any other type of picture.
  const TrackResult& track(const cv::Mat& gray, const std::vector<ExpectedTag>& expected);
  /// Searches the whole picture.
  const TrackResult& search(const cv::Mat& gray);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::vision
