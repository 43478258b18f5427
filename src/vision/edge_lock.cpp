#include "edge_lock.hpp"

#include <algorithm>

#include "corner_refinement.hpp"
#include "edge_search.hpp"
#include "gray_picture.hpp"
#include "tag_face.hpp"

namespace helix_arm::vision {
namespace {

using estimation::Corners;

constexpr double kLeastMargin = 5;  // of the bits [gray levels]

constexpr int kSecondReach = 4;     // [px]
constexpr double kMovedMuch = 1.5;  // the samples were in the wrong positions [px]

// Refinement of the corners.
constexpr double kRefineReach = 3.0;  // [px]
constexpr int kRefinements = 3;
constexpr double kSettled = 0.5;  // [px]

// An edge lock can fall back to a search of the region, a detection cannot.
constexpr EdgeTolerance kOfLock{0.3, 0.06, 2.5, 0.6};
constexpr EdgeTolerance kOfDetection{0.8, 0.2, 4.0, 1.5};

double largestMove(const Corners& a, const Corners& b) {
  return (a - b).colwise().norm().maxCoeff();
}

}  // namespace

std::optional<TagDetection> lockOnEdges(const cv::Mat& gray, const TagFamily& family, int id,
                                        const TagPattern& pattern, const Corners& expected,
                                        int max_hamming) {
  if (std::min(gray.cols, gray.rows) < kLeastSide || !isTagLike(expected)) return std::nullopt;
  const GrayPicture picture(gray);
  std::optional<Corners> found = searchEdges(picture, expected, kMaxReach);
  if (found && largestMove(*found, expected) > kMovedMuch) {
    found = searchEdges(picture, *found, kSecondReach);
  }
  if (!found) return std::nullopt;
  for (int i = 0; i < kRefinements; ++i) {
    const Corners refined = refineCorners(gray, family, kRefineReach, *found);
    const bool settled = largestMove(refined, *found) < kSettled;
    *found = refined;
    if (settled) break;
  }
  if (!isTagLike(*found) || !picture.contains(*found)) return std::nullopt;
  const TagFace face(picture, *found, pattern.cells);
  const TagBits bits = readBits(face, pattern);
  if (!bits.closed || bits.wrong > max_hamming || !(bits.margin >= kLeastMargin) ||
      !innerEdgesAgree(face, pattern, bits.threshold, kOfLock)) {
    return std::nullopt;
  }
  return TagDetection{id, bits.wrong, bits.margin, *found};
}

bool cornersHold(const cv::Mat& gray, const TagPattern& pattern, const Corners& corners) {
  if (!isTagLike(corners)) return true;  // too small to decide
  const GrayPicture picture(gray);
  const TagFace face(picture, corners, pattern.cells);
  return innerEdgesAgree(face, pattern, readBits(face, pattern).threshold, kOfDetection);
}

}  // namespace helix_arm::vision
