// A calibration run on rigs as the simulator builds them: stiffness, muscles, camera and tags of
// each are off in their own way; pictures are rendered and searched (by default those of the first
// rigs; of the others corners are projected), pressures have lag and noise.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/model/curve.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/captures.hpp"
#include "procedures/pressure_plan.hpp"
#include "procedures/response_series.hpp"
#include "procedures/settle_watch.hpp"
#include "simulation/rig.hpp"
#include "simulation/simulated_vision.hpp"
#include "support/random.hpp"
#include "support/sample_rig.hpp"
#include "support/shipped_scene.hpp"
#include "support/test_size.hpp"

namespace helix_arm {
namespace {

using namespace estimation;

const int kRigs = test::draws(9, 100);
const int kRendered = test::draws(1, 100);  // of these rigs
constexpr double kBeyond3 = 0.0027;         // probability of more than 3 standard errors
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

io::TagCornerCapture captureOf(const io::Scene& scene, const procedures::Sample& median,
                               std::size_t before) {
  io::TagCornerCapture out{static_cast<int>(before) + 1, scene.arm.clamped(median.pressure), {}};
  for (const procedures::TagObservation& tag : median.tags) {
    out.tags.push_back({tag.id, tag.corners});
  }
  return out;
}

// Tags that a camera sees of the arm at rest at each pressure of the plan, as a calibration takes:
// the median of a few pictures and of many readings.
std::vector<io::TagCornerCapture> photograph(const io::Scene& scene, const Rig& rig,
                                             bool rendered) {
  constexpr int kPictures = 3;                      // at each pressure
  constexpr int kReadings = 100;                    // of the pressures
  constexpr double kSettling = 3.0, kPause = 0.01;  // [s]
  simulation::CameraSetup setup = scene.cameraSetup().value();
  setup.view = simulation::deviate(scene.view(), scene.arm, rig.mounts);
  setup.config.seed = rig.mounts.seed;
  auto regulator = std::get<regulator::SimulatedRegulatorConfig>(*scene.regulator);
  regulator.seed = rig.mounts.seed;
  simulation::SimulatedRig simulated(scene.arm, regulator, rig.arm, setup);
  vision::TagDetector detector(scene.vision.detector);
  estimation::ArmView shrunk = setup.view;
  shrunk.layout.size -= 2 * setup.config.border_shift;
  // The median of three has 0.67 of the deviation of one.
  const double noise = scene.vision.fit.corner_noise / 0.67;
  test::Random random(rig.mounts.seed);
  const auto look = [&] {
    std::vector<procedures::TagObservation> seen;
    if (rendered) {
      for (const vision::TagDetection& tag : detector.detect(simulated.render())) {
        if (scene.tags->find(tag.id) >= 0) seen.push_back({tag.id, tag.corners});
      }
      return seen;
    }
    for (const estimation::TagImage& tag : estimation::visibleTags(shrunk, simulated.shape())) {
      seen.push_back({scene.tags->tags[static_cast<std::size_t>(tag.tag)].id, tag.corners});
      for (double& value : seen.back().corners.reshaped()) value += noise * random.normal();
    }
    return seen;
  };
  std::vector<io::TagCornerCapture> captures;
  const Eigen::MatrixXd plan = procedures::defaultPressurePlan(scene.arm);
  for (int step = 0; step < plan.rows(); ++step) {
    simulated.command(plan.row(step).transpose());
    simulated.step(kSettling);
    std::vector<procedures::Sample> samples;
    for (int picture = 0; picture < kPictures; ++picture) {
      Eigen::VectorXd pressure = Eigen::VectorXd::Zero(plan.cols());
      for (int i = 0; i < kReadings; ++i) {
        pressure += simulated.measure() / kReadings;
        simulated.step(kPause);
      }
      samples.push_back({0, pressure, look()});
    }
    captures.push_back(captureOf(scene, procedures::medianOf(samples), captures.size()));
  }
  return captures;
}

// What a calibration should find, by its names.
std::map<std::string, double> truthOf(const io::Scene& scene, const Rig& rig) {
  const model::Stiffness& stiffness = scene.arm.actuator(0).stiffness;
  std::map<std::string, double> truth{{"K_kappa", stiffness.kappa * rig.arm.K_kappa_scale},
                                      {"K_gamma", stiffness.gamma * rig.arm.K_gamma_scale},
                                      {"length_scale", rig.arm.length_scale},
                                      {"bleed", scene.simulation.camera.border_shift}};
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

TEST(RigCalibration, ParametersAreWithinTheirErrorsAndTheTipComesThreeTimesCloser) {
  const io::Scene scene = test::demo();
  estimation::CalibrationOptions options;
  options.fit.insert({FitParameter::kBase, FitParameter::kTags, FitParameter::kBorderShift});
  options.fit.insert(FitParameter::kLengthScale);
  options.fit.insert(FitParameter::kStrokeScaleEach);
  options.corner_noise = scene.vision.fit.corner_noise;
  options.tag_prior = scene.tag_prior;

  std::map<std::string, int> misses, told;
  std::vector<double> ratios;
  double sum_before = 0, sum_after = 0, square = 0;
  for (int number = 1; number <= kRigs; ++number) {
    const Rig rig = draw(number);
    const procedures::LoadedCaptures loaded = procedures::makeCaptures(
        scene, photograph(scene, rig, number <= kRendered), "rig " + std::to_string(number));
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
    EXPECT_LE(count, test::mostOf(kRigs, kBeyond3)) << name;
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
      "%d rigs (%d rendered), %zu parameters: at most %d rigs beyond 3 standard errors, RMS %.2f "
      "of them\n"
      "tip, RMS: %.1f mm before, %.1f mm after; of %zu rigs that were off by more than %.0f mm, "
      "the worst ratio is %.3f; K_kappa told in %d\n",
      kRigs, kRendered, misses.size(), worst, std::sqrt(square / kRigs),
      1e3 * std::sqrt(sum_before / kRigs), 1e3 * std::sqrt(sum_after / kRigs), ratios.size(),
      1e3 * kOff, ratios.back(), told["K_kappa"]);
}

// ---- A run there and back -----------------------------------------------------------------------

// On a simulated rig whose actuators lag and rub, without ROS: regulators with lag and noise, tags
// with noise, pictures that arrive late.

constexpr double kStep = 0.01;        // of time [s]
constexpr int kPicture = 3;           // steps from picture to picture
constexpr double kLatency = 0.06;     // of a picture [s]
constexpr double kCornerNoise = 0.3;  // [px]
// As a run of the calibration node.
constexpr double kMostRamp = 1e5 * kStep;  // from step to step [Pa]
constexpr std::size_t kCaptures = 3;       // per pressure
constexpr int kMostSteps = 100'000;        // of time

model::Response truth() {
  model::Response out;
  out.rise_time = 0.3;
  out.fall_time = 0.6;
  out.play_count = 1;
  out.plays[0] = {8e3, 0.6};
  return out;
}

simulation::SimulatedRig makeRig(const io::Scene& scene, std::uint32_t seed) {
  simulation::ArmDeviation deviation = scene.simulation.arm;
  deviation.response = truth();
  auto regulator = std::get<regulator::SimulatedRegulatorConfig>(*scene.regulator);
  regulator.seed = seed;
  return {scene.model, regulator, deviation};
}

// What a run of the calibration node leaves.
struct Recorded {
  procedures::CalibrationData data;
  Eigen::MatrixXd plan;
  std::vector<Eigen::Vector3d> tips;  // true ones at each step's end
  double noise = 0;                   // of a measured tip, RMS [m]
};

Recorded record(const io::Scene& scene, bool loop) {
  Recorded out;
  out.plan = std::get<Eigen::MatrixXd>(procedures::checkPlan(scene.arm, {}, loop));
  simulation::SimulatedRig rig = makeRig(scene, 4);
  simulation::SimulatedVision vision(*scene.cameraSetup(), scene.view(), scene.vision,
                                     {simulation::VisionKind::kCorners, kCornerNoise, 5});
  test::Random random(6);
  procedures::SettleWatch watch(scene.arm.actuatorNames(), {});
  procedures::SeriesRecord series(scene.arm.actuatorCount());
  const Eigen::VectorXd rest = scene.arm.inputAt(0);

  struct Picture {
    double time;
    std::vector<procedures::TagObservation> tags;
    std::optional<simulation::MeasuredShape> shape;
  };
  std::deque<Picture> pictures;
  std::vector<procedures::Sample> captures;
  std::vector<io::TagCornerCapture> samples;
  Eigen::VectorXd command = rest;
  int looks = 0;
  const auto steps = static_cast<std::size_t>(out.plan.rows());
  for (int step = 1; out.tips.size() < steps && step < kMostSteps; ++step) {
    const double now = kStep * step;
    rig.command(command);
    rig.step(kStep);
    const Eigen::VectorXd reading = rig.measure();
    watch.command(now, command);
    watch.measured(now, reading);
    series.measured(now, reading);
    if (step % kPicture == 0) {
      const model::Shape shape = rig.shape();
      Picture picture{now, {}, {}};
      for (const estimation::TagImage& tag : estimation::visibleTags(scene.view(), shape)) {
        procedures::TagObservation& seen = picture.tags.emplace_back();
        seen.id = scene.tags->tags[static_cast<std::size_t>(tag.tag)].id;
        seen.corners = tag.corners;
        for (double& value : seen.corners.reshaped()) value += kCornerNoise * random.normal();
      }
      std::sort(picture.tags.begin(), picture.tags.end(),
                [](const auto& a, const auto& b) { return a.id < b.id; });
      picture.shape = vision.look(shape, shape);
      if (picture.shape) {
        out.noise +=
            (picture.shape->tip.translation - model::tipPose(shape).translation).squaredNorm();
        ++looks;
      }
      pictures.push_back(std::move(picture));
    }
    while (!pictures.empty() && pictures.front().time + kLatency <= now) {
      const Picture& picture = pictures.front();
      watch.seen(picture.time, picture.tags);
      if (picture.shape) series.seen(picture.time, picture.shape->tip.translation);
      pictures.pop_front();
    }
    const Eigen::VectorXd wanted = out.plan.row(static_cast<Eigen::Index>(out.tips.size()));
    if (command != wanted) {
      command += (wanted - command).cwiseMax(-kMostRamp).cwiseMin(kMostRamp);
      continue;
    }
    const procedures::Settling settling = watch.at(now);
    const bool at_rest = settling.settled() && settling.set_point == command;
    if (at_rest && (captures.empty() || settling.last->time > captures.back().time)) {
      captures.push_back(*settling.last);
    }
    if (captures.size() < kCaptures) continue;
    const procedures::Sample median = medianOf(captures);
    captures.clear();
    samples.push_back(captureOf(scene, median, samples.size()));
    samples.back().time = median.time;
    out.tips.push_back(model::tipPose(rig.twists()).translation);
  }
  out.noise = std::sqrt(out.noise / looks);
  EXPECT_EQ(out.tips.size(), steps) << "the arm has not come to rest";
  out.data.captures = procedures::makeCaptures(scene, samples, "samples").captures;
  out.data.sources.push_back({"samples", std::string(64, 'a'), static_cast<int>(samples.size())});
  if (loop) out.data.tips = series.series();
  return out;
}

procedures::CalibrationOutcome calibrate(const procedures::CalibrationData& data,
                                         const std::vector<std::string>& fit) {
  procedures::CalibrationRequest request;
  request.fit = fit;
  return procedures::runCalibration(test::shippedPath("demo"), {}, request, data);
}

// RMS distance of the tip that a scene predicts from the true one, through a round trip [m].
double cycleError(const io::Scene& predicted, const io::Scene& scene) {
  simulation::SimulatedRig rig = makeRig(scene, 7);
  model::ArmResponse response(predicted.arm);
  const Eigen::MatrixXd tour = procedures::pressureTour(scene.arm);
  Eigen::VectorXd command = scene.arm.inputAt(0);
  double sum = 0;
  int count = 0, held = 0;
  for (Eigen::Index stop = 0; stop < tour.rows();) {
    const Eigen::VectorXd target = tour.row(stop).transpose();
    command += (target - command).cwiseMax(-kMostRamp).cwiseMin(kMostRamp);
    rig.command(command);
    rig.step(kStep);
    response.follow(kStep * ++count, rig.pressure());
    const Eigen::Vector3d tip =
        predicted.arm.tip(predicted.arm.clamped(response.effective())).translation;
    sum += (tip - model::tipPose(rig.twists()).translation).squaredNorm();
    if (command == target && ++held * kStep > 0.5) {
      held = 0;
      ++stop;
    }
  }
  return std::sqrt(sum / count);
}

TEST(LoopCalibration, FindsLagAndPlayAndPredictsTheTipThroughACycle) {
  // All that the fit cannot describe is left out.
  const io::Scene scene = test::demo({test::kIdealRig});
  const Recorded up = record(scene, false), loop = record(scene, true);

  // Up against down at the same pressures.
  double apart = 0;
  for (Eigen::Index step = 0; step < loop.plan.rows(); ++step) {
    const Eigen::Index back = loop.plan.rows() - 1 - step;
    apart = std::max(apart, (loop.tips.at(static_cast<std::size_t>(step)) -
                             loop.tips.at(static_cast<std::size_t>(back)))
                                .norm());
  }

  const auto without = calibrate(up.data, {"stiffness", "length_scale"});
  ASSERT_TRUE(without.success) << without.message;
  const std::vector<std::string> fit{"response", "stiffness", "length_scale"};
  const auto with = calibrate(loop.data, fit);
  ASSERT_TRUE(with.success) << with.message;
  procedures::CalibrationData untimed = loop.data;
  for (estimation::Capture& capture : untimed.captures) capture.time.reset();
  const auto measured = calibrate(untimed, fit);
  ASSERT_TRUE(measured.success) << measured.message;

  const auto errorOf = [&](const procedures::CalibrationOutcome& outcome) {
    return cycleError(io::sceneOfText(outcome.scene_text, "calibrated.yaml"), scene);
  };
  const double before = cycleError(scene, scene), static_error = errorOf(without),
               error = errorOf(with), static_pressures = errorOf(measured);
  const estimation::ResponseFit& response = with.response->fit;
  std::printf(
      "[  FIGURE  ] tip up against down at the same pressures: up to %.2f mm\n"
      "[  FIGURE  ] lag %.3f and %.3f s, half width of the loop %.2f kPa; series %.2f mm RMS, %.2f "
      "mm without a response; tip of the samples from %.2f to %.2f mm, median\n"
      "[  FIGURE  ] tip through a cycle, RMS: %.2f mm before, %.2f calibrated up alone, %.2f "
      "calibrated there and back (%.2f with measured in place of effective pressures); a measured "
      "tip has %.2f mm of noise\n",
      1e3 * apart, response.rise_time.value, response.fall_time.value,
      1e-3 * response.response.halfWidth(), 1e3 * response.rms, 1e3 * response.static_rms,
      1e3 * with.tip_error_before.value(), 1e3 * with.tip_error_after.value(), 1e3 * before,
      1e3 * static_error, 1e3 * error, 1e3 * static_pressures, 1e3 * loop.noise);
  EXPECT_GT(apart, 3e-3);
  EXPECT_NEAR(response.rise_time.value, truth().rise_time, 0.03);
  EXPECT_NEAR(response.fall_time.value, truth().fall_time, 0.06);
  EXPECT_EQ(response.play, estimation::ResponseVerdict::kFound);
  EXPECT_NEAR(response.response.halfWidth(), truth().halfWidth(), 600);
  EXPECT_LT(with.tip_error_after.value(), 1e-3);
  EXPECT_GT(before, 0.015);
  EXPECT_GT(static_error, 0.010);
  EXPECT_LT(error, loop.noise);
  // Its captures are matched at the effective pressures.
  EXPECT_LT(error, 0.7 * static_pressures);
}

}  // namespace
}  // namespace helix_arm
