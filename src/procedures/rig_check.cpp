#include "rig_check.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/localization/placed_view.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/tier.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "io/document/number.hpp"
#include "loop_config.hpp"
#include "simulation/simulated_vision.hpp"
#include "unrolled_tags.hpp"

namespace helix_arm::procedures {
namespace {

// A number with so many significant digits.
std::string figure(double value, int digits = 3) { return basics::format("%.*g", digits, value); }

std::string kpa(double pascals) { return figure(pascals / 1e3, 4) + " kPa"; }

const model::Actuator& highest(const model::Arm& arm) {
  int best = 0;
  for (int i = 1; i < arm.actuatorCount(); ++i) {
    if (arm.actuator(i).limits.upper > arm.actuator(best).limits.upper) best = i;
  }
  return arm.actuator(best);
}

// The parts of checkRig(). Each adds its findings.

// Parts of a curve's range and length.
constexpr double kLeastStroke = 0.03;
constexpr double kLeastOfRange = 0.5;
// Slope relative to its mean, below which pressure hardly moves a muscle; and the part of the range
// that may be so.
constexpr double kFlat = 0.1;
constexpr double kMostFlat = 0.2;
constexpr int kCurveSteps = 200;

void checkCurves(const io::Scene& scene, std::vector<Finding>& findings) {
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    const model::Range& limits = actuator.limits;
    const model::Range& curve = actuator.contraction.inputRange();
    const double range = limits.upper - limits.lower, whole = curve.upper - curve.lower;
    const double change =
        actuator.contraction.length(limits.upper) - actuator.contraction.length(limits.lower);
    const double stroke = std::abs(change) / actuator.contraction.length(limits.lower);
    if (stroke < kLeastStroke) {
      findings.push_back({Severity::kWarning, "short_stroke", actuator.name,
                          "its length changes by " + figure(100 * stroke) +
                              " % within its limits; expected 3 % or more",
                          "raise max_pressure_kpa, or measure the contraction curve again"});
    }
    if (range < kLeastOfRange * whole) {
      findings.push_back(
          {Severity::kNote, "curve_unused", actuator.name,
           "its limits use " + figure(100 * range / whole) + " % of its contraction curve",
           "raise max_pressure_kpa if the muscle stands it"});
    }
    int flat = 0;
    for (int k = 0; k <= kCurveSteps; ++k) {
      const double q =
          std::clamp(limits.lower + range * k / kCurveSteps, limits.lower, limits.upper);
      flat += std::abs(actuator.contraction.slope(q)) < kFlat * std::abs(change) / range ? 1 : 0;
    }
    const double part = static_cast<double>(flat) / (kCurveSteps + 1);
    if (part > kMostFlat) {
      findings.push_back({Severity::kWarning, "flat_curve", actuator.name,
                          "in " + figure(100 * part, 2) +
                              " % of its limits its length hardly changes (less than a tenth of "
                              "the mean slope); expected 20 % at most",
                          "raise min_pressure_kpa, or lower max_pressure_kpa, to leave that out"});
    }
  }
}

// A load that doubles the length of the muscles that bear it is none of this arm.
void checkLoad(const io::Scene& scene, std::vector<Finding>& findings) {
  const std::optional<statics::Load>& load = scene.model.load();
  if (!load) return;
  Eigen::Vector3d pull = Eigen::Vector3d::Zero();
  for (const double mass : load->mass) pull += mass * load->gravity;
  for (const statics::PointLoad& point : load->points) pull += load->forceOf(point);
  for (int k = 0; k < scene.arm.sectionCount(); ++k) {
    const double K_eps = load->K_eps[static_cast<std::size_t>(k)];
    const double least =
        pull.norm() / (scene.arm.firstActuator(k + 1) - scene.arm.firstActuator(k));
    if (K_eps >= least) continue;
    findings.push_back({Severity::kFault, "K_eps", scene.looks[static_cast<std::size_t>(k)].name,
                        "its K_eps_n is " + figure(K_eps) + " N; expected at least " +
                            figure(least) + ", the load of one muscle",
                        "give it in N, and check load"});
  }
}

// The facts that a profile tells of its device, against the channels and limits of the arm.
void checkDevice(const io::Scene& scene, const regulator::DeviceFacts& device,
                 std::vector<Finding>& findings) {
  const model::Actuator& most = highest(scene.arm);
  const int channels = device.used(scene.arm.actuatorCount());
  const std::string name = regulator::describe(*scene.regulator);
  if (device.highest_pressure < most.limits.upper) {
    findings.push_back({Severity::kFault, "device_range", name,
                        "it accepts at most " + kpa(device.highest_pressure) +
                            ", and the limit of " + most.name + " is " + kpa(most.limits.upper),
                        "lower max_pressure_kpa to what the device can give; if yours gives more, "
                        "name a copy of its profile that says so"});
  }
  if (device.most_channels && channels > *device.most_channels) {
    findings.push_back({Severity::kFault, "device_channels", name,
                        "it has at most " + std::to_string(*device.most_channels) +
                            " channels, and the arm needs " + std::to_string(channels),
                        "use a device with more channels, or fewer muscles; if yours has more, "
                        "name a copy of its profile that says so"});
  }
}

void checkWatchdog(const io::Scene& scene, double watchdog, std::vector<Finding>& findings) {
  const std::string name = regulator::describe(*scene.regulator);
  if (std::isfinite(watchdog)) {
    findings.push_back({Severity::kNote, "watchdog", name,
                        "it vents by itself " + figure(watchdog) + " s after the last line",
                        "pull the line once with little pressure, and see that it does"});
    return;
  }
  findings.push_back(
      {Severity::kWarning, "no_watchdog", name,
       "its profile promises no venting when the line or this computer dies; expected a watchdog "
       "of the device",
       "mount a dump valve that opens without power, and a relief valve; see docs/safety.md"});
}

void checkRegulator(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.regulator) {
    findings.push_back({Severity::kNote, "no_regulator", "regulator",
                        "scene " + scene.name + " has none, so that nothing moves",
                        "add the section regulator"});
    return;
  }
  const model::Actuator& most = highest(scene.arm);
  if (const auto* simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&*scene.regulator)) {
    for (const Finding& finding : checkSupply(scene, simulated->supply_pressure)) {
      findings.push_back(finding);
    }
    return;
  }
  const regulator::DeviceFacts device = regulator::factsOf(*scene.regulator);
  checkDevice(scene, device, findings);
  const auto& least_supply = scene.safety.rules.min_supply;
  if (least_supply && *least_supply < most.limits.upper) {
    findings.push_back({Severity::kWarning, "min_supply", "safety.min_supply_kpa",
                        "it is " + kpa(*least_supply) + ", below the limit of " + most.name + ", " +
                            kpa(most.limits.upper) +
                            ": a supply between both leaves set points unreached",
                        "raise it to the highest limit, or lower the limits"});
  }
  checkWatchdog(scene, device.watchdog, findings);
}

