#include "commissioning.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <variant>

#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "calibration_job.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "simulation/bodies.hpp"
#include "simulation/rig.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::Capture;
using estimation::Suspect;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kFraction = 0.3;  // of an actuator's range
constexpr int kAlone = 2;  // steps of each actuator alone, from the second step of a plan on
// Readings of each pressure, whose mean is as that of a window of a real rig.
constexpr int kReadings = 50;
// Bends beside that of the strongest actuator, below which no pressure arrives, and beside that of
// the usual one. Muscles of one batch are alike within some 10 %.
constexpr double kDead = 0.2, kWeak = 0.8, kStrong = 1.25;
// Cosines of bends: of the same direction, and by how much another actuator has to agree better.
constexpr double kSameWay = 0.8, kBetter = 0.25;
// Beyond what regulators and noise leave of a sensor.
constexpr double kMostGain = 0.1, kMostOffset = 8e3;  // [Pa]
constexpr double kFacing = 0.5;  // cosine at which a tag is expected to be seen

// Change of a shape by a bend.
struct Stand {
  Eigen::VectorXd bend;  // (2 sections) mean twists about y and z [rad]
  Eigen::Vector2d tip;   // across the base [m]

  Stand from(const Stand& rest) const { return {bend - rest.bend, tip - rest.tip}; }
};

Stand standOf(const model::Shape& shape) {
  const model::Twists twists = shape.twists();
  return {twists.bottomRows<2>().reshaped(), model::tipPose(shape).translation.tail<2>()};
}

model::Shape modelAt(const io::Scene& scene, const Eigen::VectorXd& measured) {
  const Eigen::VectorXd pressure = scene.arm.clamped(measured);
  return statics::startingShape(scene.model, scene.model.solve(pressure), pressure);
}

// The shapes that tags alone show; nothing where they show none.
std::vector<std::optional<Stand>> standsOf(const io::Scene& scene,
                                           const std::vector<Capture>& captures) {
  std::vector<std::optional<Stand>> out;
  for (const FittedShape& one : fitShapes(scene, captures)) {
    const bool found = one.fit && one.fit->status == estimation::FitStatus::kConverged;
    out.push_back(found ? std::optional(standOf(one.fit->shape)) : std::nullopt);
  }
  return out;
}

double cosineOf(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  return a.dot(b) / std::max(a.norm() * b.norm(), std::numeric_limits<double>::min());
}

// The usual one of what actuators bend beside their models; of two, the one nearer to its model.
double usualOf(const std::vector<double>& ratios) {
  if (ratios.size() > 2) return basics::medianOf(ratios);
  return *std::min_element(ratios.begin(), ratios.end(), [](double a, double b) {
    return std::abs(std::log(a)) < std::abs(std::log(b));
  });
}

// Which way an actuator bends.
void judgeDirection(const Eigen::VectorXd& bend, const std::vector<Stand>& expected, int actuator,
                    WalkedChannel& channel) {
  std::vector<double> cosine;
  for (const Stand& one : expected) cosine.push_back(cosineOf(bend, one.bend));
  const auto best = std::max_element(cosine.begin(), cosine.end());
  const double own = cosine[static_cast<std::size_t>(actuator)];
  const bool other = *best - own >= kBetter;
  channel.verdict = own >= kSameWay && !other    ? "ok"
                    : *best >= kSameWay && other ? "answers_as"
                    : own <= -kSameWay           ? "wrong_sign"
                                                 : "other_direction";
  if (channel.verdict == "answers_as") {
    channel.answers_as = static_cast<int>(best - cosine.begin());
  }
}

