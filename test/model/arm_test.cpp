#include "helix_arm/model/arm.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/taper.hpp"
#include "support/allocation_counter.hpp"
#include "support/apart.hpp"
#include "support/expect_refusal.hpp"
#include "support/high_precision.hpp"
#include "support/linked_arm.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::model {
namespace {

TEST(Arm, RefusesInputsThatBreakTheContract) {
  const Arm arm = test::ringArm(test::straightRing());
  test::expectRefusal("got 2 inputs", [&] { arm.tip(Eigen::Vector2d::Zero()); });
  for (const double bad : {-1.0, 1e6, double(NAN), double(INFINITY)}) {
    const Eigen::Vector3d q(0, bad, 0);
    test::expectRefusal<std::out_of_range>("muscle_2", [&] { arm.tip(q); });
    EXPECT_THROW(arm.twists(q), std::out_of_range);
    EXPECT_THROW(arm.lengths(q), std::out_of_range);
  }
}

TEST(Arm, ClampsInputsToTheirLimits) {
  const model::Arm arm = test::ringArm(test::straightRing());
  EXPECT_EQ(arm.clamped(Eigen::Vector3d(-1e3, 2e5, 2 * test::kMaxPressure)),
            Eigen::Vector3d(0, 2e5, test::kMaxPressure));
  EXPECT_THROW(arm.clamped(Eigen::VectorXd::Zero(2)), std::invalid_argument);
}

TEST(Arm, PressuresToTipDoesNotAllocate) {
  const Arm arm = test::ringArm(test::helicalRing(), 2);
  const Eigen::VectorXd q = Eigen::VectorXd::Constant(6, 1e5);
  const test::AllocationCounter counter;
  const double sum = arm.tip(q).translation.sum() + arm.twists(q).sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(PlanarArm, AgreesWithItsEmbedding) {
  for (const PlanarArm& flat : {test::planarArm(2), test::linkedPlanarArm()}) {
    const Arm arm = embed(flat);
    test::Random random(63);
    for (int i = 0; i < 200; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      EXPECT_LT((lie::embed(flat.tip(q)).translation - arm.tip(q).translation).norm(), 1e-13);
      EXPECT_LT(test::apart(lie::embed(flat.tip(q)), arm.tip(q)), 1e-12);
      EXPECT_LT(test::apart(lie::embed(flat.tipOf(flat.twists(q))), arm.tip(q)), 1e-12);
      EXPECT_LT((embed(flat.twists(q)) - arm.twists(q)).norm(), 1e-12);
    }
  }
}

// Plates and tools: rigid links of an arm.

// The tip composed by hand.
lie::SE3 composed(const Arm& arm, const Twists& twists) {
  lie::SE3 X;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    lie::Vector6 plate = lie::Vector6::Zero();
    plate[0] = test::kPlates[k];
    X = X * lie::SE3::exp(twists.col(k)) * lie::SE3::exp(plate);
  }
  return X * test::tool();
}

TEST(Links, TheTipIsTheProductOfExponentialsPlatesAndTool) {
  const Arm arm = test::linkedArm();
  test::Random random(71);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const lie::SE3 expected = composed(arm, arm.twists(q));
    EXPECT_LT(test::apart(arm.tip(q), expected), 1e-13);
    EXPECT_LT(test::apart(arm.tipOf(arm.twists(q)), expected), 1e-13);
    EXPECT_LT(test::apart(tipPose(shapeOf(arm, arm.twists(q))), expected), 1e-13);
  }
}

Twists twist(const Eigen::Vector3d& v, const Eigen::Vector3d& w) {
  Twists g(6, 1);
  g << v, w;
  return g;
}

TEST(Curve, TenThousandSamplesDoNotDrift) {
  const Twists g = twist({0.4, 0.001, -0.002}, {4.0, 0.1, 0.5});
  const auto curve = sampleCurve(g, 10001);
  double worst = 0;
  for (std::size_t i = 1; i < curve.size(); i += 97) {
    const lie::Vector6 xi = curve[i].s * g.col(0);
    const test::RealMatrix exact = test::expOfMatrix(test::hat(xi));
    worst = std::max(worst, test::relativeEps(curve[i].X.translation, exact.topRightCorner(3, 1)));
    worst = std::max(worst, test::worstEps(curve[i].X.rotation, exact.topLeftCorner(3, 3)));
  }
  std::printf("worst of 10 001 samples: %.2f eps\n", worst);
  EXPECT_LE(worst, 8.0);
}

