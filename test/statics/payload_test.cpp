// What an arm carries at a place, and whether it holds a shape under a load: against brute force.
#include "helix_arm/statics/payload.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/taper.hpp"
#include "helix_arm/statics/attain.hpp"
#include "statics/arms_under_load.hpp"
#include "support/test_size.hpp"

namespace helix_arm::statics {
namespace {

using lie::SE3;
using lie::Vector6;

// ---- brute force --------------------------------------------------------------------------------

// The definitions, written plainly: the wrench of a section is the derivative of its energy (eq.
// 14) by the twist, the required one the sum of the loads beyond.
class PlainBalance {
 public:
  PlainBalance(const model::Arm& arm, const Load& load, const model::Shape& shape)
      : arm_(arm), load_(load.atEnds(arm.links().get())), shape_(shape) {
    const int per_piece = shape.piecesPerSection() == 1 ? 24 : 1;
    SE3 X;
    for (int j = 0; j < shape.pieces().cols(); ++j) {
      for (int i = 0; i < kFine; ++i) {
        const double t = (i + 0.5) / kFine;
        fine_.push_back({j / shape.piecesPerSection(), sOf(j, t),
                         X * SE3::exp(t * shape.pieces().col(j)), shape.pieces().col(j)});
      }
      for (int i = 0; i < per_piece; ++i) {
        const double t = (i + 0.5) / per_piece;
        places_.push_back({j / shape.piecesPerSection(), sOf(j, t),
                           X * SE3::exp(t * shape.pieces().col(j)), shape.pieces().col(j)});
      }
      X = shape.beyond(X, j);
    }
    for (Place& place : places_) {
      for (int i = arm.firstActuator(place.section); i < arm.firstActuator(place.section + 1);
           ++i) {
        place.seen.push_back(model::poseAlong(arm.actuator(i), place.s).inverse().adjoint());
      }
      place.required = required(place);
      place.norm = stiffness(place).inverse();
      place.norm /= arm.equilibrium(place.section).compliance(0, 0);
    }
  }

  // Root mean square over s of what is missing in section k at inputs of all actuators [N].
  double missing(int k, const Eigen::VectorXd& q) const {
    double sum = 0;
    int count = 0;
    for (const Place& place : places_) {
      if (place.section != k) continue;
      const Vector6 miss = place.required - made(place, q);
      sum += miss.dot(place.norm * miss);
      ++count;
    }
    return std::sqrt(sum / count);
  }

 private:
  static constexpr int kFine = 100;  // of a piece's weight
  struct Place {
    int section;
    double s;
    SE3 X;
    Vector6 piece, required = Vector6::Zero();
    lie::Matrix6 norm = lie::Matrix6::Zero();
    std::vector<lie::Matrix6> seen = {};  // Ad_i^-1
  };

  double sOf(int j, double t) const {
    return (j % shape_.piecesPerSection() + t) / shape_.piecesPerSection();
  }