constexpr double kDegree = basics::kPi / 180;
constexpr double kInward = (90 + 1e-6) * kDegree;  // a face along the arm is none
constexpr double kOblique = 60 * kDegree;
constexpr double kAlong = 0.5;  // least cosine between the arm and the face of a tag on its end
// Tags side by side are this far apart, in sizes: they may share the white that a detector needs.
constexpr double kLeastPitch = 1.125;
constexpr double kSameFace = 0.87;  // cosine of 30 degrees
constexpr std::size_t kMostPairs = 20;

double skinRadius(const io::Scene& scene, int section, double s) {
  const io::SectionLook& look = scene.looks[static_cast<std::size_t>(section)];
  double radius = look.separator_radius;
  for (int i = scene.arm.firstActuator(section); i < scene.arm.firstActuator(section + 1); ++i) {
    const double centre = model::poseAlong(scene.arm.actuator(i), s).translation.tail<2>().norm();
    radius = std::max(radius, centre + look.muscle_radius);
  }
  return radius;
}

// Values of the tags, or pairs of tags, of which one finding tells.
struct Values {
  double least = std::numeric_limits<double>::infinity();
  double most = -std::numeric_limits<double>::infinity();

  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  // "5.4", or "5.4 to 7".
  std::string text() const {
    const std::string from = figure(least), to = figure(most);
    return from == to ? from : from + " to " + to;
  }
};

