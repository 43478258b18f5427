// A calibration run on rigs as the simulator builds them: stiffness, muscles, camera and tags of
// each are off in their own way; pictures are rendered, compressed and searched, pressures have lag
// and noise.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "helix_arm/simulation/rig.hpp"
#include "support/random.hpp"
#include "support/rig_captures.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm {
namespace {

using namespace estimation;

constexpr int kRigs = 100;
constexpr int kMostMisses = 5;
constexpr int kTips = 30;
constexpr double kOff = 0.006;  // of the tip, before [m]

struct Rig {
  simulation::ArmDeviation arm;
  simulation::MountDeviation mounts;
};

Rig draw(int number) {
  test::Random random(number);
  Rig rig;
  rig.arm.K_kappa_scale = std::exp(0.25 * random.normal());
  rig.arm.K_gamma_scale = std::exp(0.4 * random.normal());
  rig.arm.length_scale = std::exp(0.03 * random.normal());
  rig.arm.stroke_scales.resize(3);
  for (double& stroke : rig.arm.stroke_scales) stroke = std::exp(0.05 * random.normal());
  rig.mounts = {0.01, 0.02, 0.002, 0.052, static_cast<std::uint32_t>(number)};
  return rig;
}

// What the detector sees of the arm, as the calibration takes it.
std::vector<io::TagCornerCapture> photograph(const io::Scene& scene, const Rig& rig) {
  simulation::CameraSetup setup = scene.cameraSetup().value();
  setup.view = simulation::deviate(scene.view(), scene.arm, rig.mounts);
  setup.config.seed = rig.mounts.seed;
  auto regulator = std::get<regulator::SimulatedRegulatorConfig>(*scene.regulator);
  regulator.seed = rig.mounts.seed;
  simulation::SimulatedRig simulated(scene.arm, regulator, rig.arm, setup);
  return test::photograph(scene, simulated, procedures::defaultPressurePlan(scene.arm));
}

// What a calibration should find, by its names.
std::map<std::string, double> truthOf(const io::Scene& scene, const Rig& rig) {
  const model::Stiffness& stiffness = scene.arm.actuator(0).stiffness;
  std::map<std::string, double> truth{{"K_kappa", stiffness.kappa * rig.arm.K_kappa_scale},
                                      {"K_gamma", stiffness.gamma * rig.arm.K_gamma_scale},
                                      {"length_scale", rig.arm.length_scale},
                                      {"bleed", scene.simulation.camera.bleed}};
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    truth["stroke_scale_" + scene.arm.actuator(i).name] = rig.arm.stroke_scales[i];
  }
  const estimation::ArmView known = scene.view(),
                            real = simulation::deviate(known, scene.arm, rig.mounts);
  const lie::Vector6 base = (known.X_CB.inverse() * real.X_CB).log();
  const char* const names[] = {"x", "y", "z", "rx", "ry", "rz"};
  for (int i = 0; i < 6; ++i) truth[std::string("base_") + names[i]] = base[i];
  for (std::size_t t = 0; t < known.layout.tags.size(); ++t) {
    const estimation::TagPlacement &from = known.layout.tags[t], &to = real.layout.tags[t];
    const std::string tag = "tag_" + std::to_string(from.id) + "_";
    const Eigen::Vector3d moved = to.X_ST.translation - from.X_ST.translation;
    const double length = scene.arm.restLength(from.section);
    truth[tag + "along"] = (to.s - from.s) * length + moved.x();
    truth[tag + "y"] = moved.y();
    truth[tag + "z"] = moved.z();
    const lie::SE3 turn{from.X_ST.rotation.transpose() * to.X_ST.rotation, Eigen::Vector3d::Zero()};
    for (int i = 3; i < 6; ++i) truth[tag + names[i]] = turn.log()[i];
  }
  return truth;
}