std::vector<WalkedChannel> channelsOf(const io::Scene& scene, const std::vector<Capture>& captures,
                                      const Eigen::MatrixXd& plan) {
  const std::vector<std::optional<Stand>> seen = standsOf(scene, captures);
  const std::optional<Stand>& rest = seen.front() ? seen.front() : seen.back();
  const Stand start = standOf(modelAt(scene, plan.row(0)));
  const auto expectedAt = [&](int step) {
    return standOf(modelAt(scene, plan.row(step))).from(start);
  };
  const int count = scene.arm.actuatorCount();
  std::vector<Stand> expected;
  for (int i = 0; i < count; ++i) expected.push_back(expectedAt(kAlone * (i + 1)));
  std::vector<WalkedChannel> out;
  std::vector<double> ratios(static_cast<std::size_t>(count), kNaN), alive;
  for (int i = 0; i < count; ++i) {
    out.push_back({scene.arm.actuator(i).name, expected[static_cast<std::size_t>(i)].tip,
                   Eigen::Vector2d::Constant(kNaN), "unseen", -1});
    // At the largest pressure that shows it.
    for (int step = kAlone * (i + 1); rest && step > kAlone * i; --step) {
      const std::optional<Stand>& here = seen[static_cast<std::size_t>(step)];
      if (!here) continue;
      const Stand moved = here->from(*rest), meant = expectedAt(step);
      out.back().expected = meant.tip;
      out.back().seen = moved.tip;
      ratios[static_cast<std::size_t>(i)] = moved.bend.norm() / meant.bend.norm();
      judgeDirection(moved.bend, expected, i, out.back());
      break;
    }
  }
  double strongest = kDead;
  for (const double ratio : ratios) strongest = std::fmax(strongest, ratio);
  std::copy_if(ratios.begin(), ratios.end(), std::back_inserter(alive),
               [&](double ratio) { return ratio > kDead * strongest; });
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (ratios[i] <= kDead * strongest) {
      out[i].verdict = "dead";
      out[i].answers_as = -1;
    } else if (out[i].verdict == "ok") {
      const double beside = ratios[i] / usualOf(alive);
      if (beside < kWeak) out[i].verdict = "weak";
      if (beside > kStrong) out[i].verdict = "strong";
    }
  }
  return out;
}

std::vector<WalkedSensor> sensorsOf(const io::Scene& scene, const std::vector<Capture>& captures,
                                    const Eigen::MatrixXd& plan) {
  Eigen::MatrixXd measured(plan.rows(), plan.cols());
  for (Eigen::Index step = 0; step < plan.rows(); ++step) {
    measured.row(step) = captures[static_cast<std::size_t>(step)].pressure;
  }
  // By least squares over the steps, on the commanded pressures of all actuators.
  const Eigen::MatrixXd about = plan.rowwise() - plan.colwise().mean();
  const Eigen::MatrixXd gains = about.colPivHouseholderQr().solve(measured);
  std::vector<WalkedSensor> out;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    Eigen::Index most = 0;
    const bool reads = gains.col(i).cwiseAbs().maxCoeff(&most) >= kMostGain;
    const double gain = gains(i, i);
    const double offset =
        measured.col(i).mean() - plan(0, i) - gain * (plan.col(i).mean() - plan(0, i));
    out.push_back({scene.arm.actuator(i).name, gain, offset,
                   !reads                           ? "no_reading"
                   : most != i                      ? "reads_as"
                   : std::abs(gain - 1) > kMostGain ? "gain"
                   : std::abs(offset) > kMostOffset ? "offset"
                                                    : "ok",
                   reads && most != i ? static_cast<int>(most) : -1});
  }
  return out;
}

std::vector<int> missingTags(const io::Scene& scene, const std::vector<Capture>& captures) {
  std::vector<int> seen(scene.tags->tags.size(), 0), expected = seen, out;
  const auto count = [](const auto& tags, std::vector<int>& in) {
    for (const auto& one : tags) ++in[static_cast<std::size_t>(one.tag)];
  };
  for (const Capture& capture : captures) {
    const auto* const corners = std::get_if<CornersOfTags>(&capture.reading);
    if (corners == nullptr) return {};  // what another instrument sees is not known
    count(*corners, seen);
    const model::Shape shape = modelAt(scene, capture.pressure);
    count(estimation::visibleTags(scene.view(), shape, kFacing), expected);
  }
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const bool often = 2 * expected[i] > static_cast<int>(captures.size());
    if (often && seen[i] == 0) out.push_back(scene.tags->tags[i].id);
  }
  return out;
}

