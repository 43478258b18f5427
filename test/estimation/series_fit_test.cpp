// Fits of an arm to motions of its tip. The truth shares no code with the model: closed form of a
// constant curvature, muscles stepped in small times.
#include "helix_arm/calibration/series_fit.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "support/random.hpp"
#include "support/test_size.hpp"

namespace helix_arm::estimation {
namespace {

using basics::kPi;
using test::Random;
constexpr double kMost = 200e3;                    // [Pa]
constexpr double kRadius = 0.03, kBeam = 1.15e-3;  // of the chambers [m], and 3 K_kappa [m^2]
constexpr int kTrials = 6;
const int kRows = test::draws(100, 400), kHold = test::draws(25, 50);  // of a trial, of a step
const double kSpacing = 40.0 / kRows;                                  // [s]
constexpr double kNoise = 0.0005, kTurnNoise = 0.005;                  // [m], [rad]

const char* const kResponse[] = {"rise_time_constant", "fall_time_constant", "slow_time_constant",
                                 "slow_weight"};
const char* const kBase[] = {"base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz"};

struct Truth {
  double rise = 0, fall = 0;                           // [s]
  double slow_time = 1, slow_weight = 0;               // [s]
  double second_weight = 0;                            // of a creep of 60 s that no fit has
  double correlated = 0;                               // noise over 2 s [m]
  double offset = 0.0;                                 // standard deviation from trial to trial [m]
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();  // of the base, seen from the frame F
  Eigen::Vector3d place{0.1, -0.2, 0.3};               // [m]
  Eigen::Vector3d stroke{1, 1, 1};                     // factors on those of the chambers
  double others = 0;      // of the stiffness against bending, for the most pressure in all but one
  double phase = 0;       // of the ring about the axis of the base [rad]
  bool oriented = false;  // the series has orientations
  Eigen::Matrix3d body = Eigen::Matrix3d::Identity();  // of what has them, seen from the tip
  double growth = 0;                         // as others, for the most pressure in all chambers
  Eigen::Vector3d own_phase{0, 0, 0};        // of each chamber, beside its even place [rad]
  std::optional<Eigen::Vector2d> beam = {};  // its slopes in y and z of the tip: x, y are a dot's
};

Eigen::Vector3d normals(Random& random) {
  return {random.normal(), random.normal(), random.normal()};
}

double angleOf(int i) { return 2 * kPi * i / 3; }

// Three chambers of 0.2 m that lengthen by up to 40 mm, at 30 mm from the axis.
double trueLength(double p) {
  const double u = p / kMost;
  return 0.2 + 0.04 * u * (0.7 + 0.3 * u);
}

Eigen::Matrix3d about(const Eigen::Vector3d& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

lie::SE3 trueTip(const Eigen::Vector3d& effective, const Truth& truth) {
  double others = 0;  // mean of the others, weighted by each one's own
  for (int i = 0; i < 3; ++i) {
    others += effective[i] * (effective.sum() - effective[i]) / 2 / std::max(effective.sum(), 1.0);
  }
  const double stiffer = 1 + (truth.growth * effective.mean() + truth.others * others) / kMost;
  // Length of the axis and bends of least energy of three springs and a beam.
  Eigen::Matrix3d stiffness = Eigen::Vector3d(0, 1, 1).asDiagonal() * kBeam;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  for (int i = 0; i < 3; ++i) {
    const double rest = trueLength(0),
                 one = rest + truth.stroke[i] * (trueLength(effective[i]) - rest);
    const double angle = angleOf(i) + truth.own_phase[i];
    const Eigen::Vector3d arm(1, kRadius * std::cos(angle), kRadius * std::sin(angle));
    stiffness += arm * arm.transpose();
    force += arm * one;
  }
  stiffness.bottomRightCorner<2, 2>() *= stiffer;
  const Eigen::Vector3d shape = stiffness.inverse() * force;
  const double length = shape[0], y = shape[1], z = shape[2];
  const double bend = std::max(std::hypot(y, z), 1e-9);
  // A chamber that lengthens bends the arm away from it.
  const double across = -length * (1 - std::cos(bend)) / bend;
  return {about({0, z / bend, -y / bend}, bend),
          {length * std::sin(bend) / bend, across * y / bend, across * z / bend}};
}

TipSeries seriesOf(const Truth& truth, int seed) {
  Random random(seed);
  TipSeries out;
  out.history.input.resize(kTrials * kRows, 3);
  out.position.resize(kTrials * kRows, 3);
  const Eigen::Matrix3d turn = about(Eigen::Vector3d::UnitX(), truth.phase);
  for (int trial = 0; trial < kTrials; ++trial) {
    Eigen::Vector3d p = Eigen::Vector3d::Zero(), lagged = p, slow = p, slower = p, error = p;
    const Eigen::Vector3d offset = normals(random);
    for (int k = 0; k < kRows; ++k) {
      const int row = trial * kRows + k;
      if (k > 0 && k % kHold == 0) {
        for (double& one : p) one = kMost * random.uniform(0, 1);
      }
      constexpr int kSteps = 20;
      for (int step = 0; k > 0 && step < kSteps; ++step) {
        const double dt = kSpacing / kSteps;
        for (int i = 0; i < 3; ++i) {
          const double tau = p[i] > lagged[i] ? truth.rise : truth.fall;
          lagged[i] = tau > 0 ? lagged[i] + (p[i] - lagged[i]) * dt / (tau + dt / 2) : p[i];
          slow[i] += (lagged[i] - slow[i]) * dt / truth.slow_time;
          slower[i] += (lagged[i] - slower[i]) * dt / 60;
        }
      }
      const Eigen::Vector3d effective =
          lagged + truth.slow_weight * (slow - lagged) + truth.second_weight * (slower - lagged);
      error *= std::exp(-kSpacing / 2);
      error += normals(random) * std::sqrt(1 - std::exp(-kSpacing));
      const Eigen::Vector3d noise = normals(random);
      out.history.input.row(row) = p;
      out.history.time.push_back(k * kSpacing);
      out.history.starts_anew.push_back(k == 0);
      const lie::SE3 tip = trueTip(effective, truth);
      out.position.row(row) = truth.turn * turn * tip.translation + truth.place +
                              truth.offset * offset + truth.correlated * error + kNoise * noise;
      if (truth.beam) {
        const Eigen::Vector3d along = truth.turn * turn * tip.rotation *
                                      Eigen::Vector3d(1, (*truth.beam)[0], (*truth.beam)[1]);
        const Eigen::Vector3d from = truth.turn * turn * tip.translation + truth.place;
        out.position.row(row) = from - from.z() / along.z() * along + kNoise * noise;
      }
      if (!truth.oriented) continue;
      out.rotation.push_back(truth.turn * turn * tip.rotation * turn.transpose() * truth.body *
                             about(noise.normalized(), kTurnNoise * noise.norm()));
    }
  }
  return out;
}

// What a user guesses: another curve, radius and stiffness, and a base whose axes are those of F.
SeriesPrior guess(double radius = 0.025) {
  const auto curve = model::Contraction::table({0, kMost / 2, kMost}, {0.19, 0.2, 0.22});
  model::Section section;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d place{0, radius * std::cos(angleOf(i)), radius * std::sin(angleOf(i))};
    model::Actuator one{std::to_string(i + 1),
                        {Eigen::Matrix3d::Identity(), place},
                        {10, 0, 1.5e-4},
                        curve,
                        {0, kMost}};
    one.curve = "chamber";
    section.actuators.push_back(std::move(one));
  }
  return {statics::ArmModel(model::Arm({section})),
          {Eigen::Matrix3d::Identity(), {-0.1, 0.2, -0.3}}};
}

SeriesOptions everything(bool response = true) {
  SeriesOptions out;
  out.arm.fit.insert({FitParameter::kContraction, FitParameter::kBase});
  out.response = response;
  return out;
}

bool keeps(const SeriesFit& fit, const std::string& part) {
  return std::any_of(fit.choices.begin(), fit.choices.end(),
                     [&part](const Choice& one) { return one.part == part && one.kept; });
}

const Parameter& parameterOf(const SeriesFit& fit, const std::string& name) {
  return *std::find_if(fit.parameters.begin(), fit.parameters.end(),
                       [&name](const Parameter& one) { return one.name == name; });
}

TEST(SeriesFit, PredictsAnArmThatLagsAndCreeps) {
  Truth truth{0.8, 0.5, 10.0, 0.4, 0, 0, 0.001};
  const SeriesFit fit = fitSeries(guess(), seriesOf(truth, 1), everything());
  ASSERT_EQ(fit.failure, "");
  EXPECT_TRUE(keeps(fit, "lag"));
  EXPECT_TRUE(keeps(fit, "slow state"));
  EXPECT_FALSE(keeps(fit, "play"));
  const double values[] = {truth.rise, truth.fall, truth.slow_time, truth.slow_weight};
  for (int i = 0; i < 4; ++i) {
    const Parameter& found = parameterOf(fit, kResponse[i]);
    EXPECT_NEAR(found.value, values[i], 4 * found.standard_error) << kResponse[i];
    EXPECT_LT(found.standard_error, 0.1 * values[i]) << kResponse[i];
    EXPECT_TRUE(found.identifiable) << kResponse[i];
  }
  // Noise in three directions, and the offset of a trial that no other tells.
  EXPECT_LT(fit.rms_about_offset, 1.1 * std::sqrt(3) * kNoise);
  EXPECT_LT(fit.held_out_rms, 3 * std::sqrt(3) * truth.offset);
}

// What a response would add to an arm without one is noise. Shear does not show in an arm whose
// muscles lie along it, nor whether they lengthen.
TEST(SeriesFit, LeavesOutWhatPredictsNoBetterAndSaysWhatTheDataCannotTell) {
  SeriesOptions options = everything();
  options.arm.fit.insert(FitParameter::kStrokeScaleEach);
  const SeriesFit fit = fitSeries(guess(), seriesOf({}, 5), options);
  ASSERT_EQ(fit.failure, "");
  EXPECT_EQ(fit.choices.size(), 6u);
  for (const Choice& one : fit.choices) EXPECT_FALSE(one.kept) << one.part;
  EXPECT_TRUE(fit.response.instant());
  EXPECT_FALSE(parameterOf(fit, "K_gamma").identifiable);
  EXPECT_TRUE(std::any_of(fit.rules.begin(), fit.rules.end(), [](const std::string& rule) {
    return rule.find("lengthens or shortens") != std::string::npos;
  }));
}

// Their common factor is that of the curve. Their prior of 5 % pulls.
TEST(SeriesFit, TellsTheStrokesOfActuatorsApart) {
  Truth truth;
  truth.stroke = {1.12, 0.9, 0.98};
  SeriesOptions options = everything(false);
  options.arm.fit.insert(FitParameter::kStrokeScaleEach);
  const SeriesFit fit = fitSeries(guess(), seriesOf(truth, 10), options);
  ASSERT_EQ(fit.failure, "");
  EXPECT_TRUE(keeps(fit, "strokes"));
  const Eigen::VectorXd& found = fit.stroke_scale.value();
  EXPECT_NEAR(found[0] / found[1], 1.12 / 0.9, 0.025);
  EXPECT_NEAR(found[2] / found[1], 0.98 / 0.9, 0.025);
}

// Chambers in one body: K_kappa and what the chambers resist by their places, r^2 / 2, grow as one.
double stiffening(const SeriesFit& fit) {
  const double share = 0.025 * 0.025 / 2, least = fit.stiffness->kappa;
  return (share + least * fit.bending->factor.back()) / (share + least);
}

// With a base that is known, or with orientations of the tip itself, which alone tell a turn of the
// ring from one of the base. Bend alone does not tell a radius.
TEST(SeriesFit, FindsThePhaseOfARing) {
  for (const bool oriented : {false, true}) {
    Truth truth;
    truth.phase = 0.2;
    truth.oriented = oriented;
    if (oriented) truth.turn = about(Eigen::Vector3d::UnitX(), -0.5);
    SeriesOptions options = everything(false);
    if (!oriented) options.arm.fit.erase(FitParameter::kBase);
    options.ring_radius = options.ring_phase = true;
    SeriesPrior prior = guess();
    prior.R_TM = Eigen::Matrix3d::Identity();
    const SeriesFit fit = fitSeries(prior, seriesOf(truth, 4), options);
    ASSERT_EQ(fit.failure, "");
    const Parameter& phase = parameterOf(fit, "ring_phase_1");
    EXPECT_NEAR(phase.value, 0.2, 4 * phase.standard_error);
    EXPECT_LT(phase.standard_error, 0.01);
    EXPECT_NEAR((*fit.ring_phase)[0], phase.value, 1e-12);
    EXPECT_FALSE(parameterOf(fit, "ring_radius_1").identifiable);
    if (!oriented) continue;
    EXPECT_NEAR(parameterOf(fit, "base_rx").value, -0.5, 4 * phase.standard_error);
    EXPECT_LT(fit.rms_turn, 1.1 * std::sqrt(3) * kTurnNoise);
  }
}

TEST(SeriesFit, FindsTheRotationOfABodyFromTheMotion) {
  Random random(31);
  for (int trial = 0; trial < test::draws(1, 20); ++trial) {
    Truth truth;
    truth.oriented = true;
    truth.body = about(normals(random).normalized(), random.uniform(0.2, kPi - 0.2));
    truth.turn = about(normals(random).normalized(), random.uniform(0, kPi));
    const SeriesFit fit = fitSeries(guess(), seriesOf(truth, 40 + trial), everything(false));
    ASSERT_EQ(fit.failure, "");
    EXPECT_EQ(fit.orientation_fault, "");
    ASSERT_TRUE(fit.R_TM);
    const Eigen::Vector3d expected = lie::SE3{truth.body, {}}.log().tail<3>();
    const char* const names[] = {"body_rx", "body_ry", "body_rz"};
    for (int i = 0; i < 3; ++i) {
      const Parameter& found = parameterOf(fit, names[i]);
      EXPECT_NEAR(found.value, expected[i], 5 * found.standard_error + 0.002) << names[i];
      EXPECT_LT(found.standard_error, 0.05);
    }
    EXPECT_LT(fit.rms_about_offset, 1.2 * std::sqrt(3) * kNoise);
    EXPECT_LT(fit.rms_turn, 1.2 * std::sqrt(3) * kTurnNoise);
  }
}

// One chamber alone bends freely; others that have pressure keep it from that.
TEST(SeriesFit, FindsABendThatTheOthersStiffen) {
  Truth truth;
  truth.others = 2;
  const SeriesFit fit = fitSeries(guess(), seriesOf(truth, 9), everything(false));
  ASSERT_EQ(fit.failure, "");
  EXPECT_TRUE(keeps(fit, "K_kappa against the others' pressure"));
  EXPECT_FALSE(keeps(fit, "K_kappa against pressure"));
  EXPECT_LT(fit.rms_about_offset, 1.1 * std::sqrt(3) * kNoise);
  ASSERT_TRUE(fit.bending);
  EXPECT_EQ(fit.bending->argument, model::BendingTable::Argument::kOthers);
  EXPECT_NEAR(stiffening(fit), 1 + truth.others, 0.1);
}

TEST(SeriesFit, FindsABendThatStiffensWithTheMeanPressure) {
  Truth truth;
  truth.growth = 0.8;
  const SeriesFit fit = fitSeries(guess(), seriesOf(truth, 8), everything(false));
  EXPECT_TRUE(keeps(fit, "K_kappa against pressure"));
  ASSERT_TRUE(fit.bending);
  EXPECT_NEAR(stiffening(fit), 1 + truth.growth, std::sqrt(400.0 / kRows) * 0.05);
}

// Where chambers are not evenly spaced, stiffness does not make up for another radius.
TEST(SeriesFit, FindsWhereChambersSitAroundTheAxis) {
  Truth truth;
  truth.own_phase = {0, 0.5, -0.3};
  SeriesOptions options = everything(false);
  options.phases = true;
  const SeriesFit fit = fitSeries(guess(kRadius), seriesOf(truth, 4), options);
  EXPECT_TRUE(keeps(fit, "phases"));
  for (int i = 1; i < 3; ++i) {
    const Parameter& phase = parameterOf(fit, "phase_" + std::to_string(i + 1));
    EXPECT_NEAR(phase.value, truth.own_phase[i], 4 * phase.standard_error);
  }
  EXPECT_FALSE(keeps(fitSeries(guess(), seriesOf(Truth(), 4), options), "phases"));
}

// The base hangs 1.2 m above the plane; a user guesses that to within a few centimetres.
TEST(SeriesFit, PredictsTheDotOfABeam) {
  Truth truth;
  truth.turn = about(Eigen::Vector3d::UnitY(), kPi / 2);
  truth.place = {0.02, -0.03, 1.2};
  truth.beam = {0.05, -0.08};
  TipSeries series = seriesOf(truth, 13);
  series.position.conservativeResize(Eigen::NoChange, 2);
  SeriesPrior prior = guess();
  prior.X_BF = lie::SE3{truth.turn, {0, 0, 1.25}}.inverse();
  prior.beam = Eigen::Vector2d::Zero();
  const SeriesFit fit = fitSeries(prior, series, everything(false));
  EXPECT_TRUE(fit.beam) << fit.failure;
  EXPECT_LT(fit.held_out_rms, 2 * std::sqrt(2) * kNoise);
}

// Although the arm has a second creep, rests elsewhere in each trial and has correlated noise. The
// truth of a response with one creep is what a fit without rest and noise finds.
TEST(SeriesFit, IntervalsHoldTheTruth) {
  Truth truth{0.8, 0.5, 10.0, 0.4, 0.08};
  const SeriesFit best = fitSeries(guess(), seriesOf(truth, 99), everything());
  truth.offset = 0.001;
  truth.correlated = 0.002;
  int held = 0, count = 0;
  for (int seed = 20; seed < 20 + test::draws(2, 12); ++seed) {
    Random random(seed);
    const Eigen::Vector3d axis = normals(random);
    truth.turn = about(axis.normalized(), 0.1 * axis.norm());
    const SeriesPrior prior = guess();
    const SeriesFit fit = fitSeries(prior, seriesOf(truth, seed), everything());
    ASSERT_EQ(fit.failure, "");
    const lie::Vector6 base = (prior.X_BF * lie::SE3{truth.turn, truth.place}).log();
    const auto judge = [&](const std::string& name, double value) {
      const Parameter& found = parameterOf(fit, name);
      held += std::abs(found.value - value) < 1.96 * found.standard_error ? 1 : 0;
      ++count;
    };
    for (const char* name : kResponse) judge(name, parameterOf(best, name).value);
    for (const int i : {1, 2, 3, 4, 5}) judge(kBase[i], base[i]);
  }
  EXPECT_GE(held, test::isFullSize() ? 0.9 * count : test::leastOf(count, 0.95));
  EXPECT_TRUE(held < count || !test::isFullSize());
}

}  // namespace
}  // namespace helix_arm::estimation