TEST(Curvature, LeavesTwistOut) {
  EXPECT_DOUBLE_EQ(curvatureOf(twist({0.4, 0, 0}, {5, 0.3, -0.4}).col(0)), 0.5);
}

// ---- Tapered sections: g(s) = A(s)+ D(s) l, X' = X g --------------------------------------------

constexpr double kDegree = test::kPi / 180, kTilt = 15 * kDegree;

// The definition: the equilibrium solved at s.
Equilibrium<lie::SE3> equilibriumAt(const Section& section, double s) {
  std::vector<ActuatorElement<lie::SE3>> elements;
  for (const Actuator& actuator : section.actuators) {
    elements.push_back({poseAlong(actuator, s), actuator.stiffness.diagonal<lie::SE3>()});
  }
  return solveEquilibrium(elements);
}
lie::Vector6 twistAt(const Section& section, double s, const Eigen::VectorXd& lengths) {
  return equilibriumAt(section, s).map * lengths;
}

// Of exponentials of so many pieces.
template <class PieceAt>
Eigen::Vector3d tipOfPieces(int count, const PieceAt& pieceAt) {
  lie::SE3 X;
  for (int j = 0; j < count; ++j) X = X * lie::SE3::exp(pieceAt(j));
  return X.translation;
}

Eigen::Vector3d tipBySteps(const TaperOf<lie::SE3>& taper, const Eigen::VectorXd& lengths,
                           int steps) {
  return tipOfPieces(steps, [&](int j) {
    return taper.step(static_cast<double>(j) / steps, (j + 1.0) / steps).twist(lengths);
  });
}

// Where the arm is, by very many steps of order 2 of the equilibria: (3 x steps + 1) positions
// along each section.
std::vector<Eigen::Matrix3Xd> curveByMidpoints(const std::vector<Section>& sections, const Arm& arm,
                                               const Eigen::VectorXd& lengths, int steps) {
  std::vector<Eigen::Matrix3Xd> out;
  lie::SE3 X;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const Eigen::VectorXd own =
        lengths.segment(arm.firstActuator(k), arm.firstActuator(k + 1) - arm.firstActuator(k));
    out.emplace_back(3, steps + 1);
    out.back().col(0) = X.translation;
    for (int j = 0; j < steps; ++j) {
      X = X * lie::SE3::exp(twistAt(sections[k], (j + 0.5) / steps, own) / steps);
      out.back().col(j + 1) = X.translation;
    }
  }
  return out;
}

