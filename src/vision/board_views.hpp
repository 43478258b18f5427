#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// One corner of a board in a picture.
struct BoardCorner {
  int id;                 ///< of the corner, on its board
  Eigen::Vector2d board;  ///< where it is in the plane of the board [m]
  Eigen::Vector2d pixel;  ///< where it is seen [px]
};

/// A board in one picture.
struct BoardObservation {
  std::string name;                  ///< of the picture
  std::vector<BoardCorner> corners;  ///< sorted by id, each once
};

/// Least distance of a tag's corners from the border of the picture [px]. The detector finds a tag
/// that the border cuts as well, with an edge up to 4 px inside the picture, which is not the
/// tag's.
inline constexpr double kLeastFromBorder = 8;

/// Corners of the board's tags among all detections. Tags with wrong bits, those that are seen
/// twice and those at the border are omitted.
/// @param size  of the picture.
BoardObservation boardObservation(const TagBoard& board, const std::string& name,
                                  const cv::Size& size,
                                  const std::vector<TagDetection>& detections);

/// Which part of a picture the corners of boards have covered.
class Coverage {
 public:
  static constexpr int kColumns = 8, kRows = 6;

  explicit Coverage(const cv::Size& size) : size_(size), seen_(kColumns * kRows, false) {}

  void add(const BoardObservation& observation);
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
  /// Largest RMS motion of the corners since the last picture at rest [px].
  static constexpr double kMostMotion = 1.0;
  /// Least RMS distance of the corners from those of a chosen view [widths of the picture].
  static constexpr double kLeastChange = 0.04;

  BoardViews(const cv::Size& size, const BoardParts& parts)
      : size_(size), least_(parts.leastCorners()), coverage_(size) {}

  /// Takes the next picture's board. @return whether it was chosen.
  bool offer(const BoardObservation& observation);

  const std::vector<BoardObservation>& chosen() const { return chosen_; }
  const Coverage& coverage() const { return coverage_; }

 private:
  cv::Size size_;
  int least_;  // corners of a view
  Coverage coverage_;
  std::optional<BoardObservation> last_;
  std::vector<BoardObservation> chosen_;
};

}  // namespace helix_arm::vision