  double energy(const Place& place, const Vector6& g, const Eigen::VectorXd& q) const {
    const int k = place.section;
    const Eigen::VectorXd own =
        q.segment(arm_.firstActuator(k), arm_.firstActuator(k + 1) - arm_.firstActuator(k));
    double sum = 0;
    for (int i = arm_.firstActuator(k); i < arm_.firstActuator(k + 1); ++i) {
      const model::Actuator& actuator = arm_.actuator(i);
      model::Stiffness K = actuator.stiffness;
      const model::BendingTable& bending = arm_.bending(k);
      if (!bending.empty()) K.kappa *= bending.at(bending.argumentAt(own));
      const double factor = load_.tables.empty() ? 1.0 : load_.tables[k].at(q[i]);
      const Vector6 strain = place.seen[i - arm_.firstActuator(k)] * g -
                             actuator.contraction.length(q[i]) * Vector6::Unit(0);
      sum += factor * strain.cwiseAbs2().dot(K.diagonal<SE3>()) / 2;
    }
    return load_.K_eps[k] / arm_.freeLength(k) * sum;
  }
  // A without factors.
  lie::Matrix6 stiffness(const Place& place) const {
    lie::Matrix6 sum = lie::Matrix6::Zero();
    for (int i = arm_.firstActuator(place.section); i < arm_.firstActuator(place.section + 1);
         ++i) {
      const lie::Matrix6& seen = place.seen[i - arm_.firstActuator(place.section)];
      sum += seen.transpose() * arm_.actuator(i).stiffness.diagonal<SE3>().asDiagonal() * seen;
    }
    return sum;
  }
  // The energy is quadratic, so that differences are exact.
  Vector6 made(const Place& place, const Eigen::VectorXd& q) const {
    const Vector6 g = shape_.piecesPerSection() * place.piece;
    Vector6 out;
    for (int c = 0; c < 6; ++c) {
      const double step = 0.1;
      out[c] = (energy(place, g + step * Vector6::Unit(c), q) -
                energy(place, g - step * Vector6::Unit(c), q)) /
               (2 * step);
    }
    return out;
  }
  Vector6 required(const Place& place) const {
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), moment = Eigen::Vector3d::Zero();
    const auto isBeyond = [&](int section, double s) {
      return section > place.section || (section == place.section && s > place.s);
    };
    const auto add = [&](const Eigen::Vector3d& f, const Eigen::Vector3d& at) {
      force += f;
      moment += (at - place.X.translation).cross(f);
    };
    for (const Place& bit : fine_) {
      if (!isBeyond(bit.section, bit.s)) continue;
      add(load_.mass[bit.section] / (kFine * shape_.piecesPerSection()) * load_.gravity,
          bit.X.translation);
    }
    for (const PointLoad& point : load_.points) {
      if (!isBeyond(point.section, point.s)) continue;
      SE3 X;
      for (int j = 0; j < shape_.pieces().cols(); ++j) {
        const int section = j / shape_.piecesPerSection();
        if (section == point.section && point.s <= sOf(j, 1.0)) {
          const double t = point.s * shape_.piecesPerSection() - j % shape_.piecesPerSection();
          X = X * SE3::exp(t * shape_.pieces().col(j));
          break;
        }
        X = shape_.beyond(X, j);
      }
      add(load_.forceOf(point), X * point.offset);
      moment += point.moment;
    }
    Vector6 out;
    out << place.X.rotation.transpose() * force, place.X.rotation.transpose() * moment;
    return out;
  }

