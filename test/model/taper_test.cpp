// Tapered sections without load: g(s) = A(s)+ D(s) l, X' = X g.
#include "helix_arm/model/taper.hpp"

#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/model/batch.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/refusal.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::model {
namespace {

constexpr double kTilt = 15 * test::kPi / 180;

// The definition: the equilibrium solved at s.
lie::Vector6 twistAt(const Section& section, double s, const Eigen::VectorXd& lengths) {
  std::vector<Strand<lie::SE3>> strands;
  for (const Actuator& actuator : section.actuators) {
    strands.push_back({poseAlong(actuator, s), actuator.stiffness.diagonal<lie::SE3>()});
  }
  return solveEquilibrium(strands).map * lengths;
}

// The tip by very many steps of order 2, extrapolated (Richardson): independent of Magnus steps.
Eigen::Vector3d tipByMidpoints(const Section& section, const Eigen::VectorXd& lengths) {
  const auto with = [&](int steps) {
    lie::SE3 X;
    for (int j = 0; j < steps; ++j) {
      X = X * lie::SE3::exp(twistAt(section, (j + 0.5) / steps, lengths) / steps);
    }
    return X.translation;
  };
  const Eigen::Vector3d coarse = with(200), fine = with(400);
  return fine + (fine - coarse) / 3.0;
}

TEST(Bracket, IsTheDerivativeOfTheAdjoint) {
  test::Random random(91);
  for (int i = 0; i < 20; ++i) {
    lie::Vector6 a, b;
    for (int k = 0; k < 6; ++k) {
      a[k] = random.normal();
      b[k] = random.normal();
    }
    constexpr double kStep = 1e-6;
    const lie::Vector6 expected =
        (lie::SE3::exp(kStep * a).adjoint() * b - lie::SE3::exp(-kStep * a).adjoint() * b) /
        (2 * kStep);
    EXPECT_LT((bracket(a, b) - expected).norm(), 1e-8);
    const lie::SE2::Tangent c = a.head<3>(), d = b.head<3>();
    EXPECT_LT((lie::embed(bracket(c, d)) - bracket(lie::embed(c), lie::embed(d))).norm(), 1e-14);
  }
}

TEST(Taper, ItsPolynomialsAreTheEquilibriumOfEveryCrossSection) {
  const Section section =
      test::taperedSection(test::helicalRing(), {0.05, 0.03, 0.025}, {0.0, kTilt, 0.5 * kTilt});
  const TaperOf<lie::SE3> taper(section.actuators);
  ASSERT_EQ(taper.cells(), 2);
  for (int i = 0; i <= 50; ++i) {
    const double s = i / 50.0;
    std::vector<Strand<lie::SE3>> strands;
    for (const Actuator& actuator : section.actuators) {
      strands.push_back({poseAlong(actuator, s), actuator.stiffness.diagonal<lie::SE3>()});
    }
    const Equilibrium<lie::SE3> expected = solveEquilibrium(strands);
    EXPECT_LT((taper.mapAt(s) - expected.map).norm(), 1e-7 * expected.map.norm()) << s;
    EXPECT_LT((taper.complianceAt(s) - expected.compliance).norm(),
              1e-7 * expected.compliance.norm())
        << s;
  }
}

TEST(Taper, ConstantListsHaveTheSameBits) {
  for (const double tilt : {0.0, kTilt}) {
    const test::Ring ring{3, 0.0254, tilt, {100.0, 0.0, 9.8e-5}};
    const Arm plain = test::ringArm(ring);
    const Arm listed({test::taperedSection(ring, {0.0254, 0.0254, 0.0254}, {tilt, tilt, tilt})});
    EXPECT_FALSE(listed.tapered());
    const Eigen::VectorXd q = plain.inputAt(Eigen::VectorXd(Eigen::Vector3d(0.9, 0.1, 0.4)));
    EXPECT_EQ(listed.tip(q).translation, plain.tip(q).translation);
    EXPECT_EQ(listed.tip(q).rotation, plain.tip(q).rotation);
    EXPECT_EQ(listed.twists(q), plain.twists(q));
  }
}

TEST(Taper, TheTipIsThatOfTheIntegratedTwist) {
  for (const double tilt : {0.0, kTilt}) {
    const Section section = test::taperedSection(
        tilt == 0.0 ? test::straightRing() : test::helicalRing(), {0.05, 0.025}, {tilt, tilt});
    const Arm arm({section});
    ASSERT_TRUE(arm.tapered());
    test::Random random(92);
    for (int i = 0; i < 10; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const Eigen::Vector3d expected = tipByMidpoints(section, arm.lengths(q));
      EXPECT_LT((arm.tip(q).translation - expected).norm(), 1e-5 * arm.restLength());
    }
  }
}

TEST(Taper, MagnusStepsConvergeWithOrderFour) {
  for (const double tilt : {0.0, kTilt}) {
    const Section section = test::taperedSection(
        tilt == 0.0 ? test::straightRing() : test::helicalRing(), {0.05, 0.025}, {tilt, tilt});
    const TaperOf<lie::SE3> taper(section.actuators);
    const Arm arm({section});
    const Eigen::VectorXd lengths = arm.lengths(Eigen::Vector3d(3e5, 0, 5e4));
    const auto tipWith = [&](int steps) {
      lie::SE3 X;
      for (int j = 0; j < steps; ++j) {
        X = X * lie::SE3::exp(
                    taper.step(static_cast<double>(j) / steps, (j + 1.0) / steps).twist(lengths));
      }
      return X.translation;
    };
    const Eigen::Vector3d reference = tipWith(64);
    double before = (tipWith(2) - reference).norm();
    EXPECT_GT(before, 1e-6);
    for (const int steps : {4, 8}) {
      const double error = (tipWith(steps) - reference).norm();
      EXPECT_GT(before / error, 12.0) << steps;  // 16 by the order
      EXPECT_LT(before / error, 24.0) << steps;
      before = error;
    }
    EXPECT_LT((reference - tipByMidpoints(section, lengths)).norm(), 1e-8);
  }
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
    const auto product = [](int count, const auto& pieceAt) {
      lie::SE3 X;
      for (int j = 0; j < count; ++j) X = X * lie::SE3::exp(pieceAt(j));
      return X.translation;
    };
    const Eigen::Vector3d truth =
        product(256, [&](int j) { return taper.step(j / 256.0, (j + 1) / 256.0).twist(lengths); });
    std::vector<double> constant, magnus;
    std::printf("%-28s", one.name);
    for (const int count : {1, 2, 4, 8, 16}) {
      const Eigen::Vector3d tip = product(count, [&](int j) {
        return lie::Vector6(twistAt(section, (j + 0.5) / count, lengths) / count);
      });
      constant.push_back(100 * (tip - truth).norm() / arm.restLength());
      std::printf(" %-6.2g", constant.back());
    }
    for (const int count : {1, 2, 4}) {
      const Eigen::Vector3d tip = product(count, [&](int j) {
        return taper.step(static_cast<double>(j) / count, (j + 1.0) / count).twist(lengths);
      });
      magnus.push_back(100 * (tip - truth).norm() / arm.restLength());
      std::printf(" %-6.2g", magnus.back());
    }
    std::printf("\n");
    EXPECT_GT(constant[0], 0.5);
    EXPECT_GT(constant[3], magnus[1]);  // 8 pieces against 2 steps
    EXPECT_LT(magnus[2], 1e-3);
  }
}

