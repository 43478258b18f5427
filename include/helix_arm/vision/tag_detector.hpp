#pragma once

#include <memory>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::vision {

struct DetectorConfig {
  std::string family = "36h11";
  /// Quads are looked for in a picture so many times smaller: 1, 1.5 or a whole number up to
  /// 32.
  double quad_decimate = 2.0;
  double quad_sigma = 0.0;   ///< of the blur before that (below 0: sharpens), -10 to 10 [px]
  int threads = 1;           ///< 1 to 64
  bool refine_edges = true;  ///< put the corners where the edges of the full picture cross
  /// Wrong bits that are put up with: 0 to 3, fewer than half of those in which tags of the family
  /// differ, and no more than 2 GB of memory hold.
  int max_hamming = 2;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// One tag found in a picture.
struct TagDetection {
  int id;
  int hamming;                  ///< bits that were wrong
  double margin;                ///< how clearly black and white differ, in gray levels
  estimation::Corners corners;  ///< [px], (0, 0) the centre of the top-left pixel
};

/// Finds all tags of a family in a picture, with libapriltag; prints nothing. Not for two threads
/// at once.
class TagDetector {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  explicit TagDetector(const DetectorConfig& config);
  ~TagDetector();
  TagDetector(TagDetector&&) noexcept;
  TagDetector& operator=(TagDetector&&) noexcept;

  const DetectorConfig& config() const;
  const TagFamily& family() const;

  /// @param gray  (CV_8UC1), at most estimation::Camera::kMaxSide wide and high; an empty one holds
  /// no tags.
  /// @return sorted by id; the same id twice where the picture holds it twice.
  /// @throws std::invalid_argument on another type of picture, or a larger one.
  std::vector<TagDetection> detect(const cv::Mat& gray);
  /// The same within a region of the picture, and up to 4 quad_decimate px to its left and above
  /// it; corners in pixels of the whole.
  std::vector<TagDetection> detect(const cv::Mat& gray, const cv::Rect& region);

 private:
  struct Handle;
  std::unique_ptr<Handle> handle_;
};

}  // namespace helix_arm::vision
