#pragma once

#include <memory>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/vision/config.hpp"

struct apriltag_detector;
struct apriltag_family;

namespace helix_arm::vision {

/// One of libapriltag's families of tags, by name: 36h11, 25h9, 16h5, 36h10, Circle21h7,
/// Circle49h12, Custom48h12, Standard41h12 or Standard52h13.
class TagFamily {
 public:
  /// @throws std::invalid_argument naming the known families.
  explicit TagFamily(const std::string& name);

  static std::vector<std::string> names();

  const std::string& name() const { return name_; }
  int count() const;     ///< ids are 0 .. count - 1
  int bitCount() const;  ///< of one tag
  int distance() const;  ///< minimum number of bits in which two tags differ

  /// One pixel (0 or 255) per cell, including the border and what surrounds it, as one reads the
  /// tag.
  /// @throws std::out_of_range on an unknown id.
  cv::Mat cells(int id) const;
  /// Number of cells between the edge of cells() and the square whose corners a detector finds, on
  /// each side. That square is the outer edge of the black border; in families with bits outside it
  /// (Circle, Custom, Standard), the inner edge of the black ring.
  int quietCells() const;
  /// Number of cells along a side of the detected square.
  int borderCells() const;
  /// Where black meets white around that square: what tags.size_m is measured over.
  std::string sizeEdge() const;
  /// True if the detected square is white inside and black around it.
  bool isReversed() const;

  /// For one detector, which writes to it. Valid as long as any copy of this object.
  apriltag_family* get() const { return family_.get(); }

 private:
  std::string name_;
  std::shared_ptr<apriltag_family> family_;
};

/// One tag found in a picture.
struct TagDetection {
  int id;
  int hamming;                  ///< number of wrong bits
  double margin;                ///< contrast between black and white [gray levels]
  estimation::Corners corners;  ///< [px], (0, 0) the centre of the top-left pixel
};

/// Finds all tags of a family in a picture, with libapriltag. Prints nothing. Not thread-safe.
class TagDetector {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  explicit TagDetector(const DetectorConfig& config);
  TagDetector(TagDetector&&) noexcept = default;
  TagDetector& operator=(TagDetector&&) noexcept = default;

  const DetectorConfig& config() const { return config_; }
  const TagFamily& family() const { return family_; }

  /// @param gray  (CV_8UC1), at most estimation::Camera::kMaxSide wide and high; an empty picture
  /// has no tags.
  /// @return sorted by id; an id is repeated if the picture contains it twice.
  /// @throws std::invalid_argument on any other type of picture, or a larger one.
  std::vector<TagDetection> detect(const cv::Mat& gray) {
    return detect(gray, cv::Rect({0, 0}, gray.size()));
  }
  /// Like detect(), in a region of the picture and up to 4 quad_decimate px to its left and above
  /// it. Corners are in pixels of the whole picture.
  std::vector<TagDetection> detect(const cv::Mat& gray, const cv::Rect& region);

 private:
  int leastSide() const;

  DetectorConfig config_;
  TagFamily family_;
  std::shared_ptr<apriltag_detector> detector_;  // keeps the family that it writes to
  cv::Mat copy_;
};

}  // namespace helix_arm::vision
