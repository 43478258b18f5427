#include "helix_arm/localization/camera_placement.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/refusal.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

struct Bench {
  model::Arm arm = test::ringArm({});
  model::Shape shape = arm.twists(arm.inputAt(0));
  ArmView view = test::sampleView();
  Random random{1};

  std::vector<CornerObservation> look(double noise) {
    return test::observe(view, visibleTags(view, shape, 0.3), noise, random);
  }
};

TEST(CameraPlacement, CovarianceOfTheCameraIsThatOfItsSmallMotions) {
  Random random(2);
  const auto pose = [&random] {
    lie::Vector6 xi;
    for (int i = 0; i < 6; ++i) xi[i] = random.normal();
    return lie::SE3::exp(xi);
  };
  const lie::SE3 X_WB = pose(), X_CB = pose();
  lie::Matrix6 L = lie::Matrix6::Random();
  const lie::Matrix6 covariance = L * L.transpose();
  // Position and rotation of the camera by differences, from the definition of xi.
  lie::Matrix6 J;
  const lie::SE3 nominal = X_WB * X_CB.inverse();
  constexpr double kStep = 1e-6;
  for (int j = 0; j < 6; ++j) {
    const lie::SE3 moved = X_WB * (X_CB * lie::SE3::exp(kStep * lie::Vector6::Unit(j))).inverse();
    const lie::SE3 turn{moved.rotation * nominal.rotation.transpose(), Eigen::Vector3d::Zero()};
    J.col(j) << (moved.translation - nominal.translation) / kStep, turn.log().tail<3>() / kStep;
  }
  const lie::Matrix6 expected = J * covariance * J.transpose();
  EXPECT_TRUE(cameraCovariance(X_WB, X_CB, covariance).isApprox(expected, 1e-5));
}

TEST(CameraPlacement, StatedErrorGrowsWithResidualsAndWithPriors) {
  Bench bench;
  const auto seen = bench.look(0.3);
  const double focal = bench.view.camera.focal();
  const auto error = [&](const std::vector<CornerObservation>& what,
                         const CameraPlacementOptions& options) {
    const CameraPlacement placed = fitCameraPlacement(bench.arm, bench.view.layout, bench.shape,
                                                      what, focal, bench.view.X_CB, options);
    EXPECT_EQ(placed.status, PlacementStatus::kPlaced);
    return placed.covariance.diagonal().cwiseSqrt().head<3>().norm();
  };
  CameraPlacementOptions exact, loose;
  exact.tag_prior = {1e-6, 1e-6};
  exact.shape_prior = {1e-6, 1e-6};
  exact.bleed_prior = 1e-8;
  const double least = error(seen, exact);
  EXPECT_GT(error(seen, loose), 3 * least);
  EXPECT_GT(error(bench.look(0.75), exact), 2 * least);  // 0.75 px where 0.3 px are expected
}

TEST(CameraPlacement, FarStartsAreFound) {
  Bench bench;
  const auto seen = bench.look(0);
  for (int i = 0; i < 20; ++i) {
    lie::Vector6 off;
    off << 0.1 * bench.random.direction<3>(), 0.3 * bench.random.direction<3>();
    const CameraPlacement placed =
        fitCameraPlacement(bench.arm, bench.view.layout, bench.shape, seen,
                           bench.view.camera.focal(), bench.view.X_CB * lie::SE3::exp(off));
    EXPECT_EQ(placed.status, PlacementStatus::kPlaced);
    EXPECT_LT((placed.X_CB.inverse() * bench.view.X_CB).log().norm(), 1e-5) << i;
    EXPECT_EQ(placed.outliers(), 0);
    EXPECT_LT(placed.rms, 1e-3);
    EXPECT_LT(placed.shape_deviations, 1e-2);
  }
}

TEST(CameraPlacement, OneTagIsTooFew) {
  Bench bench;
  auto seen = bench.look(0.3);
  seen.resize(1);
  EXPECT_EQ(
      fitCameraPlacement(bench.arm, bench.view.layout, bench.shape, seen, 900, bench.view.X_CB)
          .status,
      PlacementStatus::kTooFewTags);
}

TEST(CameraPlacement, BadArgumentsAreRefused) {
  Bench bench;
  const auto with = [&](const std::function<void(std::vector<CornerObservation>&, double&,
                                                 CameraPlacementOptions&)>& change) {
    auto seen = bench.look(0.3);
    double focal = 900;
    CameraPlacementOptions options;
    change(seen, focal, options);
    return test::refusal([&] {
      fitCameraPlacement(bench.arm, bench.view.layout, bench.shape, seen, focal, bench.view.X_CB,
                         options);
    });
  };
  const char* const positive = "; expected a finite value > 0";
  EXPECT_EQ(with([](auto&, double& focal, auto&) { focal = 0; }),
            std::string("camera placement: the focal length [px] is 0") + positive);
  EXPECT_EQ(with([](auto&, double&, auto& options) { options.corner_noise = -1; }),
            std::string("camera placement: the corner noise [px] is -1") + positive);
  EXPECT_EQ(with([](auto&, double&, auto& options) { options.max_iterations = 0; }),
            "camera placement: the number of iterations is 0; expected a value > 0");
  EXPECT_EQ(with([](auto& seen, double&, auto&) { seen[0].tag = 99; }),
            "camera placement: the index of a tag is 99; expected one of the layout");
  EXPECT_NE(with([](auto& seen, double&, auto&) {
              seen[0].direction(0, 0) = std::numeric_limits<double>::quiet_NaN();
            }).find("is not finite; expected finite directions"),
            std::string::npos);
}

TEST(CameraPlacement, CornerErrorIsInPixelsAndInfiniteBehindTheCamera) {
  Bench bench;
  auto seen = bench.look(0);
  const double focal = bench.view.camera.focal();
  EXPECT_NEAR(cornerError(bench.view.layout, bench.shape, bench.view.X_CB, seen[0], focal), 0,
              1e-9);
  seen[0].direction.row(0).array() += 2 / focal;  // 2 px along one of two axes
  EXPECT_NEAR(cornerError(bench.view.layout, bench.shape, bench.view.X_CB, seen[0], focal),
              std::sqrt(2.0), 1e-9);
  lie::SE3 behind = bench.view.X_CB;
  behind.translation.z() -= 5;
  EXPECT_TRUE(std::isinf(cornerError(bench.view.layout, bench.shape, behind, seen[0], focal)));
}

}  // namespace
}  // namespace helix_arm::estimation