struct Tags {
  std::vector<int> ids;
  Values values;
  Values bounds;  // of which each value was held against its own, if they differ

  void add(int id, double value, double bound = 0) {
    ids.push_back(id);
    values.add(value);
    bounds.add(bound);
  }
  std::string culprit() const { return (ids.size() == 1 ? "tag " : "tags ") + io::listOf(ids); }
};

// A tag on the end of the arm that looks along it, not around it.
bool isOnEnd(const io::Scene& scene, const estimation::TagPlacement& tag) {
  return tag.section + 1 == scene.arm.sectionCount() && tag.s >= 1 &&
         tag.X_ST.rotation(0, 2) > kAlong;
}

void checkMounting(const io::Scene& scene, std::vector<Finding>& findings) {
  Tags off, inside, inward, oblique;
  const std::vector<UnrolledTag> tags = unrolled(scene.arm, *scene.tags);
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const UnrolledTag& tag = tags[i];
    const double skin = skinRadius(scene, tag.section, tag.s);
    const double distance = tag.radius - skin;
    if (distance > kFarthestTag * skin) off.add(tag.id, 1e3 * distance, 1e3 * kFarthestTag * skin);
    if (isOnEnd(scene, scene.tags->tags[i])) continue;
    // The centre is within the circle of the muscles' inner sides, where nothing is glued to.
    if (tag.radius < 0.5 * skin) inside.add(tag.id, 1e3 * tag.radius, 1e3 * skin);
    if (tag.tilt > kInward) {
      inward.add(tag.id, tag.tilt / kDegree);
    } else if (tag.tilt > kOblique) {
      oblique.add(tag.id, tag.tilt / kDegree);
    }
  }
  const auto tell = [&findings](Severity severity, const char* cause, const Tags& of,
                                const std::string& text, const char* remedy) {
    if (!of.ids.empty()) findings.push_back({severity, cause, of.culprit(), text, remedy});
  };
  tell(Severity::kWarning, "tag_off_arm", off,
       "outside the arm's skin by " + off.values.text() +
           " mm; expected at most the radius of the skin there, " + off.bounds.text() + " mm",
       "check position_m of the group: it counts from the actuator if the group names one, "
       "otherwise from the base curve");
  tell(Severity::kFault, "tag_inside_arm", inside,
       "the centre is " + inside.values.text() +
           " mm from the base curve, inside the arm, whose skin is at " + inside.bounds.text() +
           " mm",
       "set position_m of the group to where it is glued");
  tell(Severity::kFault, "tag_faces_inward", inward,
       "the face points " + inward.values.text() + " deg from outwards; expected less than 90 deg",
       "turn it by rpy_deg of the group, so that its z axis points away from the arm");
  tell(Severity::kNote, "tag_oblique", oblique,
       "the face points " + oblique.values.text() + " deg from outwards",
       "check rpy_deg of the group");
}

struct Pairs {
  std::size_t count = 0;
  std::string names;
  Values distances;

  void add(int a, int b, double distance) {
    if (count < kMostPairs) {
      names += (count > 0 ? ", " : "") + std::to_string(a) + " and " + std::to_string(b);
    }
    ++count;
    distances.add(distance);
  }
  std::string culprit() const {
    return "tags " + names +
           (count > kMostPairs ? " and " + std::to_string(count - kMostPairs) + " more pairs" : "");
  }
};

