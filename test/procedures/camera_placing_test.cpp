#include "procedures/camera_placing.hpp"

#include <Eigen/Cholesky>

#include <gtest/gtest.h>

#include "helix_arm/localization/arm_view.hpp"
#include "support/has.hpp"
#include "support/random.hpp"
#include "support/shipped_scene.hpp"
#include "vision/camera_calibration.hpp"

namespace helix_arm::procedures {
namespace {

using test::demo;
using test::Random;
using vision::TagDetection;

lie::Vector6 normals(Random& random, double translation, double rotation) {
  lie::Vector6 out;
  for (int i = 0; i < 6; ++i) out[i] = (i < 3 ? translation : rotation) * random.normal();
  return out;
}

// A rig that deviates from its scene as much as the priors say, with a camera somewhere else.
struct Truth {
  lie::SE3 X_WC;
  model::Shape shape;
  estimation::ArmView view;
  double border_shift;
};

Truth draw(const io::Scene& scene, Random& random, double errors) {
  const estimation::CameraPlacementOptions options;
  Truth truth;
  truth.X_WC = scene.camera->X_WC * lie::SE3::exp(normals(random, 0.03, 0.05));
  model::Twists twists = scene.arm.twists(scene.arm.inputAt(0));
  for (int k = 0; k < twists.cols(); ++k) {
    twists.col(k) +=
        errors * normals(random, options.shape_prior.translation * scene.arm.restLength(k),
                         options.shape_prior.rotation);
  }
  truth.shape = twists;
  truth.view = scene.view();
  truth.view.X_CB = truth.X_WC.inverse() * scene.X_WB;
  for (int i = 0; i < static_cast<int>(truth.view.layout.tags.size()); ++i) {
    if (i == truth.view.layout.baseTag()) continue;
    estimation::TagPlacement& tag = truth.view.layout.tags[static_cast<std::size_t>(i)];
    tag = estimation::movedBy(
        tag, errors * normals(random, scene.tag_prior.translation, scene.tag_prior.rotation),
        scene.arm.restLength(tag.section));
  }
  truth.border_shift = errors * scene.vision.fit.border_shift_prior * random.normal();
  truth.view.layout.size -= 2 * truth.border_shift;
  return truth;
}

std::vector<TagDetection> look(const Truth& truth, double noise, Random& random) {
  std::vector<TagDetection> tags;
  for (const estimation::TagImage& observation :
       estimation::visibleTags(truth.view, truth.shape, 0.3)) {
    TagDetection tag{truth.view.layout.tags[static_cast<std::size_t>(observation.tag)].id, 0, 50,
                     observation.corners};
    for (int c = 0; c < 4; ++c) {
      tag.corners.col(c) += noise * Eigen::Vector2d(random.normal(), random.normal());
    }
    tags.push_back(tag);
  }
  return tags;
}

model::Shape modelShape(const io::Scene& scene) {
  return scene.model.solve(scene.arm.inputAt(0)).shape;
}

// Error of position [m] and rotation [rad], along and about the axes of the world.
lie::Vector6 errorOf(const lie::SE3& X_WC, const lie::SE3& truth) {
  lie::Vector6 error = lie::Vector6::Zero();
  error.head<3>() = X_WC.translation - truth.translation;
  const lie::SE3 turn{X_WC.rotation * truth.rotation.transpose(), Eigen::Vector3d::Zero()};
  error.tail<3>() = turn.log().tail<3>();
  return error;
}

TEST(CameraPlacing, PoseIsWithinThreeStandardErrorsIn95Of100Rigs) {
  const io::Scene scene = demo();
  Random random(2);
  int inside = 0;
  double distance2 = 0;
  constexpr int kRigs = 100;
  for (int i = 0; i < kRigs; ++i) {
    const Truth truth = draw(scene, random, 1);
    const CameraPlacing placed = placeCamera(scene, modelShape(scene), {look(truth, 0.3, random)});
    ASSERT_TRUE(placed.success) << placed.reason;
    const lie::Vector6 error = errorOf(placed.X_WC, truth.X_WC);
    const lie::Vector6 relative = error.cwiseQuotient(placed.covariance.diagonal().cwiseSqrt());
    inside += relative.cwiseAbs().maxCoeff() <= 3 ? 1 : 0;
    distance2 += error.dot(placed.covariance.ldlt().solve(error)) / kRigs;
  }
  EXPECT_GE(inside, 95);
  EXPECT_GT(distance2, 3.0);  // neither is it stated much too large
  EXPECT_LT(distance2, 9.0);
}

TEST(CameraPlacing, AMisplacedTagIsNamedAndDoesNotMoveTheCamera) {
  const io::Scene scene = demo();
  Random random(3);
  const Truth truth = draw(scene, random, 0);
  std::vector<TagDetection> tags = look(truth, 0.2, random);
  ASSERT_GE(tags.size(), 7u);
  const CameraPlacing before = placeCamera(scene, modelShape(scene), {tags});
  tags[3].corners.row(0).array() += 60;  // 5 cm
  const CameraPlacing placed = placeCamera(scene, modelShape(scene), {tags});
  ASSERT_TRUE(placed.success) << placed.reason;
  EXPECT_EQ(placed.outliers, std::vector<int>{tags[3].id});
  EXPECT_LT(errorOf(placed.X_WC, before.X_WC).head<3>().norm(), 0.01);
}

TEST(CameraPlacing, PicturesOfSeveralPosesAreRefused) {
  const io::Scene scene = demo();
  Random random(4);
  const Truth truth = draw(scene, random, 0);
  const auto one = look(truth, 0.2, random);
  auto other = one;
  for (TagDetection& tag : other) tag.corners.array() += 8;
  const CameraPlacing still =
      placeCamera(scene, modelShape(scene), {one, look(truth, 0.2, random)});
  EXPECT_TRUE(still.success) << still.reason;
  const CameraPlacing moved = placeCamera(scene, modelShape(scene), {one, other});
  EXPECT_FALSE(moved.success);
  EXPECT_TRUE(test::has(moved.reason, "keep camera and arm still"));
}

}  // namespace
}  // namespace helix_arm::procedures
