// Arms at the ends of their parameters: unloaded ones against their definitions in 80 digits,
// loaded ones against the exact tier.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/high_precision_arm.hpp"
#include "support/loaded_arm.hpp"
#include "support/random.hpp"
#include "support/test_size.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;
using namespace model;
using namespace test;

// Whatever an arm may be built with.
struct Build {
  Ring ring;
  int sections = 1;
  double length = 0.43;  // of a muscle at rest [m]

  Arm arm() const {
    const Contraction muscle = fig3Muscle();
    return Arm(std::vector<Section>(
        sections, ringSection(ring, muscle.scaledBy(length / muscle.restLength()))));
  }
  std::string name() const {
    char out[200];
    std::snprintf(out, sizeof out,
                  "%d sections of %d, %.3g m long, radius %.3g m, tilt %.2g, K %.3g %.3g %.3g",
                  sections, ring.count, length, ring.radius, ring.tilt, ring.stiffness.gamma,
                  ring.stiffness.tau, ring.stiffness.kappa);
    return out;
  }
};

// Arms that leave the ordinary in one respect.
struct BuildFamily {
  const char* range;
  std::vector<Build> builds;
};

std::vector<BuildFamily> extremeBuilds() {
  constexpr double kTilt = 15 * kPi / 180;
  const Build helical{helicalRing()}, straight{straightRing()};
  std::vector<BuildFamily> all;
  const auto family = [&all](const char* range) -> std::vector<Build>& {
    all.push_back({range, {}});
    return all.back().builds;
  };
  const auto vary = [&](std::vector<Build>& builds, const std::vector<double>& values,
                        auto&& change) {
    for (const Build& usual : {straight, helical}) {
      for (const double value : values) {
        builds.push_back(usual);
        change(builds.back(), value);
      }
    }
  };
  vary(family("diameters 1e-4 to 1 m"), {1e-4, 3e-4, 1e-3, 1e-2, 0.1, 1.0},
       [](Build& build, double diameter) { build.ring.radius = diameter / 2; });
  vary(family("diameters 1e-4 to 1 m, as soft to bend"), {1e-4, 3e-4, 1e-3, 1e-2, 0.1, 1.0},
       [](Build& build, double diameter) {
         build.ring.radius = diameter / 2;
         build.ring.stiffness.kappa = 1e-2 * diameter * diameter;
       });
  vary(family("K_kappa 0 and 1e-12 to 1e2"), {0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e2},
       [](Build& build, double kappa) { build.ring.stiffness.kappa = kappa; });
  vary(family("K_gamma 1 to 1e12"), {1.0, 10.0, 1e3, 1e6, 1e9, 1e12},
       [](Build& build, double gamma) { build.ring.stiffness.gamma = gamma; });
  vary(family("K_tau 0 and 1e-12 to 1e2"), {0.0, 1e-12, 1e-6, 1.0, 1e2},
       [](Build& build, double tau) { build.ring.stiffness.tau = tau; });
  vary(family("1 to 24 muscles"), {1, 2, 3, 4, 5, 6, 7, 8, 11, 16, 23, 24},
       [](Build& build, double count) {
         build.ring.count = static_cast<int>(count);
         build.ring.stiffness.tau = 1e-5;  // or one muscle spins about its own axis
       });
  vary(family("1 to 16 sections"), {1, 2, 3, 4, 6, 8, 12, 15, 16},
       [](Build& build, double sections) { build.sections = static_cast<int>(sections); });
  vary(family("lengths 1e-3 to 10 m"), {1e-3, 1e-2, 0.1, 1.0, 10.0},
       [](Build& build, double length) { build.length = length; });
  vary(family("lengths 1e-3 to 10 m, of one form"), {1e-3, 1e-2, 0.1, 1.0, 10.0},
       [](Build& build, double length) {
         const double scale = length / build.length;
         build.length = length;
         build.ring.radius *= scale;
         build.ring.stiffness.kappa *= scale * scale;
       });
  Random random(701);
  std::vector<Build>& any = family("all of it at once");
  for (int i = 0; i < 60; ++i) {
    Build build;
    build.ring.count = random.integer(3, 24);
    build.ring.radius = random.logUniform(5e-5, 0.5);
    build.ring.tilt = random.uniform(-kTilt, kTilt);
    build.ring.stiffness = {random.logUniform(1, 1e12),
                            random.integer(0, 1) * random.logUniform(1e-12, 1e2),
                            random.logUniform(1e-12, 1e2)};
    build.sections = random.integer(1, 16);
    build.length = random.logUniform(1e-3, 10);
    any.push_back(build);
  }
  return all;
}