void checkOverlaps(const io::Scene& scene, std::vector<Finding>& findings) {
  const model::Shape rest = model::shapeOf(scene.arm, scene.arm.unloaded(scene.arm.inputAt(0)));
  const std::vector<lie::SE3> poses = estimation::tagPoses(*scene.tags, rest);
  const double pitch = kLeastPitch * scene.tags->size;
  Pairs overlapping, close;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double distance = (poses[i].translation - poses[j].translation).norm();
      const double facing = poses[i].rotation.col(2).dot(poses[j].rotation.col(2));
      if (distance >= pitch || facing < kSameFace) continue;
      Pairs& pairs = distance < scene.tags->size ? overlapping : close;
      pairs.add(scene.tags->tags[j].id, scene.tags->tags[i].id, 1e3 * distance);
    }
  }
  const auto tell = [&](Severity severity, const Pairs& pairs) {
    if (pairs.count == 0) return;
    findings.push_back({severity, "tags_overlap", pairs.culprit(),
                        "their centres are " + pairs.distances.text() + " mm apart; expected " +
                            figure(1e3 * pitch) + " mm, so that white is between them",
                        "move one of them along s, or print them smaller (tags.size_m)"});
  };
  tell(Severity::kFault, overlapping);
  tell(Severity::kWarning, close);
}

void checkTags(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.tags) {
    findings.push_back({Severity::kNote, "no_tags", "tags",
                        "scene " + scene.name + " has none, so that nothing is measured",
                        "add the section tags, and print them with helix_arm tags"});
    return;
  }
  checkMounting(scene, findings);
  checkOverlaps(scene, findings);
}

void checkBodies(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.motion_capture.X_BF) {
    findings.push_back({Severity::kWarning, "frame_unknown", "motion_capture.frame",
                        "the frame of the poses is not known, so that nothing is measured",
                        "calibrate with --fit base, or give it"});
  }
  const model::Shape rest = model::shapeOf(scene.arm, scene.arm.unloaded(scene.arm.inputAt(0)));
  const std::vector<lie::SE3> places = estimation::tagPoses(*scene.tags, rest);
  std::vector<estimation::PoseObservation> seen;
  for (int i = 0; i < static_cast<int>(places.size()); ++i) {
    seen.push_back({i, places[static_cast<std::size_t>(i)]});
  }
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  if (fitter.fit(seen, rest).status != estimation::FitStatus::kUnderdetermined) return;
  findings.push_back({Severity::kFault, "few_bodies", "bodies",
                      std::to_string(seen.size()) + " do not determine the shape of " +
                          std::to_string(scene.arm.sectionCount()) + " sections",
                      "place one with rotations at the end of each section"});
}

constexpr int kCorners = 50;
// Parts of the samples, and of the arm's length.
constexpr double kMostBlind = 0.2;
constexpr double kMostTipSd = 0.03;
constexpr double kFewExceed = 0.1;

// Samples of a run over the workspace.
struct Samples {
  int solved = 0, unsolved = 0, blind = 0, tip_outside = 0;
  std::vector<double> counts, tip_sd;  // of tags that can be read
  std::vector<double> bits;            // of all tags that face the camera
  std::set<int> seen;                  // ids that can be read
};

double tipSd(const io::Scene& scene, const estimation::PlacedView& placed,
             const model::Shape& shape, const simulation::MeasuredShape& measured) {
  Eigen::MatrixXd covariance = measured.covariance;
  if (const auto placement =
          estimation::placementCovariance(placed, scene.arm, shape, measured.tags)) {
    covariance += *placement;
  }
  const Eigen::Matrix3d tip = estimation::tipCovariance(shape, covariance);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(tip, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, axes.eigenvalues().maxCoeff()));
}

