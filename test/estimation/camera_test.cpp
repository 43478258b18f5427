#include "helix_arm/localization/camera.hpp"

#include <gtest/gtest.h>

#include "support/expect_refusal.hpp"
#include "support/random.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::estimation {
namespace {

TEST(Camera, ProjectsByTheDefinitionOfOpenCV) {
  // x'' = x' radial + 2 p1 x'y' + p2 (r2 + 2 x'^2), and so on, written out for one point.
  const Camera camera{
      640, 480, 500, 510, 320, 240, {0.1, -0.05, 0.002, -0.003, 0.01, 0.02, 0.03, 0.004}};
  const double x = 0.2, y = -0.1, r2 = 0.05;
  const double radial = (1 + 0.1 * r2 - 0.05 * r2 * r2 + 0.01 * r2 * r2 * r2) /
                        (1 + 0.02 * r2 + 0.03 * r2 * r2 + 0.004 * r2 * r2 * r2);
  const double u = x * radial + 2 * 0.002 * x * y - 0.003 * (r2 + 2 * x * x);
  const double v = y * radial + 0.002 * (r2 + 2 * y * y) + 2 * -0.003 * x * y;
  const auto pixel = camera.project({2 * x, 2 * y, 2});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x(), 500 * u + 320, 1e-10);
  EXPECT_NEAR(pixel->y(), 510 * v + 240, 1e-10);
}

TEST(Camera, DirectionAndPixelUndoEachOther) {
  test::Random random(3);
  const Camera camera = test::sampleCamera();
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d pixel(random.uniform(0, camera.width - 1),
                                random.uniform(0, camera.height - 1));
    const auto direction = camera.directionOf(pixel);
    ASSERT_TRUE(direction) << pixel.transpose();
    worst = std::max(worst, (camera.pixelOf(*direction) - pixel).norm());
  }
  EXPECT_LT(worst, 1e-9);
}

TEST(Camera, WithoutDistortionADirectionIsOneDivision) {
  const Camera camera{640, 480, 500, 510, 320, 240, {}};
  EXPECT_EQ(*camera.directionOf({820, 495}), Eigen::Vector2d(1, 0.5));
}

TEST(Camera, SeesNothingBehindItself) {
  const Camera camera = test::sampleCamera();
  EXPECT_FALSE(camera.project({0.1, 0.1, -1}));
  EXPECT_FALSE(camera.project({0.1, 0.1, 0}));
}

TEST(Camera, SeesNothingWhereTheDistortionFoldsBack) {
  // radial = 1 - r2 turns back at r2 = 1/3.
  const Camera camera{640, 480, 500, 500, 320, 240, {-1.0, 0, 0, 0, 0, 0, 0, 0}};
  EXPECT_TRUE(camera.project({0.5, 0, 1}));
  EXPECT_FALSE(camera.project({0.7, 0, 1}));
  // Nothing is seen beyond 0.577 (1 - 1/3) = 0.385 focal lengths from the middle.
  EXPECT_TRUE(camera.directionOf({320 + 0.384 * 500, 240}));
  EXPECT_FALSE(camera.directionOf({320 + 0.386 * 500, 240}));
}

TEST(Camera, DirectionOfNonsenseIsNothing) {
  const Camera camera = test::sampleCamera();
  EXPECT_FALSE(camera.directionOf({std::nan(""), 0}));
  EXPECT_FALSE(camera.directionOf({HUGE_VAL, 0}));
}

TEST(Camera, WithoutCalibrationItIsRefused) {
  Camera largest = test::sampleCamera();
  largest.width = Camera::kMaxSide;
  test::expectRefusals(
      largest, [](const Camera& camera) { camera.validate(); },
      {{[](Camera& c) { c.fx = 0; },
        "camera: the focal length fx [px] is 0; expected a finite value > 0: calibrate the camera "
        "first"},
       {[](Camera& c) { c.distortion[4] = std::nan(""); }, "nan"},
       {[](Camera& c) { c.width = 0; }, "is 0"},
       {[](Camera& c) { c.height = Camera::kMaxSide + 1; }, "expected"}});
}

}  // namespace
}  // namespace helix_arm::estimation
