#include <algorithm>
#include <cmath>

#include "helix_arm/vision/camera_calibration.hpp"

namespace helix_arm::vision {
namespace {

// RMS distance of the corners that both show [px]; nothing if they share too few.
std::optional<double> distanceOf(const BoardObservation& a, const BoardObservation& b, int least) {
  double sum = 0;
  int shared = 0;
  auto other = b.corners.begin();
  for (const BoardCorner& corner : a.corners) {
    while (other != b.corners.end() && other->id < corner.id) ++other;
    if (other == b.corners.end()) break;
    if (other->id != corner.id) continue;
    sum += (corner.pixel - other->pixel).squaredNorm();
    ++shared;
  }
  if (shared < least) return std::nullopt;
  return std::sqrt(sum / shared);
}

// A pixel's centre is at whole numbers.
bool isAtBorder(const estimation::Corners& corners, const cv::Size& size) {
  const Eigen::Vector2d first = corners.rowwise().minCoeff(), last = corners.rowwise().maxCoeff();
  return first.minCoeff() + 0.5 < kLeastFromBorder ||
         last.x() + 0.5 > size.width - kLeastFromBorder ||
         last.y() + 0.5 > size.height - kLeastFromBorder;
}

}  // namespace

BoardObservation boardObservation(const TagBoard& board, const std::string& name,
                                  const cv::Size& size,
                                  const std::vector<TagDetection>& detections) {
  BoardObservation observation{name, {}};
  for (std::size_t i = 0; i < detections.size(); ++i) {
    const TagDetection& tag = detections[i];
    const bool repeated = (i > 0 && detections[i - 1].id == tag.id) ||
                          (i + 1 < detections.size() && detections[i + 1].id == tag.id);
    if (!board.has(tag.id) || tag.hamming > 0 || repeated) continue;
    if (isAtBorder(tag.corners, size)) continue;
    const estimation::Corners on_board = board.corners(tag.id);
    for (int c = 0; c < 4; ++c) {
      observation.corners.push_back(
          {4 * (tag.id - board.first_id) + c, on_board.col(c), tag.corners.col(c)});
    }
  }
  return observation;
}

void Coverage::add(const BoardObservation& observation) {
  for (const BoardCorner& corner : observation.corners) {
    // A pixel's centre is at whole numbers.
    const double x = (corner.pixel.x() + 0.5) / size_.width;
    const double y = (corner.pixel.y() + 0.5) / size_.height;
    const int column = std::clamp(static_cast<int>(x * kColumns), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(y * kRows), 0, kRows - 1);
    seen_[static_cast<std::size_t>(row * kColumns + column)] = true;
  }
}

double Coverage::fraction() const {
  const auto seen = std::count(seen_.begin(), seen_.end(), true);
  return static_cast<double>(seen) / (kColumns * kRows);
}

std::string Coverage::emptiest() const {
  const char* const kAcross[] = {"left", "", "right"};
  const char* const kDown[] = {"top", "", "bottom"};
  std::string name;
  double most = 0;
  for (int down = 0; down < 3; ++down) {
    for (int across = 0; across < 3; ++across) {
      int empty = 0, cells = 0;
      for (int row = down * kRows / 3; row < (down + 1) * kRows / 3; ++row) {
        for (int column = across * kColumns / 3; column < (across + 1) * kColumns / 3; ++column) {
          ++cells;
          empty += isSeen(column, row) ? 0 : 1;
        }
      }
      const double part = static_cast<double>(empty) / cells;
      if (part <= most) continue;
      most = part;
      name = kDown[down];
      if (!name.empty() && *kAcross[across] != '\0') name += " ";
      name += kAcross[across];
      if (name.empty()) name = "centre";
    }
  }
  return name;
}

bool BoardViews::offer(const BoardObservation& observation) {
  if (static_cast<int>(observation.corners.size()) < least_) {
    last_.reset();
    return false;
  }
  const std::optional<double> motion =
      last_ ? distanceOf(observation, *last_, least_) : std::nullopt;
  last_ = observation;
  if (!motion || *motion > kMostMotion) return false;
  for (const BoardObservation& one : chosen_) {
    const std::optional<double> change = distanceOf(observation, one, least_);
    if (change && *change < kLeastChange * size_.width) return false;
  }
  chosen_.push_back(observation);
  coverage_.add(observation);
  return true;
}

}  // namespace helix_arm::vision