Samples sample(const io::Scene& scene, int count) {
  const estimation::ArmView view = scene.view();
  const vision::TagFamily family(scene.vision.detector.family);
  const simulation::CameraSetup camera{view, family, {}, scene.simulation.camera};
  simulation::SimulatedVisionConfig config;
  config.corner_noise = scene.vision.fit.corner_noise;
  config.least_side =
      kLeastPixelsPerBit * scene.vision.detector.quad_decimate * family.borderCells();
  simulation::SimulatedVision vision(camera, view, scene.vision, config);
  const estimation::PlacedView placed = *placedViewOf(scene);
  Samples out;
  for (const Eigen::VectorXd& input : statics::sampleInputs(scene.arm, kCorners, count)) {
    const statics::Solution solution = scene.model.solve(input);
    if (!solution.converged()) {
      ++out.unsolved;
      continue;
    }
    ++out.solved;
    const auto visible = estimation::visibleTags(view, solution.shape);
    int readable = 0;
    for (const estimation::TagImage& tag : visible) {
      const double side = estimation::longestSide(tag.corners);
      out.bits.push_back(side / family.borderCells());
      if (side < config.least_side) continue;
      ++readable;
      out.seen.insert(view.layout.tags[static_cast<std::size_t>(tag.tag)].id);
    }
    out.counts.push_back(readable);
    const auto tip = view.camera.project(view.X_CB * solution.tip.translation);
    out.tip_outside += tip && view.camera.contains(*tip) ? 0 : 1;
    const auto measured = vision.look(solution.shape, solution.shape);
    if (measured) out.tip_sd.push_back(tipSd(scene, placed, solution.shape, *measured));
    if (!measured) ++out.blind;
  }
  return out;
}

std::string percentOf(int part, int whole) {
  return figure(100.0 * part / std::max(1, whole), 3) + " %";
}

void judgeSize(const io::Scene& scene, const Samples& samples, VisionFigures& figures,
               std::vector<Finding>& findings) {
  if (samples.bits.empty()) return;
  std::vector<double> bits = samples.bits;
  const auto place = static_cast<std::size_t>(kFewExceed * static_cast<double>(bits.size()));
  std::nth_element(bits.begin(), bits.begin() + static_cast<std::ptrdiff_t>(place), bits.end());
  figures.pixels_per_bit = bits[place];
  const double decimate = scene.vision.detector.quad_decimate;
  const double searched = figures.pixels_per_bit / decimate;
  if (searched >= kWantedPixelsPerBit) return;
  findings.push_back({searched < kLeastPixelsPerBit ? Severity::kFault : Severity::kWarning,
                      "tags_too_small", "tags.size_m",
                      "a tenth of the tags that face the camera has less than " +
                          figure(figures.pixels_per_bit) + " px a bit, " + figure(searched) +
                          " px with vision.quad_decimate " + figure(decimate) + "; expected " +
                          figure(kWantedPixelsPerBit) + " px; below " + figure(kLeastPixelsPerBit) +
                          " px a tag counts as unread",
                      "print larger tags, move the camera closer, take a larger picture, or lower "
                      "vision.quad_decimate"});
}

void judge(const io::Scene& scene, const Samples& samples, const VisionFigures& figures,
           std::vector<Finding>& findings) {
  const int all = samples.solved;
  if (samples.blind > 0) {
    findings.push_back(
        {samples.blind > kMostBlind * all ? Severity::kFault : Severity::kWarning, "few_tags",
         "camera",
         "in " + percentOf(samples.blind, all) +
             " of the workspace the tags that are read do not tell the shape; fewest: " +
             std::to_string(figures.least_tags) +
             ", vision.min_tags: " + std::to_string(scene.vision.min_tags),
         "add tags that face the camera there, or move the camera (camera.position_m, rpy_deg)"});
  }
  if (samples.tip_outside > 0) {
    findings.push_back({Severity::kWarning, "tip_outside_picture", "camera",
                        "the tip leaves the picture in " + percentOf(samples.tip_outside, all) +
                            " of the workspace",
                        "move the camera back, or turn it"});
  }
  if (!figures.unseen.empty()) {
    findings.push_back(
        {Severity::kNote, "tags_never_seen", "tags " + io::listOf(figures.unseen),
         "no shape of the workspace shows them to the camera, large enough to be read",
         "leave them out, or add them where the camera looks"});
  }
  const double length = scene.arm.restLength();
  if (figures.median_tip_sd > kMostTipSd * length) {
    findings.push_back({Severity::kWarning, "tip_uncertain", "tags",
                        "the tip is measured to " + figure(1e3 * figures.median_tip_sd) +
                            " mm (one standard deviation, median over the workspace); expected " +
                            figure(100 * kMostTipSd) + " % of the arm's length, " +
                            figure(1e3 * kMostTipSd * length) + " mm",
                        "add tags near the tip, calibrate the placements (helix_arm calibrate "
                        "--fit placement), or move the camera closer"});
  }
}