  const model::Arm& arm_;
  const Load load_;
  const model::Shape shape_;
  std::vector<Place> fine_, places_;
};

// Least value over a box by grids of all inputs, each finer about the best of the one before.
double leastOnGrid(const model::Arm& arm, int first, int count, int points, int rounds,
                   const std::function<double(const Eigen::VectorXd&)>& valueOf) {
  Eigen::VectorXd best = arm.inputAt(0.5), middle = best;
  double least = std::numeric_limits<double>::infinity(), width = 0.5;
  for (int round = 0; round < rounds; ++round, width *= 2.0 / (points - 1)) {
    middle = best;
    const int total = static_cast<int>(std::lround(std::pow(points, count)));
    for (int number = 0; number < total; ++number) {
      Eigen::VectorXd q = middle;
      for (int i = 0, rest = number; i < count; ++i, rest /= points) {
        const model::Range& limits = arm.actuator(first + i).limits;
        const double offset = width * (2.0 * (rest % points) / (points - 1) - 1);
        q[first + i] = std::clamp(middle[first + i] + offset * (limits.upper - limits.lower),
                                  limits.lower, limits.upper);
      }
      const double value = valueOf(q);
      if (value < least) {
        least = value;
        best = q;
      }
    }
  }
  return least;
}

// The same for many inputs: one after the other, until none gains. Finds the least of a convex sum
// of squares.
double leastByTurns(const model::Arm& arm, int first, int count,
                    const std::function<double(const Eigen::VectorXd&)>& valueOf) {
  Eigen::VectorXd q = arm.inputAt(0.5);
  double least = valueOf(q);
  for (int turn = 0; turn < 400; ++turn) {
    const double before = least;
    for (int i = first; i < first + count; ++i) {
      const model::Range& limits = arm.actuator(i).limits;
      double width = (limits.upper - limits.lower) * (turn == 0 ? 1.0 : 0.1);
      for (int fine = 0; fine < 9; ++fine, width *= 0.25) {
        const double middle = q[i];
        double best = middle;
        for (int step = -4; step <= 4; ++step) {
          q[i] = std::clamp(middle + width * step / 4, limits.lower, limits.upper);
          const double value = valueOf(q);
          if (value < least) {
            least = value;
            best = q[i];
          }
        }
        q[i] = best;
      }
    }
    if (before - least < 1e-7 * before) break;
  }
  return least;
}

// ---- cases --------------------------------------------------------------------------------------

// Planar, spatial, helical, tapered, of two sections, with 2 to 8 muscles in each.
model::Arm someArm(int number, test::Random& random) {
  test::Ring ring = test::straightRing(random.integer(3, 8));
  ring.radius = random.uniform(0.02, 0.05);
  ring.stiffness.kappa = random.uniform(1e-4, 2e-4);
  switch (number % 5) {
    case 0:
      return model::embed(test::planarArm());
    case 1:
      return test::ringArm(ring);
    case 2:
      ring.tilt = random.uniform(-0.3, 0.3);
      ring.stiffness.gamma = random.logUniform(10, 100);
      return test::ringArm(ring);
    case 3:
      return model::Arm({test::taperedSection(
          ring, {ring.radius, random.uniform(0.5, 0.9) * ring.radius}, {0.0, 0.0})});
    default:
      ring.count = 3;
      return test::ringArm(ring, 2);
  }
}

Load someLoad(const model::Arm& arm, double force, test::Random& random) {
  Load load = test::evenLoad(arm.sectionCount(), test::kGravity * random.direction<3>(),
                             random.uniform(0, 0.1), random.uniform(500, 1500));
  PointLoad tip;
  tip.section = arm.sectionCount() - 1;
  tip.force = force * random.direction<3>();
  load.points = {tip};
  return load;
}

ArmModel loadedModel(const model::Arm& arm, const Load& load) {
  return {arm, std::nullopt, load, TierSetting{Tier::kLoaded, 5}};
}

// ---- attain -------------------------------------------------------------------------------------

// Half of the shapes are those of the loaded arm at some inputs, most of them under another load.
TEST(Attain, AgreesWithBruteForceOnRandomArms) {
  test::Random random(531);
  int attainable = 0, counted = 0;
  const int cases = test::draws(30, 1000);
  for (int number = 0; number < cases; ++number) {
    const model::Arm arm = someArm(number, random);
    Load load = someLoad(arm, random.uniform(0, 3), random);
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const Solution held = loadedModel(arm, load).solve(q);
    if (!held.converged()) continue;
    const model::Shape shape =
        number % 2 == 0 ? held.shape : model::shapeOf(arm, held.shape.twists());
    if (number % 4 == 2) load.points[0].force += random.uniform(0, 60) * random.direction<3>();
    const AttainSolver solver(arm, load);
    const Attainment found = solver.attain(shape);
    const PlainBalance plain(arm, load, shape);
    double least = 0;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      least = std::max(least, leastByTurns(arm, arm.firstActuator(k),
                                           arm.firstActuator(k + 1) - arm.firstActuator(k),
                                           [&](const auto& p) { return plain.missing(k, p); }));
    }
    const double near = 1e-3 * solver.largestForce();
    EXPECT_NEAR(found.residual, least, near) << "case " << number;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      EXPECT_TRUE(arm.actuator(i).limits.contains(found.input[i]));
    }
    const double border = AttainSolver::kUsualTolerance * solver.largestForce();
    if (std::abs(least - border) <= near) continue;
    ++counted;
    attainable += found.attainable;
    EXPECT_EQ(found.attainable, least <= border) << "case " << number;
  }
  EXPECT_GT(counted, 0.8 * cases);
  EXPECT_GT(attainable, 0.2 * counted);
  EXPECT_LT(attainable, 0.8 * counted);
}

