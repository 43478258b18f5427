#include "helix_arm/statics/loaded.hpp"

#include <cstdio>
#include <optional>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "support/allocation_counter.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::statics {
namespace {

using model::Twists;

using test::Posture;

model::Arm randomArm(int sections, test::Random& random) {
  std::vector<model::Section> parts;
  for (int k = 0; k < sections; ++k) {
    test::Ring ring;
    ring.count = random.integer(3, 5);
    ring.radius = random.uniform(0.02, 0.05);
    ring.tilt = random.uniform(-0.3, 0.3);
    ring.stiffness = {random.logUniform(10, 100), random.uniform(0, 1e-4),
                      random.uniform(1e-4, 2e-4)};
    parts.push_back(test::ringSection(ring, test::fig3Muscle()));
  }
  return model::Arm(std::move(parts));
}

TEST(Loaded, WithoutLoadItIsTheLinearModel) {
  test::Random random(3);
  for (int i = 0; i < 50; ++i) {
    const int sections = random.integer(1, 4);
    const model::Arm arm = randomArm(sections, random);
    Load load;
    load.mass.assign(sections, 0.2);  // without gravity
    load.K_eps.assign(sections, 1000);
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const lie::SE3 expected = model::tipPose(twists);
    for (int order = kLeastOrder; order <= kMostOrder; ++order) {
      const Solution found = LoadedArm(arm, load, order).solve(twists);
      ASSERT_TRUE(found.converged());
      EXPECT_LT((found.tip.translation - expected.translation).norm(), 1e-12);
      EXPECT_LT((found.tip.rotation - expected.rotation).norm(), 1e-12);
      EXPECT_LT((found.shape.twists() - twists).cwiseAbs().maxCoeff(), 1e-12);
    }
  }
}

TEST(Loaded, EveryOrderComesCloserToShootingThanTheOneBefore) {
  constexpr int kOrders = kMostOrder - kLeastOrder + 1;
  const model::Arm arm = test::softHelicalArm();
  const double length = arm.restLength();
  std::printf("largest error of the tip, %% of length, 45 cases each\n%-12s%10s", "", "linear");
  for (int order = kLeastOrder; order <= kMostOrder; ++order) std::printf("  order %d ", order);
  std::printf("\n");
  for (const Posture posture : {Posture::kHanging, Posture::kHorizontal}) {
    double linear = 0, error[kOrders] = {};
    for (const test::LoadedCase& loaded : test::loadedCases(posture)) {
      const model::Twists twists = arm.twists(loaded.input);
      const Solution truth = ExactArm(arm, loaded.load).solve(twists);
      ASSERT_TRUE(truth.converged());
      const auto errorOf = [&](const lie::SE3& tip) {
        return (tip.translation - truth.tip.translation).norm() / length;
      };
      linear = std::max(linear, errorOf(model::tipPose(twists)));
      for (int i = 0; i < kOrders; ++i) {
        const Tip found = LoadedArm(arm, loaded.load, kLeastOrder + i).tip(twists);
        ASSERT_EQ(found.status, SolveStatus::kConverged);
        error[i] = std::max(error[i], errorOf(found.tip));
      }
    }
    const bool hanging = posture == Posture::kHanging;
    std::printf("%-12s%10.2g", hanging ? "hanging" : "horizontal", 100 * linear);
    for (const double e : error) std::printf("%10.1e", 100 * e);
    std::printf("\n");
    EXPECT_GT(linear, hanging ? 0.02 : 0.05);  // there is something to correct
    EXPECT_LE(error[0], 1e-3);
    EXPECT_LE(error[3], 1e-5);
    for (int i = 1; i < kOrders; ++i) EXPECT_LT(error[i], 0.3 * error[i - 1]) << "order " << i + 2;
  }
}

TEST(Loaded, AgreesWithShootingOnArmsOfAnySectionsAndPoints) {
  test::Random random(5);
  double worst = 0;
  for (int i = 0; i < 60; ++i) {
    const int sections = random.integer(1, 3);
    const model::Arm arm = randomArm(sections, random);
    const Load load = test::randomLoad(sections, random);
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const Solution truth = ExactArm(arm, load).solve(twists);
    const Solution found = LoadedArm(arm, load, kMostOrder).solve(twists);
    ASSERT_TRUE(truth.converged());
    ASSERT_TRUE(found.converged()) << i << ": " << found.residual;
    const double length = arm.restLength();
    EXPECT_GT((truth.tip.translation - model::tipPose(twists).translation).norm(), 1e-4 * length);
    worst = std::max(worst, (found.tip.translation - truth.tip.translation).norm() / length);
    EXPECT_LT((found.tip.rotation - truth.tip.rotation).norm(), 1e-6);
    for (const double s : {0.125, 0.5, 0.875}) {
      EXPECT_LT((poseAt(found.shape, s).translation - poseAt(truth.shape, s).translation).norm(),
                1e-4 * length);
    }
  }
  std::printf("worst of order %d: %.1e of the length\n", kMostOrder, worst);
  EXPECT_LT(worst, 1e-9);
}

TEST(Loaded, TheShapeEndsAtTheTip) {
  test::Random random(7);
  for (int i = 0; i < 20; ++i) {
    const model::Arm arm = randomArm(2, random);
    const Solution found = LoadedArm(arm, test::randomLoad(2, random), 4)
                               .solve(arm.twists(test::randomInput(arm, random)));
    ASSERT_EQ(found.shape.sectionCount(), 2);
    EXPECT_EQ(found.shape.piecesPerSection(), kLoadedPieces);
    const lie::SE3 end = model::tipPose(found.shape);
    EXPECT_LT((end.translation - found.tip.translation).norm(), 1e-12);
    EXPECT_LT((end.rotation - found.tip.rotation).norm(), 1e-12);
  }
}

Load planarLoad() {
  Load load;
  load.gravity = {3.0, -9.0, 0};
  load.mass = {0.1, 0.1};
  load.K_eps = {900, 1100};
  load.points = {{0, 0.4, 0.02, {0, 0.1, 0}, {0, 0, 0.01}, {0.01, -0.02, 0}},
                 {1, 1.0, 0.03, {}, {}, {}}};
  for (PointLoad& point : load.points) {
    if (point.section == 1) point.force = point.moment = point.offset = Eigen::Vector3d::Zero();
  }
  return load;
}

TEST(Loaded, ThePlaneAndSpaceAgreeOnPlanarArms) {
  const model::PlanarArm plane = test::planarArm(2);
  const model::Arm space = model::embed(plane);
  const Load load = planarLoad();
  ASSERT_TRUE(inPlane(load));
  test::Random random(11);
  for (int i = 0; i < 30; ++i) {
    const Eigen::VectorXd q = test::randomInput(space, random);
    for (const int order : {2, 5, 8}) {
      const Solution flat = PlanarLoadedArm(plane, load, order).solve(plane.twists(q));
      const Solution found = LoadedArm(space, load, order).solve(space.twists(q));
      ASSERT_TRUE(flat.converged() && found.converged());
      EXPECT_LT((flat.tip.translation - found.tip.translation).norm(), 1e-10);
      EXPECT_LT((flat.shape.twists() - found.shape.twists()).norm(), 1e-8);
      EXPECT_GT((flat.tip.translation - model::tipPose(space.twists(q)).translation).norm(), 1e-3);
    }
  }
}

TEST(Loaded, KnowsLoadsThatLeaveThePlane) {
  EXPECT_TRUE(inPlane(planarLoad()));
  Load across = planarLoad();
  across.gravity.z() = 1e-3;
  EXPECT_FALSE(inPlane(across));
  across = planarLoad();
  across.points[0].force.z() = 1e-3;
  EXPECT_FALSE(inPlane(across));
  across = planarLoad();
  across.points[0].moment.x() = 1e-3;
  EXPECT_FALSE(inPlane(across));
  across = planarLoad();
  across.points[0].offset.z() = 1e-3;
  EXPECT_FALSE(inPlane(across));
}

TEST(Loaded, TheTipMovesWithTheTwistsAsShootingSays) {
  test::Random random(13);
  for (int i = 0; i < 10; ++i) {
    const model::Arm arm = randomArm(2, random);
    const Load load = test::randomLoad(2, random);
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    Eigen::MatrixXd directions = Eigen::MatrixXd::Random(12, 3);
    const auto J = LoadedArm(arm, load, kMostOrder).tipByUnloaded(twists, directions).by;
    const ExactArm exact(arm, load);
    for (int d = 0; d < 3; ++d) {
      constexpr double kStep = 1e-4;
      const model::Twists change = kStep * directions.col(d).reshaped(6, 2);
      const lie::SE3 above = exact.solve(twists + change).tip,
                     below = exact.solve(twists - change).tip;
      const lie::Vector6 expected = (below.inverse() * above).log() / (2 * kStep);
      EXPECT_LT((J.col(d) - expected).norm(), 1e-5 * expected.norm());
    }
  }
}

TEST(Loaded, TheTipMovesWithTheLoadAsShootingSays) {
  test::Random random(17);
  const model::Arm arm = randomArm(2, random);
  const Load load = test::randomLoad(2, random);
  const model::Twists twists = arm.twists(test::randomInput(arm, random));
  const auto J = LoadedArm(arm, load, kMostOrder).tipByLoad(twists).by;
  ASSERT_EQ(J.cols(), 2 + 2 * 7);
  constexpr double kStep = 1e-3;
  const auto expect = [&](int column, auto&& change) {
    Load above = load, below = load;
    change(above, kStep);
    change(below, -kStep);
    const lie::SE3 a = ExactArm(arm, above).solve(twists).tip,
                   b = ExactArm(arm, below).solve(twists).tip;
    const lie::Vector6 expected = (b.inverse() * a).log() / (2 * kStep);
    EXPECT_GT(expected.norm(), 1e-4) << column;
    EXPECT_LT((J.col(column) - expected).norm(), 1e-4 * expected.norm()) << column;
  };
  expect(0, [](Load& changed, double by) { changed.mass[0] += by; });
  expect(1, [](Load& changed, double by) { changed.mass[1] += by; });
  for (int p = 0; p < 2; ++p) {
    expect(2 + 7 * p, [p](Load& changed, double by) { changed.points[p].mass += by; });
    for (int i = 0; i < 3; ++i) {
      expect(3 + 7 * p + i, [&](Load& changed, double by) { changed.points[p].force[i] += by; });
      expect(6 + 7 * p + i, [&](Load& changed, double by) { changed.points[p].moment[i] += by; });
    }
  }
}

// One centred muscle without torsional stiffness: a moment about its axis meets no resistance.
TEST(Loaded, ReportsLoadsThatNoShapeBalances) {
  model::Section section;
  const model::Contraction muscle = test::fig3Muscle();
  section.actuators = {{"centre", {}, {10, 0, 1e-4}, muscle, muscle.inputRange()}};
  const model::Arm arm({section});
  ASSERT_EQ(arm.equilibrium(0).rank, 5);
  Load load;
  load.mass = {0.0};
  load.K_eps = {1000};
  load.points.resize(1);
  const model::Twists twists = arm.twists(Eigen::VectorXd::Zero(1));
  load.points[0].moment = {1e-3, 0, 0};
  EXPECT_EQ(LoadedArm(arm, load, 5).solve(twists).status, SolveStatus::kUnsupported);
  load.points[0].moment = {0, 1e-3, 0};
  EXPECT_EQ(LoadedArm(arm, load, 5).solve(twists).status, SolveStatus::kConverged);
}

// An arm of a millimetre and its load are differentiated as well as one of metres.
TEST(Loaded, DerivativesByTheLoadScaleWithTheArm) {
  const auto armOf = [](double scale) {
    test::Ring ring;
    ring.radius *= scale;
    ring.stiffness.kappa *= scale * scale;
    const model::Contraction muscle = test::fig3Muscle().scaledBy(scale);
    return model::Arm({test::ringSection(ring, muscle)});
  };
  const auto derivatives = [&](double scale) {
    const model::Arm arm = armOf(scale);
    Load load = test::weight(Posture::kHorizontal, 0.1, 1000);
    load.K_eps[0] *= scale * scale;  // as areas do: forces, too
    load.mass[0] *= scale * scale;
    load.points.resize(1);
    const auto found = LoadedArm(arm, load, 6).tipByLoad(arm.twists(arm.inputAt(0.3)));
    EXPECT_TRUE(found.at.converged());
    return found.by;
  };
  const auto large = derivatives(1.0), small = derivatives(0.002);
  ASSERT_EQ(large.cols(), small.cols());
  for (int i = 0; i < large.cols(); ++i) {
    // A moment is a force times a length; so is, the other way round, the motion of the tip.
    const double column = i < 5 ? std::pow(0.002, 2) : std::pow(0.002, 3);
    lie::Vector6 expected = large.col(i) / column;
    expected.head<3>() *= 0.002;
    EXPECT_LT((small.col(i) - expected).norm(), 1e-5 * expected.norm()) << i;
  }
}

// Exactly straight, so that nothing tells the column which way to go: the straight shape balances
// the load, but does not hold.
TEST(Loaded, APerfectColumnPastItsLoadIsNotCalledBalanced) {
  const model::Arm arm = test::ringArm(test::straightRing());
  const model::Twists twists = arm.twists(arm.inputAt(0.0));
  for (const auto& [mass, holds] : {std::pair{0.02, true}, std::pair{6.0, false}}) {
    Load load = test::weight(Posture::kHanging, 0.0, 500);
    load.gravity = {-test::kGravity, 0, 0};
    load.points.resize(1);
    load.points[0].mass = mass;
    EXPECT_EQ(ExactArm(arm, load).solve(twists).converged(), holds) << mass;
    for (int order = kLeastOrder; order <= kMostOrder; ++order) {
      EXPECT_EQ(LoadedArm(arm, load, order).solve(twists).converged(), holds)
          << mass << " " << order;
    }
  }
}

TEST(Loaded, PlacesThatAreAllButOneAreTwo) {
  const model::Arm arm = test::softHelicalArm();
  Load load = test::weight(Posture::kHorizontal, 0.1, 900);
  load.points.resize(3);
  for (PointLoad& point : load.points) point.mass = 0.02;
  load.points[0].s = 0.3;
  load.points[1].s = std::nextafter(0.3, 1.0);
  load.points[2].s = std::nextafter(1.0, 0.0);
  const model::Twists twists = arm.twists(arm.inputAt(0.4));
  const Solution exact = ExactArm(arm, load).solve(twists);
  const Solution found = LoadedArm(arm, load, kMostOrder).solve(twists);
  ASSERT_TRUE(exact.converged());
  ASSERT_TRUE(found.converged());
  EXPECT_LT((exact.tip.translation - found.tip.translation).norm(), 1e-9);
}

TEST(Loaded, TheLeastOrderIsNotTrustedFarFromItsRegime) {
  const model::Arm arm = test::ringArm(test::straightRing());
  test::Random random(29);
  int refused = 0, taken = 0;
  for (int i = 0; i < 300; ++i) {
    Load load = test::weight(Posture::kHorizontal, random.logUniform(0.05, 10), 552);
    load.gravity = test::kGravity * random.direction<3>();
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const Tip found = LoadedArm(arm, load, kLeastOrder).tip(twists);
    const Solution truth = ExactArm(arm, load).solve(twists);
    if (!found.converged() || !truth.converged()) {
      ++refused;
      continue;
    }
    ++taken;
    EXPECT_LT((found.tip.translation - truth.tip.translation).norm(), 0.02 * arm.restLength());
  }
  EXPECT_GT(refused, 30);
  EXPECT_GT(taken, 100);
}

TEST(Loaded, NeverCallsABadAnswerGood) {
  const model::Arm arm = test::softHelicalArm();
  const double length = arm.restLength();
  test::Random random(19);
  int refused = 0, balanced = 0;
  for (int i = 0; i < 120; ++i) {
    Load load = test::weight(Posture::kHorizontal, random.logUniform(0.1, 50), 500);
    load.gravity = test::kGravity * random.direction<3>();
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const Tip found = LoadedArm(arm, load, 6).tip(twists);
    const Solution truth = ExactArm(arm, load).solve(twists);
    if (found.status != SolveStatus::kConverged) {
      ++refused;
      continue;
    }
    ++balanced;
    EXPECT_TRUE(found.tip.translation.allFinite());
    if (truth.converged()) {
      EXPECT_LT((found.tip.translation - truth.tip.translation).norm(), 0.01 * length) << i;
    }
  }
  EXPECT_GT(refused, 10);
  EXPECT_GT(balanced, 30);
}

TEST(Loaded, FindsTheTipWithoutTheHeap) {
  const model::Arm arm = test::softHelicalArm();
  const LoadedArm loaded(arm, test::weight(Posture::kHorizontal, 0.2, 800), 5);
  const model::Twists twists = arm.twists(arm.inputAt(0.3));
  const lie::SE3 once = loaded.tip(twists).tip;
  const test::AllocationCounter counter;
  const lie::SE3 tip = loaded.tip(twists).tip;
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(tip.translation, once.translation);
}

TEST(Loaded, IsComparedWithAFinerSolutionWithoutTheHeap) {
  test::Ring ring = test::straightRing();
  ring.stiffness.tau = 1e-4;
  const model::Arm arm = test::ringArm(ring);
  Load load = test::weight(Posture::kHanging, 0.0, 900);
  load.points.resize(1);
  load.points[0].force = {-16.75, 0, 0.01};
  const LoadedArm loaded(arm, load, kLeastOrder);
  const model::Twists twists = arm.twists(arm.inputAt(0.0));
  ASSERT_FALSE(loaded.tip(twists).converged());
  const test::AllocationCounter counter;
  loaded.tip(twists);
  EXPECT_EQ(counter.count(), 0u);
}

TEST(Loaded, RefusesWhatItCannotSolve) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = test::weight(Posture::kHanging, 0.2, 800);
  EXPECT_THROW(LoadedArm(arm, load, kLeastOrder - 1), std::invalid_argument);
  EXPECT_THROW(LoadedArm(arm, load, kMostOrder + 1), std::invalid_argument);
  Load crowded = load;
  for (int i = 1; i <= kMaxInnerPoints + 1; ++i) {
    crowded.points.push_back({});
    crowded.points.back().s = i / (kMaxInnerPoints + 2.0);
  }
  EXPECT_THROW(LoadedArm(arm, crowded, 5), std::invalid_argument);
  for (const auto& spoil : std::vector<void (*)(Load&)>{
           [](Load& bad) { bad.mass = {}; },
           [](Load& bad) {
             bad.K_eps = {1000, 1000};
           },
           [](Load& bad) { bad.mass = {-0.1}; }, [](Load& bad) { bad.K_eps = {0.0}; },
           [](Load& bad) { bad.gravity.x() = std::nan(""); },
           [](Load& bad) { bad.points = {{}}, bad.points[0].section = 1; },
           [](Load& bad) { bad.points = {{}}, bad.points[0].s = 1.1; },
           [](Load& bad) { bad.points = {{}}, bad.points[0].mass = -1; }}) {
    Load bad = load;
    spoil(bad);
    EXPECT_THROW(LoadedArm(arm, bad, 5), std::invalid_argument);
  }
}

}  // namespace
}  // namespace helix_arm::statics