TEST(Taper, ShapeTipAndMeanTwistsAgree) {
  Section uniform = test::ringSection(test::helicalRing(), test::fig3Muscle());
  Section tapered = test::taperedSection(test::helicalRing(), {0.04, 0.025}, {kTilt, 0.0});
  tapered.plate = 0.02;
  const Arm arm({tapered, uniform});
  test::Random random(93);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const Shape shape = shapeOf(arm, arm.unloaded(q));
    EXPECT_EQ(shape.piecesPerSection(), arm.piecesPerSection());
    EXPECT_LT((shape.twists() - arm.twists(q)).norm(), 1e-13);
    EXPECT_LT((tipPose(shape).translation - arm.tip(q).translation).norm(), 1e-13);
    EXPECT_LT((arm.tipOfLengths(arm.lengths(q)).translation - arm.tip(q).translation).norm(),
              1e-13);
    EXPECT_LT((arm.twistsOfLengths(arm.lengths(q)) - arm.twists(q)).norm(), 1e-12);
  }
}

TEST(Taper, TheBatchAgreesWithTheTip) {
  const Arm arm = test::taperedArm(kTilt);
  const std::vector<double> one{1e5, 2e5, 0.0}, two{0.0, 3e5, 1e5}, three{4e5, 1e5, 0.0};
  const double* columns[] = {one.data(), two.data(), three.data()};
  Eigen::MatrixX3d tips(3, 3);
  batchTips(arm, columns, 3, tips.col(0).data(), tips.col(1).data(), tips.col(2).data());
  for (int j = 0; j < 3; ++j) {
    EXPECT_EQ(tips.row(j).transpose(),
              arm.tip(Eigen::Vector3d(one[j], two[j], three[j])).translation);
  }
}

TEST(Taper, ThePlaneAgreesWithSpace) {
  const PlanarArm flat = test::taperedPlanarArm(2);
  const Arm arm = embed(flat);
  ASSERT_TRUE(flat.tapered() && arm.tapered());
  test::Random random(94);
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    EXPECT_LT((lie::embed(flat.tip(q)).translation - arm.tip(q).translation).norm(),
              1e-5 * arm.restLength());
    if (flat.piecesPerSection() != arm.piecesPerSection()) continue;
    EXPECT_LT((lie::embed(flat.tip(q)).translation - arm.tip(q).translation).norm(), 1e-9);
  }
}

TEST(Taper, StiffnessKeepsTheSteps) {
  const Arm arm = test::taperedArm();
  const Arm soft = arm.scaledStiffness({1, 1, 0.01});
  EXPECT_EQ(soft.piecesPerSection(), arm.piecesPerSection());
  const Eigen::Vector3d q(3e5, 0, 0);
  EXPECT_GT((soft.tip(q).translation - arm.tip(q).translation).norm(), 1e-3);
}

TEST(Taper, WhatHasNoTaperIsRefused) {
  Section section = test::taperedSection(test::straightRing(), {0.05, 0.025}, {0, 0});
  section.actuators[1].taper.push_back(section.actuators[1].taper.back());
  EXPECT_NE(test::refusal<std::invalid_argument>([&] {
              Arm({section});
            }).find("muscle_2 has 3 poses along the section; expected 2"),
            std::string::npos);
  const Section steep = test::taperedSection(test::straightRing(), {0.05, 1e-4}, {0, 0});
  EXPECT_NE(test::refusal<std::invalid_argument>([&] { Arm({steep}); }).find("too steep"),
            std::string::npos);
}

}  // namespace
}  // namespace helix_arm::model