// One row of the table of extremes: many cases of one kind, of which the worst is printed.
class Family {
 public:
  // @param bound  of the error, in the unit that it names.
  Family(std::string range, double bound, std::string unit)
      : range_(std::move(range)), bound_(bound), unit_(std::move(unit)) {}
  Family(const Family&) = delete;
  Family& operator=(const Family&) = delete;
  // Prints the line. A family without a case proves nothing.
  ~Family() {
    std::printf("%-52s %6d cases   worst %8.2g of %8.2g %-22s %s\n", range_.c_str(), cases_, worst_,
                bound_, unit_.c_str(), place_.c_str());
    EXPECT_GT(cases_, 0) << range_;
  }

  // @param place  names the case.
  void add(double error, const std::string& place) {
    ++cases_;
    EXPECT_LE(error, bound_) << range_ << ": " << place;
    if (error > worst_ || !(error == error)) {
      worst_ = error;
      place_ = place;
    }
  }
  int cases() const { return cases_; }

 private:
  std::string range_;
  double bound_;
  std::string unit_;
  int cases_ = 0;
  double worst_ = 0.0;
  std::string place_;
};

// printf into a string.
template <class... Values>
std::string text(const char* format, Values... values) {
  char out[200];
  std::snprintf(out, sizeof out, format, values...);
  return out;
}

// ---- Without load -------------------------------------------------------------------------------

double lengthOf(const Twists& twists) {
  double length = 0;
  for (int k = 0; k < twists.cols(); ++k) length += twists.col(k).head<3>().stableNorm();
  return length;
}
double turnOf(const Twists& twists) {
  double turn = 0;
  for (int k = 0; k < twists.cols(); ++k) turn += twists.col(k).tail<3>().stableNorm();
  return turn;
}

// How far the muscles of an arm would turn it, pulling one by one: what cancels where it is
// straight [rad].
double effortOf(const Arm& arm, const Eigen::VectorXd& q) {
  const Eigen::VectorXd lengths = arm.lengths(q);
  double effort = 0;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    effort += turnOf(arm.twistsOfLengths(lengths[i] * Eigen::VectorXd::Unit(lengths.size(), i)));
  }
  return effort;
}

// Error of a pose, its place by the arm's length, in eps for each radian of `turn`.
double poseError(const lie::SE3& X, const RealMatrix& reference, double length, double turn) {
  const double rotation = worstEps(X.rotation, reference.topLeftCorner(3, 3));
  const RealMatrix miss = X.translation.cast<Real>() - reference.topRightCorner(3, 1);
  const double place = static_cast<double>(Real(miss.norm() / length / kEps));
  return std::max(rotation, place) / (1 + turn);
}

constexpr double kForwardEps = 16;
constexpr const char* kUnit = "eps a radian";

