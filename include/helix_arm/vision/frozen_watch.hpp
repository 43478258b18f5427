#pragma once

#include <Eigen/Core>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// Notices a camera that hangs and sends its last picture again and again, with new stamps.
///
/// No two pictures of a real camera agree in every pixel, be it for noise alone. Those that do
/// although the model has moved since are old ones:
///
///     if (watch.isFrozen(gray, model::tipPose(model).translation)) refuse(gray);
///
/// An arm at rest is never called frozen.
class FrozenWatch {
 public:
  /// Motion of the model's tip between equal pictures that are still taken [m]. A simulated camera
  /// may have no noise: its pictures of an arm at rest agree, and the model then moves with the
  /// noise of the readings, by some millimetres.
  static constexpr double kMotion = 0.01;

  /// Takes the next picture.
  /// @param gray       (CV_8UC1), any size.
  /// @param model_tip  of the model at the picture's time, base frame [m].
  /// @return whether it equals the picture before, and the model's tip is farther than kMotion from
  ///     where it was at the first of these.
  bool isFrozen(const cv::Mat& gray, const Eigen::Vector3d& model_tip);
  /// Forgets the picture before.
  void reset() { before_.release(); }

 private:
  cv::Mat before_;
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero();  // of the model, at the first picture like that
};

}  // namespace helix_arm::vision