// With tables the forces are not monotone in the pressures: the whole grid decides.
TEST(Attain, AgreesWithAGridWhereStiffnessDependsOnPressure) {
  test::Random random(532);
  const int cases = test::draws(8, 200);
  for (int number = 0; number < cases; ++number) {
    model::Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
    if (number % 2 == 0) section.bending = StiffnessTable{{0, test::kMaxPressure}, {1, 3}};
    const model::Arm arm({section});
    Load load = someLoad(arm, random.uniform(0, 3), random);
    load.tables = {kTable};
    const Solution held = loadedModel(arm, load).solve(test::randomInput(arm, random));
    if (!held.converged()) continue;
    if (number % 4 >= 2) load.points[0].force += random.uniform(0, 60) * random.direction<3>();
    const AttainSolver solver(arm, load);
    const Attainment found = solver.attain(held.shape);
    const PlainBalance plain(arm, load, held.shape);
    const double least =
        leastOnGrid(arm, 0, 3, 13, 5, [&](const auto& p) { return plain.missing(0, p); });
    EXPECT_LT(found.residual, least + 1e-3 * solver.largestForce()) << "case " << number;
    EXPECT_NEAR(plain.missing(0, found.input), found.residual, 1e-6 * solver.largestForce());
  }
}

// ---- payload ------------------------------------------------------------------------------------

Load pushedAtTip(const ArmModel& model, const Eigen::Vector3d& force) {
  Load load = *model.load();
  PointLoad point;
  point.section = model.arm().sectionCount() - 1;
  point.offset = model.arm().link(point.section).translation;
  point.force = force;
  load.points.push_back(point);
  return load;
}

// The exact tier has a stable shape under the force, with the tip at its place.
void expectHeldExactly(const PayloadSolver& solver, const Payload& found,
                       const Eigen::Vector3d& direction, const Eigen::Vector3d& tip, int number) {
  const Tip held =
      ArmModel(solver.model().arm(), std::nullopt,
               pushedAtTip(solver.model(), found.force * direction), TierSetting{Tier::kExact, 0})
          .tip(found.input);
  EXPECT_TRUE(held.converged()) << "case " << number << ", " << nameOf(found.end);
  EXPECT_LT((held.tip.translation - tip).norm(), 1.02 * solver.positionTolerance())
      << "case " << number << ", " << nameOf(found.end);
}

// Largest force by bisection over grids of pressures.
double payloadByGrid(const ArmModel& model, const Eigen::Vector3d& tip,
                     const Eigen::Vector3d& direction, double tolerance, double start, int points) {
  const model::Arm& arm = model.arm();
  const auto holds = [&](double force) {
    const ArmModel pushed = loadedModel(arm, pushedAtTip(model, force * direction));
    return leastOnGrid(arm, 0, arm.actuatorCount(), points, 7, [&](const auto& q) {
             const Tip found = pushed.tip(q);
             return found.converged() ? (found.tip.translation - tip).norm() : 1e3;
           }) <= tolerance;
  };
  double held = 0, beyond = 1.3 * start;
  while (holds(beyond)) held = std::exchange(beyond, 1.5 * beyond);
  while (beyond - held > 2e-3 * beyond) {
    const double middle = 0.5 * (held + beyond);
    (holds(middle) ? held : beyond) = middle;
  }
  return held;
}

TEST(Payload, IsWithinOnePercentOfBruteForce) {
  test::Random random(533);
  const int cases = test::draws(6, 250);
  int counted = 0, within = 0;
  for (int number = 0; number < cases; ++number) {
    const bool planar = number % 3 == 0;
    test::Ring ring = number % 3 == 1 ? test::straightRing() : test::helicalRing();
    ring.radius = random.uniform(0.02, 0.05);
    const model::Arm arm =
        planar ? model::embed(test::planarArm())
        : number % 9 == 8
            ? model::Arm({test::taperedSection(ring, {ring.radius, 0.6 * ring.radius}, {0.0, 0.1})})
            : test::ringArm(ring);
    Load load = someLoad(arm, 0, random);
    if (number % 9 < 2) load.tables = {kTable};
    const ArmModel model = loadedModel(arm, load);
    const Tip place = model.tip(test::randomInput(arm, random));
    if (!place.converged()) continue;
    PayloadSolver solver(model);
    solver.moveTo(place.tip.translation);
    Eigen::Vector3d direction = random.direction<3>();
    if (planar) direction = Eigen::Vector3d(direction.x(), direction.y(), 0).normalized();
    const Payload found = solver.along(direction);
    if (found.end == PayloadEnd::kUnreached) continue;
    const double expected = payloadByGrid(model, place.tip.translation, direction,
                                          solver.positionTolerance(), found.force, planar ? 15 : 9);
    ++counted;
    EXPECT_GT(found.force, 0.99 * expected) << "case " << number << ", " << nameOf(found.end);
    // A grid may miss a narrow range of stable shapes.
    expectHeldExactly(solver, found, direction, place.tip.translation, number);
    within += found.force < 1.01 * expected;
  }
  EXPECT_GT(counted, 0.8 * cases);
  EXPECT_GE(within, test::leastOf(counted, 0.9));
}

