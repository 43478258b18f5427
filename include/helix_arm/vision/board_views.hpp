#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/tag_board.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// A board in one picture.
struct BoardSight {
  std::string name;                ///< of the picture
  std::vector<TagDetection> tags;  ///< of the board, sorted by id, each once and without wrong bits
};

/// The tags of a board among all detections. Tags that are seen twice are omitted.
BoardSight boardSight(const TagBoard& board, const std::string& name,
                      const std::vector<TagDetection>& detections);

/// Which part of a picture the corners of boards have covered.
class Coverage {
 public:
  static constexpr int kColumns = 8, kRows = 6;

  explicit Coverage(const cv::Size& size) : size_(size), seen_(kColumns * kRows, false) {}

  void add(const BoardSight& sight);
  /// Part of the cells that hold a corner, 0 to 1.
  double fraction() const;
  /// Where the most cells are empty: "top left", "right", "centre", .. Empty if none are.
  std::string emptiest() const;

 private:
  bool isSeen(int column, int row) const {
    return seen_[static_cast<std::size_t>(row * kColumns + column)];
  }

  cv::Size size_;
  std::vector<bool> seen_;
};

/// Chooses pictures of a video or a webcam for a calibration: those in which the board rests, and
/// that differ from all chosen before.
class BoardViews {
 public:
  static constexpr int kLeastTags = 6;
  /// Largest RMS motion of the corners since the last picture at rest [px].
  static constexpr double kMostMotion = 1.0;
  /// Least RMS distance of the corners from those of a chosen view [widths of the picture].
  static constexpr double kLeastChange = 0.04;

  explicit BoardViews(const cv::Size& size) : size_(size), coverage_(size) {}

  /// Takes the next picture's board. @return whether it was chosen.
  bool offer(const BoardSight& sight);

  const std::vector<BoardSight>& chosen() const { return chosen_; }
  const Coverage& coverage() const { return coverage_; }

 private:
  cv::Size size_;
  Coverage coverage_;
  std::optional<BoardSight> last_;
  std::vector<BoardSight> chosen_;
};

}  // namespace helix_arm::vision