// @param lever  at which the only muscle sits: it turns the arm by its length over that, but for
// what the least norm takes away; 0 where others hold it [m].
void expectForward(const BuildFamily& family, const RealMatrix& N, int rank, double lever = 0) {
  Family curves(std::string("curve, ") + family.range, kForwardEps, kUnit);
  Family tips(std::string("tip, ") + family.range, kForwardEps, kUnit);
  Random random(702);
  int number = 0;
  for (const Build& build : family.builds) {
    if (!isDrawn(number++, 4)) continue;
    const Arm arm = build.arm();
    for (int k = 0; k < arm.sectionCount(); ++k) {
      ASSERT_EQ(arm.equilibrium(k).rank, rank) << build.name();
    }
    for (int i = 0; i < 6; ++i) {
      const Eigen::VectorXd q = i < 2 ? arm.inputAt(i) : randomInput(arm, random);
      const Twists twists = arm.twists(q);
      const RealMatrix expected = twistsByDefinition(arm, q, N);
      const double length = lengthOf(twists);
      const double effort = lever > 0 ? length / lever : effortOf(arm, q);
      tips.add(
          poseError(arm.tip(q), poseByDefinition(expected, arm.sectionCount()), length, effort),
          build.name());
      if (i < 4) continue;
      for (const double s : {random.uniform(0, arm.sectionCount()), 1.0}) {
        curves.add(poseError(poseAt(twists, s), poseByDefinition(expected, s), length, effort),
                   text("s = %.17g, %s", s, build.name().c_str()));
      }
    }
  }
}

TEST(Extremes, ForwardOfWholeArms) {
  for (const BuildFamily& family : extremeBuilds()) {
    expectForward(family, RealMatrix::Zero(6, 0), 6);
  }
}

TEST(Extremes, ForwardOfArmsThatAMotionCostsNothing) {
  std::vector<Build> centred, bare, aside;
  for (const int sections : {1, 4, 16}) {
    for (const double gamma : {1.0, 10.0, 1e12}) {
      for (const double length : {1e-3, 0.43, 10.0}) {
        centred.push_back({{1, 0.0, 0.0, {gamma, 0.0, 1e-4}}, sections, length});
        bare.push_back({{1, 0.0, 0.0, {gamma, 0.0, 0.0}}, sections, length});
        aside.push_back({{1, 0.0254, 0.0, {gamma, 0.0, 1e-4}}, sections, length});
      }
    }
  }
  RealMatrix turns = RealMatrix::Zero(6, 3), spin = RealMatrix::Zero(6, 1);
  turns.bottomRows(3).setIdentity();
  expectForward({"one centred muscle, K_tau = 0, rank 5", centred}, turns.leftCols(1), 5);
  expectForward({"one centred muscle, K_tau = K_kappa = 0, rank 3", bare}, turns, 3);
  // About the muscle's own axis: v = p x w.
  spin(2, 0) = -Real(0.0254);
  spin(3, 0) = 1;
  expectForward({"one muscle aside, K_tau = 0, rank 5", aside}, spin / spin.norm(), 5, 0.0254);
}

// ---- Under load ---------------------------------------------------------------------------------

// Weight and a tip load that bend the arm by about 0.3 rad, or stretch or shear it by a tenth.
Load fittingLoad(const Arm& arm, Random& random) {
  constexpr double kStiffness = 1000.0, kBend = 0.3, kStretch = 0.1;
  double bend = 0, stretch = 0;
  const double length = arm.restLength();
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const lie::Matrix6 C = arm.freeLength(k) / kStiffness * arm.equilibrium(k).compliance;
    bend += C.bottomRightCorner<3, 3>().norm();
    stretch += C.topLeftCorner<3, 3>().norm();
  }
  const double force = std::min(kBend / (bend * length), kStretch * length / stretch);
  Load load = evenLoad(arm.sectionCount(), kGravity * random.direction<3>(),
                       force / kGravity / arm.sectionCount(), kStiffness);
  PointLoad tip{arm.sectionCount() - 1};
  tip.force = 0.3 * force * random.direction<3>();
  tip.moment = 0.1 * force * length * random.direction<3>();
  load.points = {tip};
  return load;
}

double largestTurnOf(const Twists& twists) {
  return twists.bottomRows<3>().colwise().norm().maxCoeff();
}

