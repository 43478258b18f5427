#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <set>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/estimation/arm_view.hpp"
#include "helix_arm/estimation/placed_view.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/simulation/simulated_vision.hpp"
#include "helix_arm/statics/input_samples.hpp"
#include "rig_check_parts.hpp"
#include "scene_view.hpp"

namespace helix_arm::procedures {
namespace {

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
  std::vector<int> unseen;
  for (const estimation::TagPlacement& tag : scene.tags->tags) {
    if (samples.seen.count(tag.id) == 0) unseen.push_back(tag.id);
  }
  if (!unseen.empty()) {
    findings.push_back(
        {Severity::kNote, "tags_never_seen", "tags " + io::listOf(unseen),
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

}  // namespace

void checkCamera(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.camera) {
    findings.push_back({Severity::kNote, "no_camera", "camera",
                        "scene " + scene.name + " has none, so that nothing is measured",
                        "add the section camera"});
    return;
  }
  const estimation::Camera& camera = scene.camera->model;
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
  figures.measured = static_cast<double>(taken.tip_sd.size()) / taken.solved;
  if (!taken.tip_sd.empty()) {
    figures.median_tip_sd = basics::medianOf(taken.tip_sd);
    figures.worst_tip_sd = *std::max_element(taken.tip_sd.begin(), taken.tip_sd.end());
  }
  judgeSize(scene, taken, figures, findings);
  judge(scene, taken, figures, findings);
  return figures;
}

}  // namespace helix_arm::procedures