// (actuators) whose channel each one has; empty unless some are exchanged and all are seen.
std::vector<int> exchangedIn(const std::vector<WalkedChannel>& channels) {
  std::vector<int> out(channels.size(), -1);
  bool any = false;
  for (std::size_t i = 0; i < channels.size(); ++i) {
    const int as = channels[i].answers_as;
    any = any || as >= 0;
    if (channels[i].verdict == "unseen") return {};
    out[as >= 0 ? static_cast<std::size_t>(as) : i] = static_cast<int>(i);
  }
  const bool all = std::find(out.begin(), out.end(), -1) == out.end();
  return any && all ? out : std::vector<int>();
}

std::string placeText(const Eigen::Vector2d& tip) {
  const double angle = std::atan2(tip.y(), tip.x()) * 180 / basics::kPi;
  return basics::format("%.1f mm towards %.0f degrees", 1e3 * tip.norm(),
                        std::round(angle) + 0.0);  // never "-0"
}

std::string textOf(const WalkedChannel& one, const std::vector<WalkedChannel>& all) {
  static constexpr std::pair<const char*, const char*> kRemedies[] = {
      {"dead", "no pressure reaches it: check its hose, its valve and its channel"},
      {"weak", "look for a leak, and check the scale of its channel"},
      {"strong", "check the scale of its channel"},
      {"wrong_sign", "check on which side of the arm it is, and that its curve shortens it"},
      {"other_direction", "check the phase of its ring, arm.base and how the camera is turned"}};
  if (one.verdict == "unseen") return one.actuator + " bends the arm to a shape that no tags show";
  std::string out = one.actuator + " moves the tip by " + placeText(one.seen) + "; expected " +
                    placeText(one.expected) + ": ";
  for (const auto& [verdict, remedy] : kRemedies) {
    if (one.verdict == verdict) return out + remedy;
  }
  return out + "its hose is on " + all[static_cast<std::size_t>(one.answers_as)].actuator;
}

std::string textOf(const WalkedSensor& one, const std::vector<WalkedSensor>& all) {
  if (one.verdict == "reads_as") {
    return "the sensor of " + one.actuator + " reads " +
           all[static_cast<std::size_t>(one.reads_as)].actuator + ": exchange their lines";
  }
  if (one.verdict == "offset") {
    return basics::format("%s reads %.1f kPa too much: zero its sensor with the arm vented",
                          one.actuator.c_str(), 1e-3 * one.offset);
  }
  return basics::format(
      "%s reads %.0f %% of its pressure: check its sensor, and its unit and scale",
      one.actuator.c_str(), 100 * one.gain);
}

// @param channels_first  where the directions are certain.
std::vector<std::string> findingsOf(const Commissioning& found, bool channels_first) {
  std::vector<std::string> out, suspects = textsOf(found.suspects);
  for (const WalkedChannel& one : found.channels) {
    if (one.verdict != "ok") out.push_back(textOf(one, found.channels));
  }
  out.insert(channels_first ? out.end() : out.begin(), suspects.begin(), suspects.end());
  for (const WalkedSensor& one : found.sensors) {
    if (one.verdict != "ok") out.push_back(textOf(one, found.sensors));
  }
  if (!found.missing_tags.empty()) {
    out.push_back(
        "tags that should face the camera are never seen: " + io::listOf(found.missing_tags) +
        "; check that they are on the arm, flat and lit");
  }
  return out;
}

// Suspects by the commanded pressures, where a sensor is not to be trusted.
std::vector<Suspect> suspectsOf(const std::string& path, const std::vector<io::Override>& overrides,
                                CalibrationData data, const Eigen::MatrixXd& plan,
                                const std::vector<WalkedSensor>& sensors) {
  const bool sound = std::all_of(sensors.begin(), sensors.end(),
                                 [](const WalkedSensor& one) { return one.verdict == "ok"; });
  for (std::size_t step = 0; !sound && step < data.captures.size(); ++step) {
    data.captures[step].pressure = plan.row(static_cast<Eigen::Index>(step));
  }
  return runCalibration(path, overrides, {{"stiffness", "length_scale"}}, data).suspects;
}

}  // namespace

