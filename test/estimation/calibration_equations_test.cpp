#include <vector>

#include <gtest/gtest.h>

#include "calibration/calibration_fit.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm::estimation {
namespace {

// Six captures of a helical arm with tags, as corners.
std::vector<ArmCaptures> rig() {
  const model::Arm known = test::ringArm(test::helicalRing());
  const ArmView view = test::sampleView(0.8, 1, 32);
  test::Random random(2);
  const test::RigTruth truth =
      test::drawRig(known, view, {0.2, 0.4, 0.02, 0.01, 0.02, 0.002, 0.05, 0}, random);
  ArmCaptures data{"rig", known, false, view.layout, view.X_CB, view.camera, {}};
  for (int c = 0; c < 6; ++c) {
    const Eigen::VectorXd pressure = test::randomInput(known, random);
    test::addCapture(data, pressure, test::observe(truth, pressure, 0.3, random));
  }
  return {data};
}

// Tags are eliminated, or the shapes of captures.
TEST(CalibrationEquations, EliminationGivesWhatTheWholeMatrixDoes) {
  const std::vector<ArmCaptures> data = rig();
  for (const bool free_shapes : {false, true}) {
    CalibrationOptions options;
    options.fit.insert({FitParameter::kBase, FitParameter::kTags});
    options.free_shapes = free_shapes;
    CalibrationProblem problem(data, options);
    CalibrationEquations& equations = problem.equations(1.0);
    const Eigen::MatrixXd H = equations.hessian();
    const Eigen::VectorXd damping = 1e-3 * H.diagonal();
    ASSERT_TRUE(equations.factor(damping));
    const Eigen::MatrixXd inverse = (H + Eigen::MatrixXd(damping.asDiagonal()))
                                        .llt()
                                        .solve(Eigen::MatrixXd::Identity(H.rows(), H.cols()));
    const Eigen::VectorXd step = -inverse * equations.gradient();
    EXPECT_LT((equations.step() - step).norm(), 1e-8 * step.norm());
    const Eigen::VectorXd weights = Eigen::VectorXd::LinSpaced(H.rows(), 1, 2);
    EXPECT_NEAR(equations.inverseTrace(weights) / inverse.diagonal().dot(weights), 1, 1e-8);
    if (!free_shapes) continue;
    const Eigen::Index count = equations.reduced().rows();  // shapes come last
    EXPECT_LT((equations.reducedInverse() - inverse.topLeftCorner(count, count)).norm(),
              1e-8 * inverse.norm());
  }
}

}  // namespace
}  // namespace helix_arm::estimation