TEST(Extremes, LoadedArmsAgreeWithTheExactOnes) {
  constexpr double kMostTurn = 2 * kPi;  // of a section, that order 8 is meant for
  for (const BuildFamily& family : extremeBuilds()) {
    Family tips(std::string("order 8, ") + family.range, 1e-7, "of the length");
    Random random(802);
    int curled = 0, refused = 0, moved = 0;
    for (const Build& build : family.builds) {
      const Arm arm = build.arm();
      const Load load = fittingLoad(arm, random);
      const ExactArm exact(arm, load);
      const LoadedArm loaded(arm, load, kMostOrder);
      for (int i = 0; i < 3; ++i) {
        const Twists twists = arm.twists(randomInput(arm, random));
        if (largestTurnOf(twists) > kMostTurn) {
          ++curled;
          continue;
        }
        const Solution truth = exact.solve(twists), found = loaded.solve(twists);
        EXPECT_TRUE(truth.converged()) << build.name();
        refused += !found.converged();
        if (!truth.converged() || !found.converged()) continue;
        const double length = arm.restLength();
        moved += (truth.tip.translation - tipPose(twists).translation).norm() > 1e-3 * length;
        tips.add((found.tip.translation - truth.tip.translation).norm() / length, build.name());
        EXPECT_LT((tipPose(found.shape).translation - found.tip.translation).norm(), 1e-9 * length);
      }
    }
    std::printf("  %d curl up too far, %d refused, %d moved by more than 0.1 %%\n", curled, refused,
                moved);
    EXPECT_GT(moved, tips.cases() / 2) << family.range;
    EXPECT_LT(refused, tips.cases() / 4) << family.range;
  }
}

// A column along x that hardly shortens or shears, pressed at its tip or by its own weight: Euler
// and Greenhill say where the exact tier's shape leaves the axis, and orders find that shape or say
// that they did not.
TEST(Buckling, ColumnsGiveWayAtTheirCriticalLoadsAndTiersFindTheStableShapeOrSayThatTheyDidNot) {
  const Ring ring{3, 1e-3, 0.0, {1e4, 1e-5, 1e-5}};
  constexpr double kEps_N = 1000.0;  // K_eps
  ExactOptions patient;              // from straight to bent is a sharp turn
  patient.max_iterations = 500;
  Random random(801);
  for (const auto& [name, by_weight, sections] :
       {std::tuple{"pressed at its tip", false, 1},
        {"under its own weight", true, 1},
        {"of 3 sections, under its own weight", true, 3}}) {
    const Arm arm = ringArm(ring, sections);
    const Twists straight = arm.twists(arm.inputAt(0));
    const double length = sections * arm.freeLength(0);
    const double EI = kEps_N * 3 * (ring.stiffness.kappa + 0.5 * ring.radius * ring.radius);
    const double critical = (by_weight ? 7.837 : kPi * kPi / 4) * EI / (length * length);
    int found_under = 0, refused_past = 0;
    for (const double share : {0.5, 0.8, 0.95, 0.99, 1.01, 1.05, 1.2, 1.5, 2.0}) {
      const double force = share * critical, angle = random.uniform(0, 2 * kPi);
      Load load = evenLoad(sections, {-kGravity, 0, 0},
                           by_weight ? force / kGravity / sections : 0.0, kEps_N);
      load.points.assign(1, PointLoad{sections - 1});
      load.points[0].force =
          force * Vector3d(by_weight ? 0 : -1, 1e-4 * std::cos(angle), 1e-4 * std::sin(angle));
      const Solution truth = ExactArm(arm, load, patient).solve(straight);
      ASSERT_TRUE(truth.converged()) << name << " " << share;
      const double swing = truth.tip.translation.tail<2>().norm() / arm.restLength();
      EXPECT_TRUE(share < 1 ? swing < 0.05 : swing > 0.1) << name << " " << share << ": " << swing;
      for (int order = kLeastOrder; order <= kMostOrder; ++order) {
        const Solution found = LoadedArm(arm, load, order).solve(straight);
        found_under += share < 1 && found.converged();
        refused_past += share > 1 && !found.converged();
        const double off = (found.tip.translation - truth.tip.translation).norm();
        EXPECT_TRUE(!found.converged() || off < 1e-2 * arm.restLength()) << order << " " << share;
      }
    }
    EXPECT_GT(found_under, 21) << name << ": of 4 shares in 7 orders";
    EXPECT_GT(refused_past, 0) << name;
  }
}

}  // namespace
}  // namespace helix_arm::statics