void checkCamera(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.camera) {
    findings.push_back({Severity::kNote, "no_camera", "camera",
                        "scene " + scene.name + " has none, so that nothing is measured",
                        "add the section camera"});
    return;
  }
  const estimation::Camera& camera = scene.camera->model;
  if (!camera.isCentred()) {
    findings.push_back({Severity::kFault, "camera_centre", "camera",
                        "its principal point is at (" + figure(camera.cx, 4) + ", " +
                            figure(camera.cy, 4) + ") px; expected within a fifth of " +
                            std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                            " px of their centre",
                        "give camera.size_px, focal_px and centre_px of one calibration"});
  }
  constexpr int kSteps = 10, kPoints = (kSteps + 1) * (kSteps + 1);  // of the picture
  int lost = 0;
  for (int k = 0; k < kPoints; ++k) {
    const Eigen::Vector2d pixel(camera.width * (k % (kSteps + 1)) / double(kSteps),
                                camera.height * (k / (kSteps + 1)) / double(kSteps));
    const auto direction = camera.directionOf(pixel);
    const double plain =
        std::hypot((pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy);
    lost += !direction || direction->norm() > 2 * plain || direction->norm() < 0.5 * plain ? 1 : 0;
  }
  if (camera.distorts() && lost > 0) {
    findings.push_back(
        {lost > kMostBlind * kPoints ? Severity::kFault : Severity::kWarning, "camera_distortion",
         "camera",
         "in " + percentOf(lost, kPoints) +
             " of the picture its distortion cannot be inverted, so that tags are not used there, "
             "or halves or doubles the distance from the centre",
         "give camera.distortion as k1 k2 p1 p2 k3 k4 k5 k6, all those of one calibration"});
  }
  // Half a size, or half of the last pixel's place: nobody measures that.
  const auto nominal = [](double centre, int size) {
    return std::abs(centre - 0.5 * size) < 1e-9 || std::abs(centre - 0.5 * (size - 1)) < 1e-9;
  };
  if (camera.distorts() || !nominal(camera.cx, camera.width) ||
      !nominal(camera.cy, camera.height)) {
    return;
  }
  findings.push_back({Severity::kWarning, "camera_uncalibrated", "camera",
                      "its principal point is the picture's centre and it has no distortion, as "
                      "before a calibration",
                      "calibrate it: helix_arm tags --board, then helix_arm camera calibrate"});
}

