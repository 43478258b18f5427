#include "helix_arm/vision/frozen_watch.hpp"

#include <cstring>

namespace helix_arm::vision {
namespace {

bool equal(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() || a.size() != b.size() || a.type() != b.type()) return false;
  const std::size_t row = a.elemSize() * static_cast<std::size_t>(a.cols);
  for (int y = 0; y < a.rows; ++y) {
    if (std::memcmp(a.ptr(y), b.ptr(y), row) != 0) return false;
  }
  return true;
}

}  // namespace

bool FrozenWatch::isFrozen(const cv::Mat& gray, const Eigen::Vector3d& model_tip) {
  if (equal(gray, before_)) return (model_tip - tip_).norm() > kMotion;
  gray.copyTo(before_);
  tip_ = model_tip;
  return false;
}

}  // namespace helix_arm::vision
