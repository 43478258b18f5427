#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/tag_detector.hpp"

/// Tags are found again from one picture to the next. Those whose bits lie inside a black border on
/// white are found by their edges.
namespace helix_arm::vision {

/// Maximum number of cells along a border, over all families with a closed one.
inline constexpr int kMostCells = 8;

/// The cells of a tag with a closed border, as one reads it, up to its outer edge: 0, or white.
using TagCells = cv::Mat_<std::uint8_t>;

/// Whether the family's bits lie in a black border on white: such tags are found by their edges.
inline bool hasClosedBorder(const TagFamily& family) {
  const int within = family.borderCells() - 2;
  return family.borderCells() <= kMostCells && family.bitCount() == within * within;
}

/// @throws std::out_of_range on an unknown id.
inline TagCells cellsOf(const TagFamily& family, int id) {
  const int first = family.quietCells(), size = family.borderCells();
  return family.cells(id)(cv::Rect(first, first, size, size));
}

/// Finds one tag by the edges of its border and verifies it: the border is black all around, the
/// bits are the tag's, and the edges between its cells agree with the corners.
///
/// A tag is found if its centre is off by at most a quarter of its shorter side and at most 12 px.
/// Errors of 0.2 rad in rotation and 10 % in size are tolerated.
///
/// @param gray      (CV_8UC1)
/// @param family    with a closed border.
/// @param expected  [px]; any values; at worst the tag is not found.
std::optional<TagDetection> lockOnEdges(const cv::Mat& gray, const TagFamily& family, int id,
                                        const TagCells& cells, const estimation::Corners& expected,
                                        int max_hamming);

/// False if the edges between the cells of a tag contradict its corners, for example because
/// something lies along one of its sides.
///
/// @param gray     (CV_8UC1)
/// @param corners  [px]
bool cornersHold(const cv::Mat& gray, const TagCells& cells, const estimation::Corners& corners);

/// Moves a tag's corners to where the lines through its edges meet. An edge lies where the gray
/// level is half-way between the centres of the cells on both sides; pixels beyond do not matter.
///
/// @param reach    maximum error of the given corners [px].
/// @param corners  [px]
/// @return the corners unchanged if the edges are farther away.
estimation::Corners refineCorners(const cv::Mat& gray, const TagFamily& family, double reach,
                                  const estimation::Corners& corners);

/// Where a tag is expected.
struct ExpectedTag {
  int id;
  estimation::Corners corners;  ///< [px]
  /// It was seen in the last picture; if it is then not found, the whole picture is searched.
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
