#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"
#include "support/allocation_counter.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::dynamics {
namespace {

using basics::kPi;
using lie::SE3;

// The rod of data/dynamics: two sections of 0.3 m, of which each has one actuator on its axis.
struct Rod {
  static constexpr double kRadius = 0.03, kE = 1e6, kG = kE / 3, kLength = 0.3;
  static constexpr double kA = kPi * kRadius * kRadius, kI = kA * kRadius * kRadius / 4;

  static model::Arm arm() {
    const model::Actuator line{"line",
                               {},
                               {kG / kE, 2 * kI * kG / (kE * kA), kI / kA},
                               model::Contraction::table({0, 1e5}, {kLength, 0.99 * kLength}),
                               {0, 1e5}};
    model::Section section;
    section.actuators.push_back(line);
    return model::Arm({section, section});
  }
  static statics::Load load(const Eigen::Vector3d& gravity) {
    return test::evenLoad(2, gravity, 1000 * kA * kLength, kE * kA);
  }
  static MotionConfig config(double step, double damping = 1.0) {
    MotionConfig config;
    config.damping = {damping * 10 / (kE * kA), damping * 10 / (kG * kA),
                      damping * 0.02 / (2 * kI * kG), damping * 0.02 / (kE * kI)};
    config.inertia_radius = kRadius / std::sqrt(2.0);
    config.step = step;
    return config;
  }
};

const Eigen::Vector3d kAcross{0, -9.81, 0}, kAslant{0, -9.81, -9.81};

std::vector<double> every(double interval, double end) {
  std::vector<double> times;
  for (int i = 0; i <= std::lround(end / interval); ++i) times.push_back(i * interval);
  return times;
}

// Tips of the falling rod, straight at first.
std::vector<Eigen::Vector3d> fall(const Eigen::Vector3d& gravity, const MotionConfig& config,
                                  const std::vector<double>& times) {
  const ArmMotion motion(Rod::arm(), std::nullopt, Rod::load(gravity), config);
  InputSeries series{{0.0, times.back()}, Eigen::MatrixXd::Zero(2, 2)};
  std::vector<Eigen::Vector3d> tips;
  motion.follow(series, Start::kStraight, times, [&](std::size_t, const SE3& tip) {
    tips.push_back(tip.translation);
    return true;
  });
  return tips;
}

double rms(const std::vector<Eigen::Vector3d>& one, const std::vector<Eigen::Vector3d>& other) {
  double sum = 0;
  for (std::size_t i = 0; i < one.size(); ++i) sum += (one[i] - other[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(one.size()));
}

// Rows of numbers of a file with comments and a header.
std::vector<std::vector<double>> tableOf(const std::string& path) {
  std::vector<std::vector<double>> rows;
  std::ifstream file(path);
  std::string line, cell;
  for (bool named = false; std::getline(file, line);) {
    if (line[0] == '#') continue;
    std::istringstream cells(line);
    if (named) rows.emplace_back();
    for (; named && std::getline(cells, cell, ',');) rows.back().push_back(std::stod(cell));
    named = true;
  }
  return rows;
}

// [m] of SoRoSim's tip by the table's columns along and across.
double errorAgainst(const std::string& name, const Eigen::Vector3d& gravity, double* peers) {
  const auto rows = tableOf(HELIX_ARM_SOURCE_DIR "/../shared/data/dynamics/" + name);
  if (rows.empty()) return -1;
  std::vector<Eigen::Vector3d> ours, sorosim, soromox;
  std::vector<double> times;
  for (const auto& row : rows) {
    times.push_back(row[0]);
    sorosim.emplace_back(row[1], row[2], 0);
    soromox.emplace_back(row[3], row[4], 0);
  }
  for (const auto& tip : fall(gravity, Rod::config(0.0025), times)) {
    ours.emplace_back(tip.x(), tip.dot(gravity.normalized()), 0);
  }
  *peers = rms(soromox, sorosim);
  return rms(ours, sorosim);
}

TEST(MotionTest, AgreesWithOtherSimulators) {
  for (const auto& [name, gravity] :
       {std::pair{"planar_pcs.csv", kAcross}, {"spatial_pcs.csv", kAslant}}) {
    double peers = 0;
    const double error = errorAgainst(name, gravity, &peers);
    if (error < 0) GTEST_SKIP() << "shared/data/dynamics is absent";
    std::printf("%s: RMS from SoRoSim %.2f mm, SoRoMoX %.2f mm\n", name, 1e3 * error, 1e3 * peers);
    EXPECT_LT(error, 3e-3) << name;
  }
}

TEST(MotionTest, AQuarterOfTheErrorWithHalfTheStep) {
  const auto times = every(0.02, 1.0);
  const auto converged = fall(kAslant, Rod::config(0.0005), times);
  const double coarse = rms(fall(kAslant, Rod::config(0.01), times), converged);
  const double fine = rms(fall(kAslant, Rod::config(0.005), times), converged);
  EXPECT_NEAR(coarse / fine, 4.0, 0.5);
  EXPECT_LT(coarse, 1e-3);
}

TEST(MotionTest, HigherOrdersConvergeToMoreSections) {
  const auto times = every(0.02, 0.6);
  MotionConfig config = Rod::config(0.0025);
  std::vector<std::vector<Eigen::Vector3d>> tips;
  for (config.order = 0; config.order <= kMostOrder; ++config.order) {
    tips.push_back(fall(kAslant, config, times));
  }
  for (int order = 1; order < kMostOrder; ++order) {
    EXPECT_LT(rms(tips[order], tips[4]), 0.25 * rms(tips[order - 1], tips[4])) << order;
  }
  EXPECT_LT(rms(tips[2], tips[4]), 1e-4);
}

// Without damping or load: a rod that was bent, and let go.
TEST(MotionTest, KeepsItsEnergy) {
  const model::Arm arm = Rod::arm();
  const MovingArmOf<SE3> moving(arm, Rod::load(Eigen::Vector3d::Zero()), Rod::config(0.005, 0.0));
  MotionOf<SE3> motion(moving);
  model::Twists bent = arm.twists(Eigen::Vector2d::Zero());
  bent.row(5).setConstant(0.8);
  bent.row(4).setConstant(0.3);
  motion.startStraight(bent);
  const double energy = motion.energy().elastic;
  for (int i = 0; i < 12000; ++i) ASSERT_TRUE(motion.step(0.005, bent)) << i;
  const Energy end = motion.energy();
  EXPECT_GT(end.kinetic, 0.01 * energy);
  EXPECT_NEAR(end.kinetic + end.elastic, energy, 1e-6 * energy);
}

TEST(MotionTest, BalancesEnergyUnderPressuresAndDeadLoads) {
  statics::Load load = test::evenLoad(1, {9.81, 0, 0}, 0.2, 900);
  statics::PointLoad tip;
  tip.mass = 0.05;
  tip.offset = {0.02, 0.01, 0};
  tip.force = {0, 0.3, 0.1};
  tip.moment = {0.01, 0, 0.02};
  load.points = {tip};
  MotionConfig config;
  config.damping = {0.01, 0.01, 0.01, 0.01};
  for (config.order = 0; config.order <= 2; ++config.order) {
    const ArmMotion motion(test::softHelicalArm(), std::nullopt, load, config);
    InputSeries series{{0, 0.2, 0.3, 1.0}, Eigen::MatrixXd::Zero(4, 3)};
    series.input.row(2) << 2e5, 0, 5e4;
    series.input.row(3) << 2e5, 1e5, 0;
    const auto summary = motion.follow(series, Start::kRest, {0.0, 1.0},
                                       [](std::size_t, const SE3&) { return true; });
    const Energy& e = summary.energy;
    EXPECT_NEAR(e.kinetic + e.elastic + e.potential + e.dissipated, e.work, 1e-6 * e.work);
    EXPECT_GT(e.dissipated, 0.01 * e.work);
  }
}

// Small swings about the rest follow the modes of K x = w^2 M x.
TEST(MotionTest, SwingsWithTheFrequenciesOfTheLinearisedArm) {
  const model::Arm arm = Rod::arm();
  const MovingArmOf<SE3> moving(arm, Rod::load(Eigen::Vector3d::Zero()), Rod::config(0.005, 0.0));
  MotionOf<SE3> motion(moving);
  const model::Twists rest = arm.twists(Eigen::Vector2d::Zero());
  motion.startAtRest(rest);
  MovingArmOf<SE3>::Terms terms(moving);
  moving.evaluate(motion.position(), motion.rate(), terms);
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> modes(moving.stiffness(),
                                                                        terms.mass);
  const double w = std::sqrt(modes.eigenvalues()[0]);  // bends about both axes, alike
  Eigen::VectorXd mode = modes.eigenvectors().col(0);
  model::Twists bent = rest - 1e-3 * mode.reshaped(6, 2) / mode.norm();
  motion.startStraight(bent);  // about which it swings
  const double dt = 2 * kPi / w / 400;
  for (int i = 0; i < 400; ++i) ASSERT_TRUE(motion.step(dt, bent));
  moving.setTwists(rest, mode);
  const double swing = (motion.position() - mode).norm();
  EXPECT_LT(swing, 0.01 * 1e-3);  // back after a period; of an error of frequency, 2 pi as much
  for (int i = 0; i < 200; ++i) ASSERT_TRUE(motion.step(dt, bent));
  EXPECT_NEAR((motion.position() - mode).norm(), 2e-3, 2e-5);  // at the far end after half a one
}

TEST(MotionTest, StepsWithoutTheHeap) {
  const model::Arm arm = test::softHelicalArm();
  MotionConfig config;
  config.order = 2;
  const MovingArmOf<SE3> moving(arm, test::evenLoad(1, {0, -9.81, 0}, 0.2, 900), config);
  MotionOf<SE3> motion(moving);
  const model::Twists twists = arm.twists(Eigen::Vector3d{2e5, 0, 0});
  motion.startStraight(arm.twists(Eigen::Vector3d::Zero()));
  const test::AllocationCounter counter;
  for (int i = 0; i < 100; ++i) motion.step(0.0025, twists);
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace helix_arm::dynamics