Eigen::MatrixXd walkPlan(const model::Arm& arm) {
  const int count = arm.actuatorCount();
  std::vector<Eigen::VectorXd> shares(1, Eigen::VectorXd::Zero(count));
  for (int i = 0; i < count; ++i) {
    for (int k = 1; k <= kAlone; ++k) {
      shares.push_back(kFraction * k / kAlone * Eigen::VectorXd::Unit(count, i));
    }
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), here = arm.firstActuator(k + 1) - first;
    for (int i = 0; i < here && here > 2; ++i) {
      shares.push_back(kFraction * (Eigen::VectorXd::Unit(count, first + i) +
                                    Eigen::VectorXd::Unit(count, first + (i + 1) % here)));
    }
  }
  shares.emplace_back(Eigen::VectorXd::Zero(count));
  Eigen::MatrixXd plan(static_cast<Eigen::Index>(shares.size()), count);
  for (std::size_t step = 0; step < shares.size(); ++step) {
    plan.row(static_cast<Eigen::Index>(step)) = arm.inputAt(shares[step]);
  }
  return plan;
}

regulator::SimulatedRegulatorConfig simulatedRegulatorOf(const io::Scene& scene) {
  if (scene.regulator) {
    const auto* simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&*scene.regulator);
    if (simulated != nullptr) return *simulated;
  }
  regulator::SimulatedRegulatorConfig config;
  config.supply_pressure = scene.arm.inputAt(1).maxCoeff();
  return config;
}

CalibrationData walkSimulatedRig(const io::Scene& scene, const io::Scene& rig_scene,
                                 const Eigen::MatrixXd& plan, std::uint32_t seed) {
  std::optional<simulation::CameraSetup> camera = rig_scene.cameraSetup();
  basics::require(camera.has_value(), "scene ", rig_scene.name,
                  " has neither camera and tags nor bodies, so that its simulated rig is not seen; "
                  "expected them, or the captures of a walk");
  basics::requireValue(rig_scene.arm.actuatorCount() == plan.cols(), "the rig",
                       "its number of actuators", rig_scene.arm.actuatorCount(), plan.cols());
  regulator::SimulatedRegulatorConfig config = simulatedRegulatorOf(rig_scene);
  camera->config.seed = config.seed = seed;
  simulation::SimulatedRig rig(rig_scene.model, config, rig_scene.simulation.arm, camera);
  vision::TagDetector detector(scene.vision.detector);
  std::optional<simulation::SimulatedBodies> bodies;
  camera->bodies.seed = seed;
  if (rig_scene.hasBodies()) bodies.emplace(camera->view, camera->bodies);
  std::vector<io::TagCornerCapture> seen;
  std::vector<io::TagPoseCapture> poses;
  for (Eigen::Index step = 0; step < plan.rows(); ++step) {
    rig.command(plan.row(step).transpose());
    rig.step(std::numeric_limits<double>::infinity());
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(plan.cols());
    for (int i = 0; i < kReadings; ++i) sum += rig.measure();
    const int number = static_cast<int>(step) + 1;
    const Eigen::VectorXd pressure = scene.arm.clamped(sum / kReadings);
    if (bodies) {
      poses.push_back({number, pressure, {}});
      for (const estimation::BodyPose& one : bodies->see(rig.shape())) {
        poses.back().tags.push_back({one.body, one.X_CM, 0});
      }
      continue;
    }
    seen.push_back({number, pressure, {}});
    for (const vision::TagDetection& tag : detector.detect(rig.render())) {
      seen.back().tags.push_back({tag.id, tag.corners});
    }
  }
  const std::string name = "walk of the simulated rig " + rig_scene.name;
  CalibrationData out;
  out.captures =
      bodies ? makeCaptures(scene, poses, name).captures : makeCaptures(scene, seen, name).captures;
  const auto actuators = static_cast<int>(plan.cols());
  const std::string table =
      bodies ? io::tagPoseCsv(poses, actuators, "") : io::tagCornerCsv(seen, actuators, "");
  out.sources.push_back({name, io::sha256Of(table), static_cast<int>(plan.rows())});
  return out;
}