// Figures of what is seen over the workspace; nothing without camera or tags.
std::optional<VisionFigures> checkVision(const io::Scene& scene, int samples,
                                         std::vector<Finding>& findings) {
  if (!scene.camera || !scene.tags) return std::nullopt;
  const Samples taken = sample(scene, samples);
  VisionFigures figures;
  figures.samples = taken.solved;
  if (taken.unsolved > 0) {
    findings.push_back({Severity::kWarning, "load_unbalanced", "load",
                        "no shape balances it in " +
                            percentOf(taken.unsolved, taken.solved + taken.unsolved) +
                            " of the workspace",
                        "check load and K_eps_n, or lower the limits"});
  }
  if (taken.solved == 0) return figures;
  figures.least_tags =
      static_cast<int>(*std::min_element(taken.counts.begin(), taken.counts.end()));
  figures.median_tags = basics::medianOf(taken.counts);
  for (const estimation::TagPlacement& tag : scene.tags->tags) {
    if (taken.seen.count(tag.id) == 0) figures.unseen.push_back(tag.id);
  }
  figures.measured = static_cast<double>(taken.tip_sd.size()) / taken.solved;
  if (!taken.tip_sd.empty()) {
    figures.median_tip_sd = basics::medianOf(taken.tip_sd);
    figures.worst_tip_sd = *std::max_element(taken.tip_sd.begin(), taken.tip_sd.end());
  }
  judgeSize(scene, taken, figures, findings);
  judge(scene, taken, figures, findings);
  return figures;
}

// The arm at its lower limits, from which most motions begin, and at inputs drawn for the camera.
void checkZones(const io::Scene& scene, int samples, std::vector<Finding>& findings) {
  if (!scene.keep_out) return;
  const clearance::SweepCheck zones(scene.model, *scene.keep_out);
  const auto blocked = zones.sweep({scene.arm.inputAt(0.0)});
  if (blocked) {
    findings.push_back({Severity::kFault, "zone", blocked->zone.empty() ? "load" : blocked->zone,
                        "at its lower limits the arm " + blocked->text(),
                        "correct the zone; if the arm is mounted on it, say from_m"});
  }
  if (samples == 0) return;
  const statics::WorkspacePoints drawn = statics::Workspace(scene.model).sample(0, samples);
  int clear = 0;
  for (Eigen::Index row = 0; row < drawn.inputs.rows(); ++row) {
    clear += zones.isClear(drawn.inputs.row(row).transpose()) ? 1 : 0;
  }
  const std::string part = figure(100.0 * clear / std::max(1, drawn.count()), 2);
  findings.push_back({clear == 0 ? Severity::kFault : Severity::kNote, "clear_part", "keep_out",
                      "at " + part + " % of " + std::to_string(drawn.count()) +
                          " drawn inputs the arm is clear of all zones",
                      "move or shrink the zones if that is too little"});
}

}  // namespace

const char* nameOf(Severity severity) {
  switch (severity) {
    case Severity::kNote:
      return "note";
    case Severity::kWarning:
      return "warning";
    case Severity::kFault:
      break;
  }
  return "fault";
}

void sortBySeverity(std::vector<Finding>& findings) {
  std::stable_sort(findings.begin(), findings.end(),
                   [](const Finding& a, const Finding& b) { return a.severity > b.severity; });
}

bool RigCheck::hasFault() const {
  return std::any_of(findings.begin(), findings.end(),
                     [](const Finding& finding) { return finding.severity == Severity::kFault; });
}

std::vector<Finding> checkSupply(const io::Scene& scene, double supply) {
  const model::Actuator& most = highest(scene.arm);
  if (supply >= most.limits.upper) return {};
  return {{Severity::kWarning, "supply", most.name,
           "its limit is " + kpa(most.limits.upper) + ", and the supply gives " + kpa(supply) +
               ": pressures above that are never reached",
           "raise the supply, or lower max_pressure_kpa"}};
}

RigCheck checkRig(const io::Scene& scene, int samples) {
  RigCheck check;
  if (scene.hasBodies()) {
    checkBodies(scene, check.findings);
  } else {
    checkTags(scene, check.findings);
    checkCamera(scene, check.findings);
  }
  check.vision = checkVision(scene, samples, check.findings);
  checkCurves(scene, check.findings);
  checkLoad(scene, check.findings);
  checkZones(scene, samples, check.findings);
  checkRegulator(scene, check.findings);
  sortBySeverity(check.findings);
  return check;
}

}  // namespace helix_arm::procedures
