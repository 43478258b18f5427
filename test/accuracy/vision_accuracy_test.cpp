// From rendered pictures of a moving arm to its tip: good, typical and bad pictures, with clutter
// behind the arm and a bar that wanders before it.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "support/picture_series.hpp"
#include "support/test_size.hpp"

namespace helix_arm {
namespace {

struct Quality {
  const char* name;
  double blur, noise;  // [px], [gray levels]
  double tip_rms;      // allowed [m]
};

class VisionAccuracy : public ::testing::TestWithParam<Quality> {};

TEST_P(VisionAccuracy, EveryTipIsWhereItsCovarianceSays) {
  simulation::SimulatedCameraConfig config;
  config.blur = GetParam().blur;
  config.noise = GetParam().noise;
  config.clutter = 12;
  config.occluders = 1;
  const int pictures = test::draws(30, 90);
  const test::PictureSeries series(test::sampleView(0.8, 1, 20), pictures, config);
  vision::ArmLocalizer localizer(series.view, {});
  double square = 0, normalised = 0;
  int measured = 0;
  for (std::size_t i = 0; i < series.pictures.size(); ++i) {
    const vision::Observation& vision = localizer.locate(series.pictures[i], series.model[i]);
    if (vision.state != vision::ObservationState::kMeasured) continue;
    ++measured;
    const Eigen::Vector3d error =
        model::tipPose(vision.fit.twists).translation - model::tipPose(series.truth[i]).translation;
    square += error.squaredNorm();
    const Eigen::Matrix3d covariance =
        estimation::tipCovariance(vision.fit.twists, vision.fit.covariance);
    normalised += error.dot(covariance.ldlt().solve(error)) / 3;
  }
  const double rms = std::sqrt(square / measured);
  std::printf("%s pictures: %d of %zu measured, tip RMS %.2f mm, error^2 / covariance %.2f\n",
              GetParam().name, measured, series.pictures.size(), 1e3 * rms, normalised / measured);
  EXPECT_GE(measured, pictures * 17 / 18);
  EXPECT_LT(rms, GetParam().tip_rms);
  // About 1: an error may not be much larger than it is said to be.
  EXPECT_LT(normalised / measured, 4.0);
}

INSTANTIATE_TEST_SUITE_P(Pictures, VisionAccuracy,
                         ::testing::Values(Quality{"clean", 0.5, 1.0, 0.0002},
                                           Quality{"typical", 0.8, 3.0, 0.0003},
                                           Quality{"bad", 1.5, 8.0, 0.001}),
                         [](const auto& quality) { return quality.param.name; });

}  // namespace
}  // namespace helix_arm