// The exact tier confirms what is held; the inverse from all its starts holds no more; the named
// limits are met.
TEST(Payload, IsHeldInTheExactTierAndNoMoreIsByTheInverse) {
  test::Random random(534);
  const int cases = test::draws(12, 200);
  int ended_by_limits = 0, without_stiffness = 0;
  for (int number = 0; number < cases; ++number) {
    const model::Arm arm = someArm(number, random);
    const ArmModel model = loadedModel(arm, someLoad(arm, 0, random));
    const Tip place = model.tip(test::randomInput(arm, random));
    if (!place.converged()) continue;
    PayloadSolver solver(model);
    solver.moveTo(place.tip.translation);
    const Eigen::Vector3d direction = random.direction<3>();
    const Payload found = solver.along(direction);
    if (found.end == PayloadEnd::kUnreached) continue;
    const std::string which = "case " + std::to_string(number) + ", " + nameOf(found.end);
    expectHeldExactly(solver, found, direction, place.tip.translation, number);
    InverseOptions options;
    options.position_tolerance = solver.positionTolerance();
    InverseSolver inverse(loadedModel(arm, pushedAtTip(model, 1.05 * found.force * direction)),
                          options);
    EXPECT_NE(inverse.toPosition(place.tip.translation, found.input).status,
              InverseStatus::kReached)
        << which;
    const bool named = std::any_of(found.limits.begin(), found.limits.end(),
                                   [](Limit limit) { return limit != Limit::kNone; });
    EXPECT_EQ(named, found.end == PayloadEnd::kLimits);
    for (int i = 0; i < arm.actuatorCount() && named; ++i) {
      const model::Range& limits = arm.actuator(i).limits;
      if (found.limits[i] == Limit::kNone) continue;
      const double at = found.limits[i] == Limit::kUpper ? limits.upper : limits.lower;
      EXPECT_NEAR(found.input[i], at, 0.05 * (limits.upper - limits.lower)) << which;
    }
    ended_by_limits += found.end == PayloadEnd::kLimits;
    const bool stiff = found.stiffness > 0;
    EXPECT_TRUE(stiff || found.end == PayloadEnd::kUnstable) << which;
    without_stiffness += !stiff;
  }
  EXPECT_GT(ended_by_limits, 0.5 * cases);
  EXPECT_LE(without_stiffness, test::mostOf(cases, 0.03));
}

// A slender column that is pushed along itself buckles long before a muscle is at its limit.
TEST(Payload, PushThatBucklesTheArmIsCalledUnstable) {
  const model::Arm arm = test::ringArm(test::straightRing());
  PayloadSolver solver(loadedModel(arm, test::weightless(1, 900)));
  solver.moveTo({0.95 * arm.restLength(), 0, 0});
  const Payload found = solver.along({-2, 0, 0});
  EXPECT_EQ(found.end, PayloadEnd::kUnstable);
  // Euler: pi^2 B / (4 L^2), B = K_eps sum (K_kappa + y^2), less what it is shortened.
  const double B = 900 * 3 * (1.38e-4 + 0.5 * 0.0254 * 0.0254);
  const double euler = std::pow(test::kPi / 2 / arm.restLength(), 2) * B;
  EXPECT_NEAR(found.force, euler, 0.25 * euler);
}

}  // namespace
}  // namespace helix_arm::statics