Commissioning commission(const std::string& path, const std::vector<io::Override>& overrides,
                         const CalibrationData& data, const Eigen::MatrixXd& plan) {
  const io::Scene scene = io::loadScene(path, overrides);
  basics::requireValue(static_cast<Eigen::Index>(data.captures.size()) == plan.rows(), "the walk",
                       "its number of captures", data.captures.size(),
                       basics::messageOf(plan.rows(), ", one per step of its plan"));
  for (const Capture& capture : data.captures) {
    const bool of_tags = std::holds_alternative<CornersOfTags>(capture.reading) ||
                         std::holds_alternative<PosesOfTags>(capture.reading);
    basics::require(scene.tags && of_tags, "capture ", capture.number,
                    " of the walk does not tell which way the arm bends; expected tag corners or "
                    "tag poses");
  }
  Commissioning out;
  out.sensors = sensorsOf(scene, data.captures, plan);
  out.suspects = suspectsOf(path, overrides, data, plan, out.sensors);
  // Where tags are otherwise than the scene says, no shape is right without the correction.
  const bool of_tags = !out.suspects.empty() && out.suspects.front().layout;
  const bool corrected = of_tags && !out.suspects.front().corrected.empty();
  out.channels = channelsOf(
      scene, corrected ? out.suspects.front().corrected.front().captures : data.captures, plan);
  out.missing_tags = missingTags(scene, data.captures);
  const bool unseen = std::any_of(out.channels.begin(), out.channels.end(),
                                  [](const WalkedChannel& one) { return one.verdict == "unseen"; });
  out.findings = findingsOf(out, !of_tags && !unseen);
  return out;
}

Correction correct(const std::string& path, const std::vector<io::Override>& overrides,
                   const CalibrationData& data, const Commissioning& found, int suspect) {
  const auto count = static_cast<int>(found.suspects.size());
  basics::requireValue(suspect >= 0 && suspect <= count, "a walk", "the suspect to correct",
                       suspect, basics::messageOf("one of its ", count, ", or 0"));
  const std::vector<int> channels = exchangedIn(found.channels);
  const bool by_direction = suspect == 0 && !channels.empty();
  if (!by_direction && count == 0) {
    return {"", "no scene can say it: " + basics::joined(found.findings, "; ")};
  }
  const Suspect one = by_direction
                          ? Suspect{"channels_exchanged", "", 1, ""}
                          : found.suspects[static_cast<std::size_t>(std::max(suspect, 1) - 1)];
  const auto calibrated = [&](const std::vector<std::string>& words) {
    return runCalibration(path, overrides, {words}, data);
  };
  const auto written = [](const CalibrationOutcome& outcome) -> Correction {
    return {outcome.scene_text, outcome.success ? "" : outcome.message};
  };
  if (one.cause == "base_moved") return written(calibrated({"base"}));
  if (one.cause == "muscle_length") return written(calibrated({"stiffness", "length_scale_each"}));
  if (one.cause == "camera_moved") {
    // The few tags near the base tell its place less well than the arm does.
    const CalibrationOutcome outcome = calibrated({"stiffness", "length_scale", "base"});
    if (!outcome.success) return written(outcome);
    const io::Scene scene = io::loadScene(path, overrides);
    const lie::SE3 X_CB = scene.X_CB() * outcome.calibration->X_B0B;
    return {io::sceneTextWithCamera(path, overrides, {{}, scene.X_WB * X_CB.inverse()}), ""};
  }
  const bool exchanged = one.cause == "channels_exchanged" && !channels.empty();
  if (!exchanged && !one.layout) {
    return {"", "no scene can say " + one.cause + " (" + one.where + "): " + one.remedy};
  }
  try {
    return {io::sceneTextWithRig(path, overrides, one.layout,
                                 exchanged ? channels : std::vector<int>()),
            ""};
  } catch (const std::invalid_argument& fault) {
    return {"", fault.what()};
  }
}

}  // namespace helix_arm::procedures