// Mild tapers of 1 to 16 sections, with lists of 2 to 9 values of which neighbours have different
// numbers: all are taken, and they are where the equilibria are.
TEST(Taper, MildTapersAreTakenAtTheStatedError) {
  constexpr int kFine = 168;  // a multiple of all numbers of cells below
  const std::pair<double, double> tilts[] = {
      {0.0, 0.0}, {kTilt, kTilt}, {0.0, kTilt}, {10 * kDegree, 30 * kDegree}};
  double worst_tip = 0.0, worst_curve = 0.0;
  int most_steps = 0;
  test::Random random(98);
  for (const int count : {1, 2, 3, 6, 11, 16}) {
    for (const double ratio : {0.9, 0.5}) {
      for (const auto& [from, to] : tilts) {
        std::vector<Section> sections;
        for (int k = 0; k < count; ++k) {
          const int cells = std::array{8, 7, 3, 1}[k % 4];
          std::vector<double> radius, tilt;
          for (int i = 0; i <= cells; ++i) {
            const double s = static_cast<double>(i) / cells;
            radius.push_back(0.04 * (1 - (1 - ratio) * s * std::sqrt(s)));
            tilt.push_back(from + (to - from) * s);
          }
          sections.push_back(test::taperedSection(
              to == 0.0 ? test::straightRing() : test::helicalRing(), radius, tilt));
        }
        SCOPED_TRACE(testing::Message()
                     << count << " sections, ratio " << ratio << ", tilt " << from << " to " << to);
        const Arm arm(sections);
        most_steps = std::max(most_steps, arm.piecesPerSection());
        for (int sample = 0; sample < 2; ++sample) {
          Eigen::VectorXd q = test::randomInput(arm, random);
          if (sample > 0) q = arm.inputAt((q / test::kMaxPressure).array().round().matrix());
          const Shape shape = shapeOf(arm, arm.unloaded(q));
          const auto coarse = curveByMidpoints(sections, arm, arm.lengths(q), kFine),
                     fine = curveByMidpoints(sections, arm, arm.lengths(q), 2 * kFine);
          const auto truth = [&](int k, int j) -> Eigen::Vector3d {
            return fine[k].col(2 * j) + (fine[k].col(2 * j) - coarse[k].col(j)) / 3;
          };
          const double length = arm.restLength();
          worst_tip = std::max(worst_tip,
                               (arm.tip(q).translation - truth(count - 1, kFine)).norm() / length);
          for (int k = 0; k < count; ++k) {
            for (int j = 0; j < kFine; ++j) {
              const double off =
                  (poseAt(shape, k, static_cast<double>(j) / kFine).translation - truth(k, j))
                      .norm();
              worst_curve = std::max(worst_curve, off / length);
            }
          }
          EXPECT_LT(worst_tip, 1e-5);
          EXPECT_LT(worst_curve, 2e-4);
        }
      }
    }
  }
  std::printf("mild tapers: tip within %.1e of the length, curve within %.1e, at most %d steps\n",
              worst_tip, worst_curve, most_steps);
}

// The table of docs/accuracy.md: tip errors at 300, 0, 50 kPa.
TEST(Taper, MagnusStepsAreWorthMoreThanConstantPieces) {
  struct Case {
    const char* name;
    double tilt, from, to;
  };
  std::printf("tip error, %% of length\n%-28s %-33s %s\n", "", "constant pieces 1, 2, 4, 8, 16",
              "Magnus steps 1, 2, 4");
  for (const Case& one : {Case{"straight, 50 to 25 mm", 0.0, 0.05, 0.025},
                          Case{"straight, 40 to 30 mm", 0.0, 0.04, 0.03},
                          Case{"helical 15 deg, 50 to 25 mm", kTilt, 0.05, 0.025}}) {
    const Section section =
        test::taperedSection(one.tilt == 0.0 ? test::straightRing() : test::helicalRing(),
                             {one.from, one.to}, {one.tilt, one.tilt});
    const Arm arm({section});
    const Eigen::VectorXd lengths = arm.lengths(Eigen::Vector3d(3e5, 0, 5e4));
    const TaperOf<lie::SE3> taper(section.actuators);
    const Eigen::Vector3d truth = tipBySteps(taper, lengths, 256);
    std::vector<double> constant, magnus;
    std::printf("%-28s", one.name);
    for (const int count : {1, 2, 4, 8, 16}) {
      const Eigen::Vector3d tip = tipOfPieces(count, [&](int j) {
        return lie::Vector6(twistAt(section, (j + 0.5) / count, lengths) / count);
      });
      constant.push_back(100 * (tip - truth).norm() / arm.restLength());
      std::printf(" %-6.2g", constant.back());
    }
    for (const int count : {1, 2, 4}) {
      const Eigen::Vector3d tip = tipBySteps(taper, lengths, count);
      magnus.push_back(100 * (tip - truth).norm() / arm.restLength());
      std::printf(" %-6.2g", magnus.back());
    }
    std::printf("\n");
    EXPECT_GT(constant[0], 0.5);
    EXPECT_GT(constant[3], magnus[1]);  // 8 pieces against 2 steps
    EXPECT_LT(magnus[2], 1e-3);
  }
}

}  // namespace
}  // namespace helix_arm::model