double tipError2(const io::Scene& scene, const Rig& rig, const Calibration* found, int seed) {
  const simulation::TrueArm real(scene.arm, rig.arm);
  const model::Arm arm =
      found != nullptr && found->stiffness ? scene.arm.withStiffness(*found->stiffness) : scene.arm;
  test::Random random(seed);
  double sum = 0;
  for (int i = 0; i < kTips; ++i) {
    const Eigen::VectorXd pressure = test::randomInput(arm, random);
    Eigen::VectorXd lengths = arm.lengths(pressure);
    for (int k = 0; found != nullptr && k < lengths.size(); ++k) {
      const double rest = arm.actuator(k).contraction.restLength();
      const auto is_own = [name = "stroke_scale_" + arm.actuator(k).name](const Parameter& one) {
        return one.name == name;
      };
      const double stroke =
          std::find_if(found->parameters.begin(), found->parameters.end(), is_own)->value;
      lengths[k] = found->length_scale[k] * (rest + stroke * (lengths[k] - rest));
    }
    sum += (model::tipPose(arm.twistsOfLengths(lengths)).translation -
            model::tipPose(real.twists(pressure)).translation)
               .squaredNorm();
  }
  return sum / kTips;
}

TEST(RigCalibration, FindsEveryParameterOfNinetyFiveRigsInAHundredAndBringsTheTipThreeTimesCloser) {
  const io::Scene scene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  estimation::CalibrationOptions options;
  options.base = options.tags = options.bleed = true;
  options.length_scale = estimation::LengthScaling::kCommon;
  options.stroke_scale = true;
  options.corner_noise = scene.vision.fit.corner_noise;
  options.tag_prior = scene.tag_prior;

  std::map<std::string, int> misses, told;
  std::vector<double> ratios;
  double sum_before = 0, sum_after = 0, square = 0;
  for (int number = 1; number <= kRigs; ++number) {
    const Rig rig = draw(number);
    const procedures::LoadedCaptures loaded =
        procedures::makeCaptures(scene, photograph(scene, rig), "rig " + std::to_string(number));
    const Calibration found =
        estimation::calibrate({procedures::makeArmCaptures(scene, loaded.captures)}, options);
    ASSERT_EQ(found.status, CalibrationStatus::kCalibrated) << number << ": " << found.reason;
    const auto truth = truthOf(scene, rig);
    for (const Parameter& one : found.parameters) {
      const double z = (one.value - truth.at(one.name)) / one.standard_error;
      misses[one.name] += std::abs(z) > 3;
      told[one.name] += one.identifiable;
      square += z * z / static_cast<double>(found.parameters.size());
    }
    const double before = tipError2(scene, rig, nullptr, number);
    const double after = tipError2(scene, rig, &found, number);
    sum_before += before;
    sum_after += after;
    // A rig that happens to be right from the start has nothing to gain.
    if (std::sqrt(before) > kOff) ratios.push_back(std::sqrt(after / before));
  }
  int worst = 0;
  for (const auto& [name, count] : misses) {
    EXPECT_LE(count, kMostMisses) << name;
    worst = std::max(worst, count);
  }
  // Errors that are too large would hide anything.
  EXPECT_GT(std::sqrt(square / kRigs), 0.5);
  // A tilted arm determines one of the two stiffnesses; K_kappa needs an untilted arm.
  for (const char* const name :
       {"K_gamma", "length_scale", "base_x", "base_y", "base_z", "bleed"}) {
    EXPECT_EQ(told[name], kRigs) << name;
  }
  std::sort(ratios.begin(), ratios.end());
  EXPECT_LE(ratios.back(), 1.0 / 3);
  EXPECT_LE(std::sqrt(sum_after / sum_before), 1.0 / 3);
  std::printf(
      "%d rigs, %zu parameters: at most %d rigs beyond 3 standard errors, RMS %.2f of them\n"
      "tip, RMS: %.1f mm before, %.1f mm after; of %zu rigs that were off by more than %.0f mm, "
      "the worst ratio is %.3f; K_kappa told in %d\n",
      kRigs, misses.size(), worst, std::sqrt(square / kRigs), 1e3 * std::sqrt(sum_before / kRigs),
      1e3 * std::sqrt(sum_after / kRigs), ratios.size(), 1e3 * kOff, ratios.back(),
      told["K_kappa"]);
}

}  // namespace
}  // namespace helix_arm
